"""How often does a planned pick-up succeed that is only played back? In the physics of the protocol `robot`.

    python -m benchmarks.playback --picks picks.npz [--shape box] [--count 50] [--exact]

Each pick of a book (`hotice pickup plan`) is played once by `hotice.control.playback.Player`: joint targets at 50 Hz,
no forces, no QP. Perturbed: a robot of the protocol's dynamics for each, its encoders' zeros off, late motors; joints
± 0.03 rad, gravity ± 0.05 and gyro ± 0.2 rad/s wrong at every step, the object up to 1 cm and 2 degrees from where the
plan has it. `--exact`: the nominal robot, no noise. Success: in the carry state for 5 s (`hotice.task.rules`).
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from rich.progress import track

from benchmarks.arguments import a_count, a_seed
from hotice.control.playback import Player
from hotice.errors import HoticeError, InvalidState
from hotice.evaluate.trials import success_interval
from hotice.model import g1
from hotice.model.picks.book import SHAPES, PickBook
from hotice.sim.pickup.env import PickUpEnv
from hotice.task.config import TaskConfig
from hotice.task.pickup import perturbed, pickup_task
from hotice.task.protocols import get_protocol
from hotice.task.rules import OUTCOMES


def play(book: PickBook, exact: bool, seed: int) -> list[str]:
    """Outcome of each pick of the book."""
    task = pickup_task(TaskConfig())
    if exact:
        task = replace(task, dynamics=get_protocol("robot").nominal)
    else:
        task = perturbed(task)
    env = PickUpEnv(len(book), book, seed=seed, config=task, threads=1)
    env.restarts, env.in_turn = False, True
    env.reset()
    rng, n = np.random.default_rng(seed), len(book)
    if not exact:
        env.physics.qpos[:, 27:29] += torch.tensor(rng.uniform(-0.01, 0.01, (n, 2)))
        yaw = rng.uniform(-0.035, 0.035, n) / 2
        w, z = env.physics.qpos[:, 30].clone(), env.physics.qpos[:, 33].clone()
        env.physics.qpos[:, 30] = w * torch.tensor(np.cos(yaw)) - z * torch.tensor(np.sin(yaw))
        env.physics.qpos[:, 33] = w * torch.tensor(np.sin(yaw)) + z * torch.tensor(np.cos(yaw))
        env.physics.forward(env.everyone)
    players = [Player(book, i) for i in range(n)]
    memory = [p.start() for p in players]
    code, offset, off = np.zeros(n, dtype=np.int64), env.carry.joint_offset.numpy(), 0.0 if exact else 1.0
    for _ in track(range(env.config.max_steps), description="playing"):
        env.physics.only = torch.nonzero(torch.tensor(code == 0)).squeeze(1)
        joints = env.physics.qpos[:, g1.JOINT_POS].numpy() + offset + off * rng.uniform(-0.03, 0.03, (n, 20))
        down = -env.physics.xmat[:, env.layout.pelvis, 2].numpy() + off * rng.uniform(-0.05, 0.05, (n, 3))
        gyro = env.physics.qvel[:, g1.ROOT_RATE].numpy() + off * rng.uniform(-0.2, 0.2, (n, 3))
        target = np.zeros((n, g1.ACTIONS))
        for i in np.flatnonzero(code == 0):
            target[i], memory[i] = players[i].step(memory[i], joints[i], down[i], gyro[i])
        action = (torch.tensor(target, dtype=torch.float32) - env.carry.target) / env.action_scale
        outcome = env.step(action).outcome.numpy()
        code = np.where(code == 0, outcome, code)
        if code.all():
            break
    return [OUTCOMES[c] for c in code]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picks", type=Path, required=True)
    parser.add_argument("--shape", choices=SHAPES, default=None)
    parser.add_argument("--count", type=a_count, default=50)
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--exact", action="store_true", help="without noise, the nominal robot")
    args = parser.parse_args(arguments)
    try:
        book = PickBook.load(args.picks)
        wanted = [i for i in range(len(book)) if args.shape in (None, SHAPES[int(book.shape[i])])][: args.count]
        if not wanted:
            raise InvalidState(f"no {args.shape} in {args.picks}: another --shape is needed")
        found = Counter(play(book.rows(wanted), args.exact, args.seed))
    except HoticeError as error:
        print(f"playback: {error}", file=sys.stderr)
        return 2
    low, high = success_interval(found["success"], len(wanted))
    print(f"{found['success']} of {len(wanted)} ({low:.1%} to {high:.1%}); {dict(found.most_common())}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
