"""Ways to stop a robot that cannot go on, compared in plain MuJoCo from the same moments of carrying.

    python -m benchmarks.stopping [--moments 6] [--json out.json]

Moments: a walking policy gives up (at several times of a carry, both feet and one); a robot that stood or walked and
was pushed over leans by 60 degrees, or is seen falling before (`hotice.safety`, fault FALLING). From each the joints
are stopped in each way, in steps of 2 ms, motors as implicit actuators. Earlier: time from FALLING to 60 degrees [s].
Largest joint speed: over all joints, in the 100 ms before the stop, in the 100 ms after it and later. Sinking: of the
pelvis, as it passes 0.45 m. Torque: largest share of a motor's limit. Box: kept for a second.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from pydrake.systems.analysis import Simulator
from rich.table import Table

from benchmarks.arguments import a_count
from hotice.console import PlainConsole
from hotice.files import write_text
from hotice.model import g1
from hotice.safety import MeasurementLimits
from hotice.safety.judge import lean_ahead
from hotice.safety.limits import AHEAD_S, FALLING_S
from hotice.systems import SafetyLimits, Station, StationConfig, make_station
from hotice.task.rules import APART_M, UPRIGHT

DT_S, WATCHED_S, LOW_M = 0.002, 2.0, 0.45
CONTROL_DT_S, PUSH_M_S = 0.02, {"hold": 2.5, "policy": 3.0}
ARMS = np.array([any(part in joint for part in ("shoulder", "elbow")) for joint in g1.ACTION_JOINTS])


@dataclass(frozen=True)
class Way:
    """kp as a share of the trained one and kd [N m s/rad] of legs and waist, and how long the arms hold [s].

    `follows`: targets are where the joints are, every 20 ms; else those of the carry state. `kd` None: trained.
    """

    stiffness: float
    kd: float | None
    arms_s: float = 0.0
    follows: bool = False


WAYS = {
    "kp, kd at q, every 20 ms": Way(1.0, None, follows=True),
    "hold the posture": Way(1.0, None),
    "limp": Way(0.0, 0.0),
    "kp 0, trained kd": Way(0.0, None),
    "kp 0, kd 3": Way(0.0, 3.0),
    "kp 0, kd 8": Way(0.0, 8.0),
    "kp 0, kd 16": Way(0.0, 16.0),
    "kp 0, kd 8, arms hold 0.3 s": Way(0.0, 8.0, arms_s=0.3),
    "kp 0, kd 8, arms hold 1 s": Way(0.0, 8.0, arms_s=1.0),
}


def stop(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, target: np.ndarray, way: Way) -> dict[str, float]:
    """Figures of one stop from a moment; see the module."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    kp, kd = g1.gains()
    force, speed, sinking, apart = model.actuator_forcerange[:, 1], [], np.nan, 0.0
    hands = [model.site(name).id for name in g1.OGF_KEYPOINTS]
    share = 0.0
    for k in range(round(WATCHED_S / DT_S)):
        hold = ARMS & (k * DT_S < way.arms_s)
        stiff = kp * np.where(hold, 1.0, way.stiffness)
        damped = kd if way.kd is None else np.where(hold, kd, way.kd)
        model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = (
            stiff,
            -stiff,
            -damped,
        )
        if not way.follows or not k % 10:
            data.ctrl[:] = data.qpos[g1.JOINT_POS] if way.follows else target
        mujoco.mj_step(model, data)
        speed.append(np.abs(data.qvel[g1.JOINT_VEL]).max())
        share = max(share, float((np.abs(data.actuator_force) / force).max()))
        if np.isnan(sinking) and data.qpos[2] < LOW_M:
            sinking = -data.qvel[2]
        if k * DT_S < 1.0:
            apart = max(apart, float(np.linalg.norm(data.qpos[27:30] - data.site_xpos[hands].mean(axis=0))))
    ten = round(0.1 / DT_S)
    return {
        "soon": max(speed[:ten]),
        "at_100_ms": max(speed[ten - 10 : ten]),
        "later": max(speed[ten:]),
        "sinking": sinking,
        "torque": share,
        "kept": float(apart < APART_M),
        "down": float(data.qpos[2] < LOW_M),
    }


@dataclass(frozen=True)
class Moment:
    """A state in which a robot is stopped: kind, qpos and qvel, largest joint speed of the 100 ms before [rad/s].

    `earlier`: time until it leans by 60 degrees when nothing stops it [s]; NaN: it walks.
    """

    kind: str
    station: Station
    qpos: np.ndarray
    qvel: np.ndarray
    before: float
    earlier: float = np.nan


