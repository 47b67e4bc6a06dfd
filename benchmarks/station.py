"""What a Drake station costs beside plain MuJoCo, and how closely its two plants agree.

    python -m benchmarks.station [--seconds 8] [--rounds 7] [--controllers] [--only-step] [--json out.json]

Speed: the same policy, fields, servo and physics, once as a plain loop and once as a station, in turns in one process;
CPU time of the process, medians over rounds, and whether the states at the end are equal bit for bit. `motor`: the
motors' own servos, commands held for a control period as in training; `pd`: a servo commands torques every 2 ms.
Policy step: what percept, fields, observation and network take of one, each the tenth percentile of many calls, which
other work on the machine hardly changes; `--only-step` measures nothing else. Plants: two seconds of standing with the
box, largest distance between the pelvises. Controllers (`--controllers`): pick-up and walk, simulated seconds per
second.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from pydrake.systems.analysis import Simulator
from rich.table import Table

from benchmarks.arguments import a_count
from hotice.console import PlainConsole
from hotice.files import write_text
from hotice.model import g1, load_scene
from hotice.model.joint_limits import torque_limits
from hotice.policy import Carrying, PerceptModel, observe, read_fields
from hotice.policy.action import next_action
from hotice.policy.observation import remember
from hotice.systems import Station, StationConfig, make_station
from hotice.systems.joint_pd import pd_torque
from hotice.systems.state_adaptor import robot_state_of_mujoco
from hotice.task import history

SPEED_BAR, REAL_TIME_BAR, PELVIS_BAR_M = 0.85, 1.0, 0.05


class PlainLoop:
    """The station's policy and servo around `mj_step`, without Drake."""

    def __init__(self, station: Station) -> None:
        self.station, self.model = station, station.setup.model()
        self.data = mujoco.MjData(self.model)
        self.percept = PerceptModel(station.carry.carried)
        self.carrying = Carrying.of(station.carry)
        self.kp, self.kd = g1.gains()
        self.limit, self.scale = torque_limits(g1.ACTION_JOINTS), station.task.action_scale

    def run(self, seconds: float) -> np.ndarray:
        """From the start; returns qpos."""
        station, task, model, data, carry = self.station, self.station.task, self.model, self.data, self.station.carry
        mujoco.mj_resetData(model, data)
        data.qpos[:] = station.start_qpos
        action, phase, step = np.zeros(20), 0.0, 2.0 * np.pi * task.gait_hz * task.control_dt_s
        past, substeps = np.zeros(task.history * history.FRAME), round(task.control_dt_s / station.physics_dt_s)
        for _ in range(round(seconds / task.control_dt_s)):
            state = robot_state_of_mujoco(np.concatenate([data.qpos, data.qvel]), carry.wrist_pos)
            percept = self.percept(state[:43], state[43:])
            reading = read_fields(station.pf, percept, task)
            observation = observe(percept, reading, self.carrying, action, phase, task.scan, past)
            past = remember(past, observation)
            action = next_action(station.policy.run(observation[None])[0].astype(float), task.action_limit)
            phase = (phase + step) % (2.0 * np.pi)
            target = carry.joint_target + self.scale * action
            if not station.motors:
                data.ctrl[:] = target
                mujoco.mj_step(model, data, substeps)
                continue
            for _ in range(substeps):
                data.ctrl[:] = pd_torque(target, data.qpos[7:27], data.qvel[6:26], self.kp, self.kd, self.limit)
                mujoco.mj_step(model, data)
        return data.qpos.copy()


def cpu_s(function: Any) -> tuple[float, Any]:
    begin = time.process_time()
    result = function()
    return time.process_time() - begin, result


