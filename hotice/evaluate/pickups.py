"""Scores of pick-ups: lifted, in the carry state, held for 5 s, under the protocol `robot`; by shape of the object."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np
import torch
from torch import Tensor

from hotice.evaluate.pick_config import TEACHER, PickEvaluateConfig
from hotice.evaluate.trials import success_interval
from hotice.files import write_text
from hotice.learn.policy import check_layout, load_policy
from hotice.model.picks.book import SHAPES, PickBook
from hotice.sim.physics.threads import use_threads
from hotice.sim.pickup.env import PickUpEnv
from hotice.task.config import TaskConfig
from hotice.task.pickup import perturbed, pickup_task
from hotice.task.protocols import get_protocol
from hotice.task.rules import OUTCOMES

FORMAT = "hotice-pickup-report/1"
BLOCK = 64
"""Trials at a time; what a trial draws depends on the number of its block, not on how many follow."""


@dataclass(frozen=True, kw_only=True)
class PickScore:
    """Of the picks of one shape: trials, successes, outcomes by name; seconds until success, mean (0: none)."""

    shape: str
    rollouts: int
    successes: int
    outcomes: dict[str, int]
    seconds: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the success rate."""
        return success_interval(self.successes, self.rollouts)


def evaluate_picks(config: PickEvaluateConfig) -> list[PickScore]:
    """Scores by shape, those that occur; writes the report where one is asked for.

    Raises `InvalidState` for the book, `CheckpointError` or `UnknownName` for the policy, `OutputError`.
    """
    use_threads(config.threads)
    book, policy = PickBook.load(config.picks), None
    task = pickup_task(TaskConfig())
    if config.policy != TEACHER:
        policy = load_policy(config.policy, config.threads)
        known = policy.meta["task"]
        names = ("leg_scale_rad", "arm_scale_rad", "action_limit", "history")
        task = replace(task, **{name: known[name] for name in names if name in known})
    protocol = get_protocol("robot")
    task = perturbed(task) if config.perturbed else replace(task, dynamics=protocol.nominal)
    codes, times = [], []
    rows = np.arange(config.rollouts) % len(book)
    for number, first in enumerate(range(0, config.rollouts, BLOCK)):
        part = book.rows(rows[first : first + BLOCK].tolist())
        env = PickUpEnv(len(part), part, seed=config.seed + number, config=task, threads=config.threads)
        if policy is not None:
            check_layout(policy, env.policy_table.layout())
        act = (lambda obs, env=env: env.label()) if policy is None else policy.act
        code, time_s = _run(env, act)
        codes.append(code)
        times.append(time_s)
    code, time_s, shape = np.concatenate(codes), np.concatenate(times), np.asarray(book.shape)[rows]
    scores = [_score(name, code[shape == k], time_s[shape == k]) for k, name in enumerate(SHAPES) if (shape == k).any()]
    if config.out is not None:
        about = {"policy": config.policy, "protocol": "robot", "perturbed": config.perturbed, "seed": config.seed}
        rates = [asdict(s) | {"success_rate": s.successes / s.rollouts, "interval": s.interval} for s in scores]
        write_text(
            config.out, json.dumps({"format": FORMAT, **about, "picks": str(config.picks), "shapes": rates}) + "\n"
        )
    return scores


@torch.no_grad()
def _run(env: PickUpEnv, act: Callable[[Tensor], Tensor]) -> tuple[np.ndarray, np.ndarray]:
    """Outcome of each robot's pick, index into `OUTCOMES`, and when it came [s]; (N,) each."""
    env.restarts, env.in_turn = False, True
    obs, _ = env.reset()
    code = torch.zeros(env.num_envs, dtype=torch.int64)
    end = torch.zeros(env.num_envs)
    for k in range(env.config.max_steps):
        env.physics.only = torch.nonzero(code == 0).squeeze(1)  # type: ignore[attr-defined]
        step = env.step(act(obs))
        obs = step.policy
        new = (code == 0) & (step.outcome > 0)
        code[new], end[new] = step.outcome[new], (k + 1) * env.config.control_dt_s
        if bool((code > 0).all()):
            break
    return code.numpy(), end.numpy()


def _score(shape: str, code: np.ndarray, time_s: np.ndarray) -> PickScore:
    outcomes = Counter(OUTCOMES[int(c)] for c in code)
    good = code == OUTCOMES.index("success")
    seconds = float(time_s[good].mean()) if good.any() else 0.0
    return PickScore(
        shape=shape,
        rollouts=len(code),
        successes=int(good.sum()),
        outcomes=dict(outcomes.most_common()),
        seconds=seconds,
    )