class Watched:
    """A station in steps of 10 ms, with the joint speeds of the last 100 ms."""

    def __init__(self, controller: str, seed: int) -> None:
        # nothing of the station's own stops it
        never = SafetyLimits(tilt_rad=np.pi, falling_rad=np.pi, gyro_rad_s=99.0, joint_speed_rad_s=99.0)
        config = StationConfig(seed=seed, physics_dt_s=DT_S, safety=never)
        self.station, self.time_s, self.speeds = make_station(config, controller=controller), 0.0, [0.0]
        self.simulator, self.plant = Simulator(self.station), self.station.GetSubsystemByName("plant")
        self.context = self.plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())

    def advance(self, until_s: float) -> tuple[np.ndarray, np.ndarray]:
        while self.time_s < until_s - 1e-9:
            self.time_s += 0.01
            self.simulator.AdvanceTo(self.time_s)
            self.speeds.append(np.abs(self.state()[1][g1.JOINT_VEL]).max())
        return self.state()

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        qpos, qvel = np.split(self.plant.GetOutputPort("state").Eval(self.context).copy(), [self.plant.nq])
        return qpos, qvel

    def moment(self, kind: str) -> Moment:
        return Moment(kind, self.station, *self.state(), max(self.speeds[-10:]))

    def push(self, size_m_s: float, angle_rad: float) -> None:
        qpos, qvel = self.state()
        qvel[:2] += size_m_s * np.array([np.cos(angle_rad), np.sin(angle_rad)])
        self.plant.set_state(self.context, qpos, qvel)


def walking(number: int) -> list[Moment]:
    """Moments of a carry in which the policy gives up."""
    found = []
    for k in range(number):
        watched = Watched("policy", k)
        watched.advance(0.5 + 0.13 * k)
        found.append(watched.moment("walking"))
    return found


def pushed_over(controller: str, number: int) -> list[Moment]:
    """Moments of falls: when FALLING would be answered, and at 60 degrees; other pushes are left out."""
    found, name = [], {"hold": "standing", "policy": "walking"}[controller]
    for k in range(number):
        watched = Watched(controller, k)
        watched.advance(0.02 if controller == "hold" else 0.5 + 0.13 * k)
        watched.push(PUSH_M_S[controller], 2.0 * np.pi * k / number)
        since, seen, begun = np.inf, None, watched.time_s
        while watched.time_s < begun + 3.0:
            qpos, qvel = watched.advance(watched.time_s + CONTROL_DT_S)
            falls = lean_ahead(qpos[3:7], qvel[3:6], AHEAD_S) > MeasurementLimits.falling_rad
            since = min(since, watched.time_s) if falls else np.inf
            if seen is None and watched.time_s - since >= FALLING_S - 1e-9:
                seen = watched.moment(f"{name}, falling"), watched.time_s
            if 1.0 - 2.0 * (qpos[4] ** 2 + qpos[5] ** 2) < UPRIGHT:
                leaning = replace(watched.moment(f"{name}, 60 degrees"), earlier=0.0)
                first = seen or (replace(leaning, kind=f"{name}, falling"), watched.time_s)
                found += [replace(first[0], earlier=watched.time_s - first[1]), leaning]
                break
    return found


def _mean(values: list[float]) -> float:
    known = [v for v in values if np.isfinite(v)]
    return float(np.mean(known)) if known else np.nan


def main() -> None:
    """Prints the table; writes it as JSON where asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--moments", type=a_count, default=6)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    rows: dict[str, dict[str, dict[str, float]]] = {}
    moments = [*walking(args.moments), *pushed_over("hold", args.moments), *pushed_over("policy", args.moments)]
    for m in moments:
        for name, way in WAYS.items():
            figures = stop(m.station.setup.model(), m.qpos, m.qvel, m.station.carry.joint_target, way)
            figures |= {"before": m.before, "earlier": m.earlier}
            rows.setdefault(m.kind, {}).setdefault(name, []).append(figures)  # type: ignore[attr-defined]
    for kind, ways in rows.items():
        table = Table(
            "way",
            "speed before",
            "0 to 100 ms",
            "80 to 100 ms",
            "later",
            "sinking",
            "torque",
            "box",
            "down",
            "earlier",
            title=f"{kind}: {len(next(iter(ways.values())))} moments",
        )
        for name, runs in ways.items():
            mean = {key: _mean([r[key] for r in runs]) for key in runs[0]}  # type: ignore[index]
            ways[name] = mean
            table.add_row(
                name,
                *(
                    f"{mean[k]:.2f}"
                    for k in ("before", "soon", "at_100_ms", "later", "sinking", "torque", "kept", "down", "earlier")
                ),
            )
        PlainConsole(width=140).print(table)
    if args.json:
        write_text(args.json, json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
