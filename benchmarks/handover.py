"""Does the box stay in the hands when a policy takes over from the pick-up? Seeded runs of `pickup_then_policy`.

    python -m benchmarks.handover [--count 20] [--seed 0] [--policy student] [--scene open_floor]

Boxes of 0.5-3.5 kg and 20-40 cm stand on a table 0.45-0.75 m high, at a random bearing within 0.5 rad of the left or
the right of the start. Success: the pick-up hands over, and for 3 s from then on the robot stands upright with the box
in its hands. Printed for every run: who carried on, the policy or, where its rehearsal failed, the walking baseline;
failures by cause, among them runs in which neither rehearsal was safe and the pick-up went on holding.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
from pydrake.systems.analysis import Simulator

from benchmarks.arguments import a_count, a_seed, from_zero
from hotice.console import PlainConsole
from hotice.errors import HoticeError
from hotice.evaluate import success_interval
from hotice.model import CarriedObject, ObjectRange
from hotice.systems import HandOverReport, Station, StationConfig, make_station, read_logs, report_hand_over

BEYOND_S, LIMIT_S = 3.0, 40.0


@dataclass(frozen=True)
class Draw:
    """One run: the object, the top of the table [m] and its bearing [rad]."""

    carried: CarriedObject
    top_m: float
    bearing_rad: float

    def __str__(self) -> str:
        size = " x ".join(f"{200 * h:.0f}" for h in self.carried.half_extents_m)
        table = f"table {self.top_m:.2f} m at {np.degrees(self.bearing_rad):+.0f} deg"
        return f"{size} cm {self.carried.mass_kg:.1f} kg, {table}"


def draw(rng: np.random.Generator) -> Draw:
    """A box, a table, a bearing."""
    side = 1.0 if rng.random() < 0.5 else -1.0
    return Draw(ObjectRange().sample(rng), rng.uniform(0.45, 0.75), side * (np.pi / 2 + rng.uniform(-0.5, 0.5)))


def run(trial: Draw, policy: str, scene: str, beyond_s: float = BEYOND_S) -> HandOverReport:
    """Simulates until `beyond_s` after the hand-over. Raises `HoticeError` for what cannot be picked up."""
    config = StationConfig(
        scene=scene,
        policy=policy,
        carried=trial.carried,
        support_height_m=trial.top_m,
        pick_bearing_rad=trial.bearing_rad,
        support_near_m=0.24,
        log_hz=50.0,
    )
    station = make_station(config, controller="pickup_then_policy")
    simulator = Simulator(station)
    advance_beyond(station, simulator, beyond_s)
    return report_hand_over(station, read_logs(station, simulator.get_context()))


def advance_beyond(station: Station, simulator: Simulator, beyond_s: float) -> None:
    """Advances to `beyond_s` after the hand-over, or to `LIMIT_S` where there is none."""
    selector = station.GetSubsystemByName("mode_selector")
    mode, context = selector.GetOutputPort("mode"), simulator.get_context()
    while context.get_time() < LIMIT_S:
        simulator.AdvanceTo(context.get_time() + 0.1)
        if mode.Eval(selector.GetMyContextFromRoot(context))[0] > 0:
            simulator.AdvanceTo(context.get_time() + beyond_s)
            return


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=a_count, default=20)
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--policy", default="student")
    parser.add_argument("--scene", default="open_floor")
    parser.add_argument("--beyond", type=float, default=BEYOND_S, help="seconds after the hand-over")
    parser.add_argument("--only", type=from_zero, nargs="*", help="numbers of the runs to make")
    args = parser.parse_args()
    rng, console, begin = np.random.default_rng(args.seed), PlainConsole(width=160), time.perf_counter()
    draws, good, who, causes = [draw(rng) for _ in range(args.count)], 0, Counter(), Counter()
    chosen = args.only or range(args.count)
    for i in chosen:
        try:
            report = run(draws[i], args.policy, args.scene, args.beyond)
        except HoticeError as error:
            console.print(f"{i:2d}: not planned: {error}: {draws[i]}")
            causes["not planned"] += 1
            continue
        console.print(f"{i:2d}: {report}: {draws[i]}")
        who[report.who] += 1
        good += not report.failure and not report.held
        if report.failure or report.held:
            causes[report.failure or "held, neither policy nor walk being fit"] += 1
    low, high = success_interval(good, len(chosen))
    console.print(
        f"{args.policy}: {good}/{len(chosen)} kept the box through the hand-over and {args.beyond:g} s beyond "
        f"(95 %: {low:.0%} to {high:.0%}); wall {time.perf_counter() - begin:.0f} s"
    )
    for name, count in who.most_common():
        console.print(f"  {count} x carried on by {name}")
    for cause, count in causes.most_common():
        console.print(f"  {count} x {cause}")


if __name__ == "__main__":
    main()
