"""Does the robot put objects down? Random put-downs in MuJoCo, at the contact settings of training.

    python -m benchmarks.putdown [--shape box|cylinder|sphere] [--count 50] [--seed 0]

The robot holds an object as a pick-up leaves it (`benchmarks.pickup`: same objects, supports and noise) and stands
up to 10 cm and 10 degrees from where the plan has its feet, farther back by 5 to 15 cm. Success: the object stands
within 5 cm of its place and within 10 degrees of upright, the hands are 3 cm and more off it, and the robot has stood
for 2 s. Failures are listed by cause.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from rich.progress import track

from benchmarks.arguments import a_count, a_seed, from_zero
from benchmarks.pickup import NEAR_M, Noise, Trial, draw, in_world, table
from hotice.console import PlainConsole
from hotice.control import TorquePlant
from hotice.control.pick_plan import Support
from hotice.control.pickup import Stance
from hotice.control.putdown import PutDown
from hotice.errors import CarryInfeasible, PickInfeasible
from hotice.model import builder, frames, g1
from hotice.model.object_range import SHAPES
from hotice.task.rules import HANDS_OFF_M, PLACED_M, PLACED_RAD, STOOD_S

LIMIT_S = 60.0


@dataclass(frozen=True)
class Placed:
    """How it ended: `cause` is empty for a success; off [m], lean [rad] of the object, hands off it [m]."""

    cause: str
    off_m: float = np.nan
    lean_rad: float = np.nan
    apart_m: float = np.nan
    seconds: float = 0.0
    faults: int = 0

    def __str__(self) -> str:
        return (
            f"{100 * self.off_m:.1f} cm off, leaning by {np.degrees(self.lean_rad):.0f} degrees, hands "
            f"{100 * self.apart_m:.0f} cm off it, {self.seconds:.0f} s"
        )


def start_away(seed: int) -> Stance:
    """Where the robot stands at first, from where it is to stand."""
    rng = np.random.default_rng([seed, 1])
    x, y, yaw = rng.uniform([-0.15, -0.10, -0.17], [-0.05, 0.10, 0.17])
    return Stance(float(x), float(y), float(yaw))


def run(trial: Trial, *, noisy: bool = True, away: Stance | None = None, watch=None) -> Placed:
    """Plans and simulates one put-down to where `trial` has the object.

    `away`: where the robot starts, from where the plan has it; `watch(plant, command, memory)` after every step.
    """
    rng = np.random.default_rng(trial.seed)
    p, quat = trial.position, frames.quat_from_yaw(trial.yaw_rad)
    try:
        controller = PutDown(trial.carried, Support(top_m=trial.top_m, near_m=NEAR_M), p, quat, stance=trial.stance)
    except (CarryInfeasible, PickInfeasible) as error:
        return Placed(f"not planned: {str(error)[-80:]}")
    model = builder.build_model(trial.carried, table(trial), wrist_pos=controller.planner.wrist_pos)
    palms = [model.geom(f"{s}_palm_{i}").id for s in ("left", "right") for i in range(4)]
    model.geom_friction[[*palms, model.geom("object").id], 0] = trial.friction
    plant = TorquePlant(model)
    plant.reset(holding(controller, trial, start_away(trial.seed) if away is None else away))
    see, measurement = Noise(rng) if noisy else lambda m: m, plant.measure()
    memory = controller.start(see(measurement))
    stood_s, command = 0.0, None
    steps = max(round(1.0 / controller.rate_hz / model.opt.timestep), 1)
    while plant.data.time < LIMIT_S and stood_s < STOOD_S:
        command, memory = controller.step(memory, see(measurement))
        plant.step(command.torque, steps)
        measurement = plant.measure()
        if watch is not None:
            watch(plant, command, memory)
        if measurement.p_WP[2] < 0.35 or not measurement.finite():
            return Placed(f"fell in {command.phase}", seconds=plant.data.time, faults=command.faults)
        if command.phase in ("done", "abort"):
            stood_s += steps * model.opt.timestep
    return score(trial, plant, stood_s, memory, command)


def holding(controller: PutDown, trial: Trial, away: Stance) -> np.ndarray:
    """Configuration (34,) of the robot in the carry state at the end of the planned pick-up, `away` from its place."""
    from hotice.control.pick_plan import frames_at

    plan = controller.plan
    q = plan.retreat[-1]
    hands = frames_at(controller.planner.terms, q)
    before = frames_at(controller.planner.terms, plan.grasp)
    # the hands hold it as they do in the grasp
    R_GO = hands.R[0] @ before.R[0].T @ np.asarray(frames.quat_to_mat(plan.quat_GO))
    p_GO = hands.p.mean(axis=0) - R_GO @ plan.p_OH.mean(axis=0)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, R_GO.ravel())
    back = Stance(away.x - plan.back_m, away.y, away.yaw)
    robot, thing = (in_world(back, *pose) for pose in ((q[:3], np.roll(q[3:7], 1)), (p_GO, quat)))
    robot, thing = (in_world(trial.stance, *pose) for pose in (robot, thing))
    return np.concatenate([*robot, q[7:], *thing])


def score(trial: Trial, plant: TorquePlant, stood_s: float, memory, command) -> Placed:
    """The object's place and attitude at the end, and how far the hands are from it."""
    want, _ = in_world(trial.stance, trial.position, np.array([1.0, 0.0, 0.0, 0.0]))
    q, data = plant.data.qpos, plant.data
    off = float(np.linalg.norm(q[g1.OBJECT_POS] - want))
    up = frames.quat_to_mat(q[g1.OBJECT_QUAT])[2, 2]
    lean = 0.0 if trial.carried.shape == "sphere" else float(np.arccos(np.clip(up, -1.0, 1.0)))
    thing, ends = plant.model.geom("object").id, np.zeros(6)
    arms = [g for g in range(plant.model.ngeom) if "wrist" in plant.model.body(plant.model.geom_bodyid[g]).name]
    apart = min(mujoco.mj_geomDistance(plant.model, data, g, thing, 1.0, ends) for g in arms)
    causes = (
        (memory.failure, memory.failure),
        (stood_s < STOOD_S, f"stuck in {command.phase}"),
        (off > PLACED_M, "not at its place"),
        (lean > PLACED_RAD, "not upright"),
        (apart < HANDS_OFF_M, "hands not off it"),
    )
    cause = next((why for wrong, why in causes if wrong), "")
    return Placed(cause, off, lean, float(apart), data.time, command.faults)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shape", choices=SHAPES, default="box")
    parser.add_argument("--count", type=a_count, default=50)
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--exact", action="store_true", help="without noise")
    parser.add_argument("--only", type=from_zero, nargs="*", help="numbers of the trials to run")
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    trials = [draw(args.shape, rng) for _ in range(args.count)]
    console, results, begin = PlainConsole(width=200), [], time.perf_counter()
    for i in track(args.only or range(args.count), description="putting down", console=console):
        result = run(replace(trials[i], yaw_rad=0.0), noisy=not args.exact)
        results.append(result)
        if result.cause:
            console.print(f"{i}: {result.cause} ({result}): {trials[i]}")
    good = [r for r in results if not r.cause]
    console.print(f"{args.shape}: {len(good)}/{len(results)} put down")
    for cause, count in Counter(r.cause.split(":")[0] for r in results if r.cause).most_common():
        console.print(f"  {count} x {cause}")
    if good:
        off = 100 * np.array([r.off_m for r in good])
        seconds, faults = np.mean([r.seconds for r in good]), sum(r.faults for r in results)
        console.print(f"  {off.mean():.1f} cm off in the mean, at most {off.max():.1f} cm; {seconds:.1f} s each")
        console.print(f"  {faults} faults of the solver; wall {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
