"""Does the robot pick objects up? Random picks in MuJoCo, at the contact settings of training.

    python -m benchmarks.pickup [--shape box|cylinder|sphere] [--count 100] [--seed 0]

Objects of 0.5-3.5 kg and 20-40 cm stand 1-3 cm behind the edge of a support 0.45-0.8 m high, up to 5 cm to the side and
turned by up to 15 degrees; friction of palms, object and support 0.8-2. The controller sees the object up to 1 cm and 2
degrees wrong for the whole trial, joint angles +- 0.005 rad and velocities +- 0.05 (rad/s, m/s) wrong at every step;
the robot starts with joints +- 0.01 rad off. Success: lifted, then for 5 s held in the carry state, which is the object
within 8 cm and 25 degrees of where it is there, seen from the feet. Failures are listed by cause.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from rich.progress import track

from benchmarks.arguments import a_count, a_seed, from_zero
from hotice.console import PlainConsole
from hotice.control import Measurement, TorquePlant
from hotice.control.pick_plan import Support
from hotice.control.pickup import Pickup, Stance
from hotice.errors import CarryInfeasible, PickInfeasible
from hotice.model import BoxShape, CarriedObject, ObjectRange, Obstacle, Scene, builder, frames
from hotice.model.object_range import SHAPES

HELD_S, LIMIT_S = 5.0, 60.0
NEAR_M = 0.24
OFF_M, OFF_RAD = 0.08, np.radians(25.0)


@dataclass(frozen=True)
class Trial:
    """One draw."""

    carried: CarriedObject
    top_m: float
    inset_m: float
    lateral_m: float
    yaw_rad: float
    friction: float
    seed: int
    stance: Stance = Stance()
    """Where the robot stands; the support is before it."""

    @property
    def position(self) -> np.ndarray:
        half = self.carried.half_extents_m
        depth = half[0]
        if self.carried.shape == "box":
            depth = half[0] * np.cos(self.yaw_rad) + half[1] * abs(np.sin(self.yaw_rad))
        return np.array([NEAR_M + self.inset_m + depth, self.lateral_m, self.top_m + half[2]])

    def __str__(self) -> str:
        size = " x ".join(f"{200 * h:.0f}" for h in self.carried.half_extents_m)
        return (
            f"{self.carried.shape} {size} cm {self.carried.mass_kg:.1f} kg, support {self.top_m:.2f} m, "
            f"{100 * self.lateral_m:+.0f} cm, {np.degrees(self.yaw_rad):+.0f} deg, friction {self.friction:.1f}"
        )


@dataclass(frozen=True)
class Result:
    """How it ended: `cause` is empty for a success."""

    cause: str
    detail: str
    seconds: float
    faults: int
    attempts: int


def draw(shape: str, rng: np.random.Generator) -> Trial:
    return Trial(
        carried=ObjectRange(shapes=(shape,)).sample(rng),
        top_m=rng.uniform(0.45, 0.8),
        inset_m=rng.uniform(0.01, 0.03),
        lateral_m=rng.uniform(-0.05, 0.05),
        yaw_rad=np.radians(rng.uniform(-15, 15)),
        friction=rng.uniform(0.8, 2.0),
        seed=int(rng.integers(2**31)),
    )


def table(trial: Trial) -> Scene:
    middle, quat = in_world(
        trial.stance, np.array([NEAR_M + 0.3, 0.0, trial.top_m / 2]), np.array([1.0, 0.0, 0.0, 0.0])
    )
    place, turn = tuple(middle.tolist()), tuple(quat.tolist())
    return Scene("table", obstacles=(Obstacle("support", "side", BoxShape((0.6, 0.8, trial.top_m)), place, turn),))


def in_world(stance: Stance, p_G: np.ndarray, quat_G: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A pose in W, from where the robot stands."""
    turn = frames.quat_from_yaw(stance.yaw)
    return frames.quat_rotate(turn, p_G) + [stance.x, stance.y, 0.0], frames.quat_mul(turn, quat_G)


