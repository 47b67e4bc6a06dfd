"""Throughput at several sizes: training, environment and bare physics in steps a second, and where the time goes."""

from __future__ import annotations

import contextlib
import json
import resource
import time
from collections.abc import Callable
from typing import Any

import torch

from hotice.commands.line.benchmark_config import BENCHMARK_BLOCK, BenchmarkConfig
from hotice.commands.stopwatch import Stopwatch
from hotice.files import check_writable, write_text
from hotice.learn.train.runner import Runner
from hotice.progress import lines
from hotice.sim.physics.ram import check_memory
from hotice.version import source_version

FORMAT = "hotice-benchmark/1"
SHARES = ("physics", "fields", "rewards and observations", "acting", "learning", "other")


def benchmark(config: BenchmarkConfig) -> dict[str, Any]:
    """Measures every size, prints a table as it grows, writes the report; returns it. Raises `HoticeError`."""
    from rich.live import Live

    from hotice.console import PlainConsole

    if config.out is not None:
        check_writable(config.out)
    if config.physics == "mujoco":
        check_memory(max(config.num_envs))
    sizes: list[dict[str, Any]] = []
    result: dict[str, Any] = {
        "format": FORMAT,
        "physics": config.physics,
        "preset": config.preset,
        "scan": config.scan,
        "history": config.history,
        "perturbed": config.perturbed,
        "source": source_version(),
    }
    console = PlainConsole(width=None if PlainConsole().is_terminal else 150)
    silent = PlainConsole(stderr=True).is_terminal
    told = contextlib.nullcontext() if silent else lines(lambda: f"{len(sizes)} of {len(config.num_envs)} sizes")
    with told, Live(_table(sizes, config), console=console, auto_refresh=False) as live:
        for num_envs in config.num_envs:
            runner = Runner(config.training(num_envs))
            result |= _machine(runner.env.device, config)
            sizes.append(measure(runner, config.updates, config.steps))
            live.update(_table(sizes, config), refresh=True)
    result["sizes"] = sizes
    if config.out is not None:
        write_text(config.out, json.dumps(result, indent=1) + "\n")
    return result


def measure(runner: Runner, updates: int, steps: int) -> dict[str, Any]:
    """Steps a second of training, environment and bare physics, and the shares of the time of training.

    Throughput is measured undisturbed; the shares in further updates, in which a GPU is waited for at every change of
    label, so that they are exact and their sum is slower.
    """
    env = runner.env
    wait = _waiting(env.device)
    runner.learn_once()  # compiles kernels and graphs
    per_update = env.num_envs * runner.config.ppo.steps
    training = per_update * updates / _seconds(wait, lambda: [runner.learn_once() for _ in range(updates)])
    environment, physics = _environment_and_physics(runner, steps, wait)
    return {
        "num_envs": env.num_envs,
        "training_steps_per_s": training,
        "environment_steps_per_s": environment,
        "physics_steps_per_s": physics,
        "ratio": environment / physics,
        "shares": _shares(runner, updates, wait),
        "peak_memory_gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
        **_device_memory(env.device),
    }


def _environment_and_physics(runner: Runner, steps: int, wait: Callable[[], None]) -> tuple[float, float]:
    """Control steps a second of the environment under random actions, and of its physics from the same states.

    After each block the physics goes back to the state before it and gets the same servo targets once more: both solve
    the same contacts, but that fallen robots stay on the floor in bare physics, and that targets are never late there.
    """
    env, seconds = runner.env, [0.0, 0.0]
    generator = torch.Generator(env.device).manual_seed(0)
    blocks = -(-steps // BENCHMARK_BLOCK)
    for _ in range(BENCHMARK_BLOCK):  # compiles what only restarts need
        env.step(0.3 * torch.randn((env.num_envs, env.num_actions), generator=generator, device=env.device))
    for _ in range(blocks):
        before = env.physics.state()
        shape = (env.num_envs, env.num_actions)
        actions = [0.3 * torch.randn(shape, generator=generator, device=env.device) for _ in range(BENCHMARK_BLOCK)]
        models = env.memory.model.clone()
        seconds[0] += _seconds(wait, lambda actions=actions: [env.step(a) for a in actions])
        after = env.physics.state()
        env.physics.load_state(before)
        targets = [(env.carry.target[models] + env.action_scale * a).to(env.physics.ctrl.dtype) for a in actions]

        def bare(targets: list[torch.Tensor] = targets) -> None:
            for target in targets:
                env.physics.ctrl[:] = target
                env.physics.step(env.config.substeps)

        seconds[1] += _seconds(wait, bare)
        env.physics.load_state(after)
    environment, physics = (blocks * BENCHMARK_BLOCK * env.num_envs / s for s in seconds)
    return environment, physics


def _shares(runner: Runner, updates: int, wait: Callable[[], None]) -> dict[str, float]:
    """Shares of the time of training, by label. The runner stays instrumented."""
    env, watch = runner.env, Stopwatch(wait)
    for name in ("step", "forward"):
        watch.watch(env.physics, name, "physics")
    for name in ("sample", "signed_distance", "lowest_clearance"):
        watch.watch(env.bank, name, "fields")
    for owner, name in ((env, "rewards"), (env, "policy_table"), (env, "critic_table"), (env.sensors, "measure")):
        watch.watch(owner, name, "rewards and observations")
    watch.watch(runner, "_act", "acting")
    watch.watch(runner.algo, "update", "learning")
    total = _seconds(wait, watch.timed(lambda: [runner.learn_once() for _ in range(updates)], "other"))
    return {label: watch.seconds.get(label, 0.0) / total for label in SHARES}


def _seconds(wait: Callable[[], None], work: Callable[[], object]) -> float:
    wait()
    begin = time.perf_counter()
    work()
    wait()
    return time.perf_counter() - begin


def _waiting(device: torch.device) -> Callable[[], None]:
    if device.type == "cuda":
        return lambda: torch.cuda.synchronize(device)
    return lambda: None


def _machine(device: torch.device, config: BenchmarkConfig) -> dict[str, Any]:
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else f"CPU, {config.threads} threads"
    return {"device": str(device), "machine": name}


def _device_memory(device: torch.device) -> dict[str, float]:
    """Memory in use on a GPU, by everyone: MuJoCo Warp allocates beside torch."""
    if device.type != "cuda":
        return {}
    free, total = torch.cuda.mem_get_info(device)
    return {"device_memory_gib": (total - free) / 2**30}


def _table(sizes: list[dict[str, Any]], config: BenchmarkConfig):
    from rich.table import Table

    further = {"scan": config.scan, f"history {config.history}": config.history, "perturbed": config.perturbed}
    task = (config.preset, *(name for name, given in further.items() if given))
    step = config.training(config.num_envs[0]).task
    steps = f"control steps of {step.substeps} x {1e3 * step.physics_dt_s:g} ms"
    table = Table(title=f"physics {config.physics}, {', '.join(task)}, {steps}, steps/s")
    names = ("environments", "training", "environment", "physics", "ratio", *SHARES, "memory [GiB]")
    for name in names:
        table.add_column(name, justify="right")
    for row in sizes:
        rates = (row[f"{kind}_steps_per_s"] for kind in ("training", "environment", "physics"))
        table.add_row(
            f"{row['num_envs']:,}",
            *(f"{rate:,.0f}" for rate in rates),
            f"{row['ratio']:.2f}",
            *(f"{row['shares'][label]:.0%}" for label in SHARES),
            f"{row.get('device_memory_gib', row['peak_memory_gib']):.2f}",
        )
    return table