def speed(name: str, config: StationConfig, seconds: float, rounds: int) -> dict[str, Any]:
    station = make_station(config)
    plain, simulator = PlainLoop(station), Simulator(station)
    start = simulator.get_context().Clone()
    plant = station.GetSubsystemByName("plant")

    def drake() -> np.ndarray:
        simulator.AdvanceTo(seconds)
        return plant.GetOutputPort("state").Eval(plant.GetMyContextFromRoot(simulator.get_context()))[: plant.nq].copy()

    times, equal = [], True
    for k in range(rounds + 1):
        simulator.reset_context(start.Clone())
        simulator.Initialize()
        (a, q_plain), (b, q_drake) = cpu_s(lambda: plain.run(seconds)), cpu_s(drake)
        equal &= bool(np.array_equal(q_plain, q_drake))
        if k:  # the first round warms up
            times.append((a, b))
    a, b = np.median(times, axis=0)
    return {
        "station": name,
        "physics_dt_s": station.physics_dt_s,
        "plain_x": seconds / a,
        "station_x": seconds / b,
        "share": float(np.median([x / y for x, y in times])),
        "bitwise": equal,
    }


def policy_step(calls: int = 6000) -> dict[str, float]:
    """Time of the parts of a policy step [us], at the start of the default station."""
    station = make_station(StationConfig())
    task, carry, measure = station.task, station.carry, PerceptModel(station.carry.carried)
    carrying, action, past = Carrying.of(carry), np.zeros(20), np.zeros(station.task.history * history.FRAME)
    state = robot_state_of_mujoco(np.concatenate([station.start_qpos, np.zeros(32)]), carry.wrist_pos)
    times = np.empty((calls, 5))
    for row in times:
        row[0] = time.perf_counter()
        percept = measure(state[:43], state[43:])
        row[1] = time.perf_counter()
        reading = read_fields(station.pf, percept, task)
        row[2] = time.perf_counter()
        observation = observe(percept, reading, carrying, action, 0.3, task.scan, past)
        row[3] = time.perf_counter()
        station.policy.run(observation[None])
        row[4] = time.perf_counter()
    took = 1e6 * np.diff(times[calls // 10 :], axis=1)
    parts = np.percentile(took, 10, axis=0).tolist()
    whole = float(np.percentile(took.sum(axis=1), 10))
    return {**dict(zip(("percept", "fields", "observation", "network"), parts, strict=True)), "whole": whole}


def environment(seconds: float) -> float:
    """Speed of the training environment with one robot and the same policy."""
    import torch

    from hotice.learn import load_policy
    from hotice.sim import TaskConfig, TransportEnv

    torch.set_num_threads(1)
    config = StationConfig()
    policy = load_policy(config.policy, threads=1)
    task = TaskConfig(**{name: policy.meta["task"].get(name, 0) for name in ("scan", "history")})
    env = TransportEnv(1, [load_scene(config.scene)], config.carried, threads=1, config=task)
    obs, _ = env.reset()

    def run(steps: int) -> None:
        nonlocal obs
        for _ in range(steps):
            obs = env.step(policy.act(obs)).policy

    run(10)
    steps = round(seconds / env.config.control_dt_s)
    return seconds / cpu_s(lambda: run(steps))[0]


def pelvis(plant: str, config: StationConfig, seconds: float = 2.0) -> tuple[np.ndarray, float]:
    """Pelvis (T, 3) at 50 Hz of a station that stands with the box, and its speed."""
    station = make_station(config, plant=plant, controller="hold")
    simulator = Simulator(station)
    adaptor = station.GetSubsystemByName("state_adaptor")
    context = adaptor.GetMyContextFromRoot(simulator.get_context())
    rows, begin = [], time.process_time()
    for k in range(round(50 * seconds) + 1):
        simulator.AdvanceTo(0.02 * k)
        rows.append(adaptor.GetOutputPort("robot_state").Eval(context)[:3].copy())
    return np.array(rows), seconds / (time.process_time() - begin)


def plants() -> list[dict[str, Any]]:
    rows = []
    for servo in ("motor", "pd"):
        (a, a_x), (b, b_x) = (pelvis(plant, StationConfig(servo=servo)) for plant in ("mujoco", "drake"))
        apart = float(np.linalg.norm(a - b, axis=1).max())
        rows.append({"servo": servo, "apart_m": apart, "mujoco_x": a_x, "drake_x": b_x})
    return rows


def controllers() -> list[dict[str, Any]]:
    rows = []
    for name, seconds in (("pickup", 12.0), ("walk", 6.0)):
        station = make_station(StationConfig(), controller=name)
        simulator = Simulator(station)
        simulator.AdvanceTo(0.1)  # compiles and plans
        spent, _ = cpu_s(lambda s=simulator, t=seconds: s.AdvanceTo(t + 0.1))
        system = station.GetSubsystemByName(name)
        state = system.GetMyContextFromRoot(simulator.get_context())
        phase = system.phases[int(system.GetOutputPort("phase").Eval(state)[0])]
        rows.append({"controller": name, "seconds": seconds, "x": seconds / spent, "phase": phase})
    return rows


def mark(good: bool) -> str:
    return "yes" if good else "NO"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=8.0, help="simulated in each run")
    parser.add_argument("--rounds", type=a_count, default=7)
    parser.add_argument("--controllers", action="store_true", help="also pick-up and walk")
    parser.add_argument("--only-step", action="store_true", help="the time of a policy step's parts, nothing else")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    console = PlainConsole(width=None if PlainConsole().is_terminal else 120)
    step = policy_step()
    console.print("policy step: " + ", ".join(f"{part} {us:.1f} us" for part, us in step.items()))
    if args.only_step:
        if args.json is not None:
            write_text(args.json, json.dumps({"policy_step_us": step}, indent=1) + "\n")
        return
    runs = {
        "policy, motor": StationConfig(),
        "policy, motor, beam": StationConfig(scene="beam"),
        "policy, motor, 2 ms": StationConfig(physics_dt_s=0.002),
        "policy, motor, 2 ms, elliptic": StationConfig(physics_dt_s=0.002, elliptic=True),
        "policy, pd": StationConfig(servo="pd"),
    }
    report: dict[str, Any] = {
        "policy_step_us": step,
        "speed": [speed(name, c, args.seconds, args.rounds) for name, c in runs.items()],
    }
    table = Table(title=f"Plain MuJoCo and the station: {args.seconds:g} s, {args.rounds} rounds, CPU time")
    for column in ("station", "step", "plain", "station", "share", f"≥ {SPEED_BAR}", "bitwise"):
        table.add_column(column, justify="right")
    for r in report["speed"]:
        table.add_row(
            r["station"],
            f"{1e3 * r['physics_dt_s']:g} ms",
            f"{r['plain_x']:.1f}×",
            f"{r['station_x']:.1f}×",
            f"{r['share']:.2f}",
            mark(r["share"] >= SPEED_BAR),
            mark(r["bitwise"]),
        )
    console.print(table)
    report["environment_x"] = environment(args.seconds)
    console.print(f"the training environment with one robot: {report['environment_x']:.1f}×")
    report["plants"] = plants()
    table = Table(title="Two seconds of standing with the box")
    for column in ("servo", "pelvises apart", f"≤ {100 * PELVIS_BAR_M:g} cm", "MuJoCo", "Drake"):
        table.add_column(column, justify="right")
    for r in report["plants"]:
        good = mark(r["apart_m"] <= PELVIS_BAR_M)
        table.add_row(r["servo"], f"{1e3 * r['apart_m']:.1f} mm", good, f"{r['mujoco_x']:.1f}×", f"{r['drake_x']:.1f}×")
    console.print(table)
    if args.controllers:
        report["controllers"] = controllers()
        table = Table(title="Controllers in a station, MuJoCo plant")
        for column in ("controller", "simulated", "speed", f"≥ {REAL_TIME_BAR:g}×", "phase at the end"):
            table.add_column(column, justify="right")
        for r in report["controllers"]:
            table.add_row(
                r["controller"], f"{r['seconds']:g} s", f"{r['x']:.1f}×", mark(r["x"] >= REAL_TIME_BAR), r["phase"]
            )
        console.print(table)
    if args.json is not None:
        write_text(args.json, json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
