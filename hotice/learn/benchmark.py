"""Throughput: environment steps a second beside bare physics of the same model and states, in one run."""

from __future__ import annotations

import json
import resource
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from hotice.errors import InvalidConfig
from hotice.files import write_text
from hotice.learn.evaluate import check_writable
from hotice.learn.scene_sets import resolve_scenes
from hotice.sim.env import TransportEnv
from hotice.sim.mujoco_batch import MujocoBatch
from hotice.sim.threads import use_threads


@dataclass(frozen=True, kw_only=True)
class BenchmarkConfig:
    """One benchmark."""

    num_envs: int = 1024
    """Parallel environments."""
    steps: int = 50
    """Control steps that are timed, in blocks of ten that alternate between environment and bare physics."""
    threads: int = 2
    """Threads of physics, fields and torch."""
    scenes: tuple[str, ...] = ("pipe", "gap", "pillars", "table_edge", "beam")
    """Scenes."""
    preset: str = "dual_hodpf"
    """Row of Table I."""
    physics: str = "mujoco"
    """Physics backend."""
    out: Path | None = None
    """Report file (JSON)."""

    def __post_init__(self) -> None:
        if self.steps < 10 or self.num_envs < 1 or self.threads < 1:
            raise InvalidConfig("benchmark needs at least 10 steps, 1 environment and 1 thread")


def benchmark(config: BenchmarkConfig) -> dict[str, Any]:
    """Times full environment steps and bare physics steps from the same states; prints and returns the result.

    Both simulations hold the same models; before each block the bare one takes the states of the environment and then gets
    the same servo targets, so both solve the same contacts.
    """
    from rich.console import Console
    from rich.table import Table

    if config.out is not None:
        check_writable(config.out)
    use_threads(config.threads)
    env = TransportEnv(
        config.num_envs, resolve_scenes(config.scenes), preset=config.preset, physics=config.physics, seed=0,
        threads=config.threads,
    )  # fmt: skip
    bare = MujocoBatch(env.carry.models, config.num_envs, config.threads)
    bare.set_models(torch.arange(config.num_envs), env.memory.model)
    generator = torch.Generator().manual_seed(0)
    env.reset()
    for _ in range(10):
        env.step(0.3 * torch.randn(config.num_envs, 20, generator=generator))
    seconds = {"environment": 0.0, "physics": 0.0}
    done = 0
    while done < config.steps:
        bare.load_state(env.physics.state())
        actions = [0.3 * torch.randn(config.num_envs, 20, generator=generator) for _ in range(10)]
        targets = []
        begin = time.perf_counter()
        for action in actions:
            env.step(action)
        seconds["environment"] += time.perf_counter() - begin
        targets = [env.carry.target[env.memory.model] + env.action_scale * a for a in actions]
        begin = time.perf_counter()
        for target in targets:
            bare.ctrl[:] = target.double()
            bare.step(env.config.substeps)
        seconds["physics"] += time.perf_counter() - begin
        done += len(actions)
    rate = {k: done * config.num_envs / v for k, v in seconds.items()}
    result = {
        "num_envs": config.num_envs, "threads": config.threads, "control_steps": done,
        "environment_steps_per_s": rate["environment"], "physics_steps_per_s": rate["physics"],
        "ratio": rate["environment"] / rate["physics"],
        "peak_memory_gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }  # fmt: skip
    table = Table(title=f"{config.num_envs} environments, {config.threads} threads, control steps of 4 x 5 ms")
    table.add_column("what")
    table.add_column("value", justify="right")
    table.add_row("environment, steps/s", f"{rate['environment']:,.0f}")
    table.add_row("bare physics, steps/s", f"{rate['physics']:,.0f}")
    table.add_row("ratio", f"{result['ratio']:.2f}")
    table.add_row("peak memory, GiB (both simulations)", f"{result['peak_memory_gib']:.2f}")
    Console().print(table)
    if config.out is not None:
        write_text(config.out, json.dumps(result, indent=1) + "\n")
    return result
