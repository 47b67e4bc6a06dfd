"""How fast is the environment of students, and what would make it faster? `student` carries through bench20 under
perturbations.

    python -m benchmarks.environment [--num-envs 384] [--steps 40] [--physics-dt-s 0.01] [--variant palms3]

Prints environment steps per second of one core's CPU time (policy left out), and the share that is physics. Variants
change the compiled models: they show what a contact or a setting costs, none is the default.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import mujoco

from benchmarks.arguments import a_count
from hotice.learn import load_policy
from hotice.model import builder, g1
from hotice.model.shipped import resolve_scenes
from hotice.sim import TransportEnv
from hotice.sim.physics.threads import use_threads
from hotice.task import TaskConfig

KEPT = (
    "leg_scale_rad",
    "arm_scale_rad",
    "action_limit",
    "speed_m_s",
    "stop_gain_hz",
    "gait_hz",
    "swing_height_m",
    "scan",
    "history",
)


def _without(model: mujoco.MjModel, part: str) -> None:
    for side in g1.SIDES:
        model.geom(f"{side}_{part}").conaffinity[:] = 0


def _dense(model: mujoco.MjModel) -> None:
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE


def _islands(model: mujoco.MjModel) -> None:
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ISLAND)


def _iterations(model: mujoco.MjModel) -> None:
    model.opt.iterations = 6


def _impratio(model: mujoco.MjModel) -> None:
    model.opt.impratio = 10.0


VARIANTS: dict[str, Callable[[mujoco.MjModel], None]] = {
    "palms3": lambda m: _without(m, "palm_3"),
    "soles3": lambda m: _without(m, "sole_0"),
    "dense": _dense,
    "islands": _islands,
    "iterations6": _iterations,
    "impratio10": _impratio,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num-envs", type=a_count, default=384)
    parser.add_argument("--steps", type=a_count, default=40)
    parser.add_argument("--physics-dt-s", type=float, default=0.005)
    parser.add_argument("--variant", choices=VARIANTS, nargs="*", default=[])
    args = parser.parse_args()
    use_threads(1)
    build = builder.build_model

    def changed(*given, **options) -> mujoco.MjModel:
        model = build(*given, **options)
        for name in args.variant:
            VARIANTS[name](model)
        return model

    builder.build_model = changed
    policy = load_policy("student", threads=1)
    task = TaskConfig(
        **{k: v for k, v in policy.meta["task"].items() if k in KEPT},
        physics_dt_s=args.physics_dt_s,
        substeps=round(0.02 / args.physics_dt_s),
    )
    task = replace(task.perturbed(), goal_stay_s=0.4)
    env = TransportEnv(args.num_envs, resolve_scenes(("bench20",)), config=task, seed=1, threads=1)
    spent = {"physics": 0.0, "environment": 0.0}
    physics = env.physics.step

    def timed(*given, **options) -> None:
        begin = time.process_time()
        physics(*given, **options)
        spent["physics"] += time.process_time() - begin

    env.physics.step = timed
    obs, _ = env.reset()
    for k in range(2 * args.steps):  # the first half warms up: robots begin to walk
        if k == args.steps:
            spent |= dict.fromkeys(spent, 0.0)
        action = policy.act(obs)
        begin = time.process_time()
        obs = env.step(action).policy
        spent["environment"] += time.process_time() - begin
    count = args.num_envs * args.steps
    print(
        f"{1e3 * args.physics_dt_s:g} ms {' '.join(args.variant) or 'as it is'}: "
        f"{count / spent['environment']:.0f} environment steps/s of one core, "
        f"{1e6 * spent['physics'] / count:.0f} of {1e6 * spent['environment'] / count:.0f} µs are physics"
    )


if __name__ == "__main__":
    main()