class Noise:
    """What the controller sees in place of the truth."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.shift = np.array([*rng.uniform(-0.01, 0.01, 2), 0.0])
        self.turn = frames.quat_from_yaw(np.radians(rng.uniform(-2, 2)))

    def __call__(self, m: Measurement) -> Measurement:
        def off(x: np.ndarray, size: float) -> np.ndarray:
            return x + self.rng.uniform(-size, size, x.shape)

        return replace(
            m,
            joint_pos=off(m.joint_pos, 0.005),
            joint_vel=off(m.joint_vel, 0.05),
            v_WP=off(m.v_WP, 0.05),
            w_WP_P=off(m.w_WP_P, 0.05),
            p_WO=m.p_WO + self.shift,
            quat_WO=frames.quat_mul(self.turn, m.quat_WO),
        )


def run(trial: Trial, *, noisy: bool = True, watch=None) -> Result:
    """Plans and simulates one pick; `watch(plant, command, memory)` is called after every step."""
    rng = np.random.default_rng(trial.seed)
    p, quat = trial.position, frames.quat_from_yaw(trial.yaw_rad)
    try:
        controller = Pickup(trial.carried, Support(top_m=trial.top_m, near_m=NEAR_M), p, quat)
    except (CarryInfeasible, PickInfeasible) as error:
        return Result("not planned", str(error), 0.0, 0, 0)
    model = builder.build_model(trial.carried, table(trial), wrist_pos=controller.planner.wrist_pos)
    palms = [model.geom(f"{s}_palm_{i}").id for s in ("left", "right") for i in range(4)]
    model.geom_friction[[*palms, model.geom("object").id], 0] = trial.friction
    plant = TorquePlant(model)
    q = controller.start_q
    robot, thing = in_world(trial.stance, q[:3], np.roll(q[3:7], 1)), in_world(trial.stance, p, quat)
    qpos = np.concatenate([*robot, q[7:], *thing])
    see = Noise(rng) if noisy else lambda m: m
    if noisy:
        qpos[7:27] += rng.uniform(-0.01, 0.01, 20)
    plant.reset(qpos)
    measurement = plant.measure()
    memory = controller.start(see(measurement))
    held_s, command = 0.0, None
    steps = max(round(1.0 / controller.rate_hz / model.opt.timestep), 1)
    while plant.data.time < LIMIT_S:
        command, memory = controller.step(memory, see(measurement))
        plant.step(command.torque, steps)
        measurement = plant.measure()
        if watch is not None:
            watch(plant, command, memory)
        if measurement.p_WP[2] < 0.25 or not measurement.finite():
            return Result("fell", f"in {command.phase}", plant.data.time, command.faults, memory.attempt)
        if command.phase == "abort":
            break
        if command.phase == "hold":
            held_s += steps * model.opt.timestep
            away, turned = off_carry(controller, plant, memory.stance.measurement(measurement), memory.stance)
            if held_s >= HELD_S:
                good = away < OFF_M and turned < OFF_RAD
                detail = f"{100 * away:.1f} cm and {np.degrees(turned):.0f} deg off"
                return Result(
                    "" if good else "not in the carry state", detail, plant.data.time, command.faults, memory.attempt
                )
    why = memory.failure or f"stuck in {command.phase}"
    return Result(why.split(",")[0].split(" of ")[0], why, plant.data.time, command.faults, memory.attempt)


def off_carry(controller: Pickup, plant: TorquePlant, m: Measurement, stance: Stance) -> tuple[float, float]:
    """Distance [m] and turn [rad] of the object from its place in the carry state, seen from the middle of the feet.

    `m`: measured in the frame of the stance.
    """
    feet = stance.point(np.mean([plant.data.body(f"{s}_ankle_roll_link").xpos for s in ("left", "right")], axis=0))
    want = controller.carry.object_pos_W
    away = m.p_WO - [feet[0] + 0.035, feet[1], 0.0] - want
    turned = 2 * np.arccos(min(1.0, abs(m.quat_WO[0]))) if controller.carried.shape == "box" else 0.0
    return float(np.linalg.norm(away)), float(turned)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shape", choices=SHAPES, default="box")
    parser.add_argument("--count", type=a_count, default=100)
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--exact", action="store_true", help="without noise")
    parser.add_argument("--only", type=from_zero, nargs="*", help="numbers of the trials to run")
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    trials = [draw(args.shape, rng) for _ in range(args.count)]
    console, results, begin = PlainConsole(width=200), [], time.perf_counter()
    chosen = args.only or range(args.count)
    for i in track(chosen, description="picking", console=console):
        result = run(trials[i], noisy=not args.exact)
        results.append(result)
        if result.cause:
            console.print(
                f"{i}: {result.cause} ({result.detail}; {result.seconds:.0f} s, attempt {result.attempts}): {trials[i]}"
            )
    good = [r for r in results if not r.cause]
    console.print(f"{args.shape}: {len(good)}/{len(results)} lifted, in the carry state and held {HELD_S:g} s")
    for cause, count in Counter(r.cause for r in results if r.cause).most_common():
        console.print(f"  {count} x {cause}")
    if good:
        console.print(
            f"  {np.mean([r.seconds for r in good]):.1f} s per pick, "
            f"{sum(r.attempts > 1 for r in good)} after a retry, "
            f"{sum(r.faults for r in results)} faults of the solver; wall {time.perf_counter() - begin:.0f} s"
        )


if __name__ == "__main__":
    main()
