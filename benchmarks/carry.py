"""Do carry states hold? 100 random objects, pelvis fixed, random servo targets, five seconds.

    python -m benchmarks.carry [--objects 100] [--seed 0] [--fine] [--palm-friction 0.6]

Slip: movement of the object's centre in the frame of the pelvis beyond what the mean of both palms moved.
"""

from __future__ import annotations

import argparse
import time

import mujoco
import numpy as np
from rich.progress import track
from rich.table import Table

from benchmarks.arguments import a_count, a_seed
from hotice.console import PlainConsole
from hotice.errors import CarryInfeasible
from hotice.model import CarryState, ObjectRange, builder, solve_carry
from hotice.model.carry import Posture
from hotice.model.dynamics import DynamicsConfig, perturb

NOISE_RAD = 0.03
SECONDS = 5.0
CONTROL_S = 0.02


def hold(
    state: CarryState,
    rng: np.random.Generator,
    *,
    timestep_s: float = 0.005,
    elliptic: bool = False,
    palm_friction: float | None = None,
) -> tuple[bool, float]:
    """Simulates the held object at a fixed pelvis; returns whether it stayed and the slip [m]."""
    model = builder.build_model(
        state.carried, wrist_pos=state.wrist_pos, fixed_base=True, floor=False, timestep_s=timestep_s, elliptic=elliptic
    )
    if palm_friction is not None:
        model = perturb(model, DynamicsConfig(palm_friction=(palm_friction, palm_friction)), rng)
    data = mujoco.MjData(model)
    offset = state.root_pos_W - model.body("pelvis").pos
    model.body("pelvis").quat[:] = state.quat_WP
    data.qpos[:20] = state.joint_pos
    data.qpos[20:23] = state.object_pos_W - offset
    data.qpos[23:] = state.quat_WO
    palms = [model.site("left_hand").id, model.site("right_hand").id]
    mujoco.mj_kinematics(model, data)

    def grip() -> np.ndarray:
        return data.qpos[20:23] - data.site_xpos[palms].mean(axis=0)

    before = grip()
    for _ in range(round(SECONDS / CONTROL_S)):
        data.ctrl[:] = state.joint_target + rng.uniform(-NOISE_RAD, NOISE_RAD, 20)
        mujoco.mj_step(model, data, nstep=round(CONTROL_S / timestep_s))
    slip = float(np.linalg.norm(grip() - before))
    return slip < 0.10 and bool(np.isfinite(data.qpos).all()), slip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=a_count, default=100)
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument(
        "--fine", action="store_true", help="2 ms steps and elliptic cones instead of training settings"
    )
    parser.add_argument("--palm-friction", type=float, help="of both palms; default: that of the description, 2.0")
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    objects = ObjectRange(shapes=("box", "cylinder", "sphere"))
    slips, held, solve_s, infeasible, shapes = [], 0, [], [], []
    for _ in track(range(args.objects), description="holding"):
        carried = objects.sample(rng)
        posture = Posture(pelvis_height_m=rng.uniform(0.60, 0.77), lean_rad=rng.uniform(0.0, 0.2))
        begin = time.perf_counter()
        try:
            state = solve_carry(carried, posture)
        except CarryInfeasible as error:
            infeasible.append(str(error))
            continue
        solve_s.append(time.perf_counter() - begin)
        dt = 0.002 if args.fine else 0.005
        ok, slip = hold(state, rng, timestep_s=dt, elliptic=args.fine, palm_friction=args.palm_friction)
        held += ok
        slips.append(slip)
        shapes.append(carried.shape)
    physics = "2 ms, elliptic" if args.fine else "5 ms, pyramidal"
    palms = "2.0" if args.palm_friction is None else f"{args.palm_friction:g}"
    table = Table(title=f"{args.objects} objects, targets ± {NOISE_RAD} rad, {SECONDS:g} s, {physics}, palms {palms}")
    for column in ("shape", "objects", "held", "median slip [mm]", "worst slip [mm]"):
        table.add_column(column, justify="right")
    slips_mm, names = 1e3 * np.array(slips), np.array(shapes)
    for shape in (*sorted(set(shapes)), "all"):
        mine = slips_mm[(names == shape) | (shape == "all")]
        table.add_row(
            shape, str(len(mine)), str(int((mine < 100).sum())), f"{np.median(mine):.1f}", f"{mine.max():.1f}"
        )
    console = PlainConsole()
    console.print(table)
    console.print(
        f"held {held}/{args.objects}; infeasible {len(infeasible)}; solve {1e3 * np.mean(solve_s):.0f} ms mean"
    )
    for line in sorted(set(infeasible)):
        console.print(f"  {line}")


if __name__ == "__main__":
    main()
