"""Ways to stop a robot that cannot go on, compared in plain MuJoCo from the same moments of carrying.

    python -m benchmarks.stopping [--moments 6] [--json out.json]

Moments: a walking policy gives up (at several times of a carry, both feet and one), and a robot that was pushed over
leans by 57 degrees. From each the joints are stopped in each way, in steps of 2 ms, motors as implicit actuators.
Largest joint speed: over all joints, in the 100 ms before the stop, in the 100 ms after it and later. Sinking: of the
pelvis, as it passes 0.45 m. Torque: largest share of a motor's limit. Box: kept for a second.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from pydrake.systems.analysis import Simulator
from rich.table import Table

from benchmarks.arguments import a_count
from hotice.console import PlainConsole
from hotice.files import write_text
from hotice.model import g1
from hotice.systems import StationConfig, make_station
from hotice.task.rules import APART_M

DT_S, WATCHED_S, LOW_M = 0.002, 2.0, 0.45
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


def moments(number: int) -> list[tuple[str, object, np.ndarray, np.ndarray, float]]:
    """Kind, station, qpos, qvel and largest joint speed of the 100 ms before."""
    found = []
    for kind in ("walking", "pushed"):
        for k in range(number):
            walking = kind == "walking"
            station = make_station(StationConfig(seed=k, physics_dt_s=DT_S), controller="policy" if walking else "hold")
            simulator = Simulator(station)
            plant = station.GetSubsystemByName("plant")
            context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
            if not walking:
                qvel, angle = np.zeros(plant.nv), 2.0 * np.pi * k / number
                qvel[:2] = 2.5 * np.cos(angle), 2.5 * np.sin(angle)
                plant.set_state(context, station.start_qpos, qvel)
            before, time_s = [], 0.0
            end = 0.5 + 0.13 * k if walking else 2.0
            while time_s < end - 1e-9:
                time_s += 0.01
                simulator.AdvanceTo(time_s)
                qpos, qvel = np.split(plant.GetOutputPort("state").Eval(context).copy(), [plant.nq])
                before.append(np.abs(qvel[g1.JOINT_VEL]).max())
                if not walking and 1.0 - 2.0 * (qpos[4] ** 2 + qpos[5] ** 2) < np.cos(1.0):
                    break
            found.append((kind, station, qpos, qvel, max(before[-10:])))
    return found


def main() -> None:
    """Prints the table; writes it as JSON where asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--moments", type=a_count, default=6)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    rows: dict[str, dict[str, dict[str, float]]] = {}
    for kind, station, qpos, qvel, before in moments(args.moments):
        for name, way in WAYS.items():
            figures = stop(station.setup.model(), qpos, qvel, station.carry.joint_target, way)
            rows.setdefault(kind, {}).setdefault(name, []).append({"before": before, **figures})  # type: ignore[attr-defined]
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
            title=kind,
        )
        for name, runs in ways.items():
            mean = {key: float(np.nanmean([r[key] for r in runs])) for key in runs[0]}  # type: ignore[index]
            ways[name] = mean
            table.add_row(
                name,
                *(
                    f"{mean[k]:.2f}"
                    for k in ("before", "soon", "at_100_ms", "later", "sinking", "torque", "kept", "down")
                ),
            )
        PlainConsole(width=140).print(table)
    if args.json:
        write_text(args.json, json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
