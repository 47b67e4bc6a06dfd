"""Pick-ups: plan a book of them, make a student of it, improve the student, score it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from hotice import checks
from hotice.commands.help_text import unbroken_help
from hotice.control.playback.draw import PickRange
from hotice.errors import InvalidConfig
from hotice.evaluate.pickups import PickEvaluateConfig
from hotice.failures import STOPPED
from hotice.files import check_folder, check_writable
from hotice.learn.distill.pick_config import PickDistillConfig
from hotice.learn.train.pickup import PickTrainConfig
from hotice.owner import check_unowned
from hotice.progress import doing

Flat = tyro.conf.OmitArgPrefixes


@dataclass(frozen=True, kw_only=True)
class PlanConfig:
    """One book of picks; needs the extra `drake`."""

    out: Path = Path("picks.npz")
    """Book to write."""
    count: int = 64
    """Picks in it; planning one takes some seconds."""
    seed: int = 0
    """Seed of objects and places."""
    draws: PickRange = field(default_factory=PickRange)
    """What is drawn."""

    def __post_init__(self) -> None:
        checks.whole("count", self.count, checks.COUNT)
        checks.whole("seed", self.seed, checks.INT64)
        if self.out.suffix != ".npz":
            raise InvalidConfig(f"out is {str(self.out)!r}: a .npz file is needed")


def plan(config: Flat[PlanConfig]) -> int:
    """Plan random picks and write them as one book: what teachers follow, and what is picked where."""
    from hotice.control.playback import draw
    from hotice.model.picks.book import PickBook

    check_writable(config.out)
    books, refused = draw.draw_books(config.draws, config.count, config.seed)
    PickBook.join(books).save(config.out)
    print(f"{config.out}: {len(books)} picks; refused {sum(refused.values())}")
    for reason, count in refused.most_common():
        print(f"  {count} x {reason}")
    return 0


def distill(config: Flat[PickDistillConfig]) -> int:
    """Make a student of a book of picks (DAgger), under noise and delays."""
    from hotice.learn.distill.pick_dagger import PickDistillRunner

    return _train(PickDistillRunner, config)


def train(config: Flat[PickTrainConfig]) -> int:
    """Go on from a student with dual PPO, under noise and delays."""
    from hotice.learn.train.pickup import PickRunner

    return _train(PickRunner, config)


def evaluate(config: Flat[PickEvaluateConfig]) -> int:
    """Score a policy, or the book itself, by the protocol `robot`: lifted, in the carry state, held for 5 s."""
    from hotice.evaluate.pickups import evaluate_picks

    if config.out is not None:
        check_writable(config.out)
    for s in evaluate_picks(config):
        low, high = s.interval
        causes = ", ".join(f"{n} {name}" for name, n in s.outcomes.items() if name != "success")
        print(
            f"{s.shape}: {s.successes} of {s.rollouts}, {s.successes / s.rollouts:.1%} ({low:.1%} to {high:.1%}), "
            f"{s.seconds:.1f} s{'; ' + causes if causes else ''}"
        )
    return 0


def _train(kind, config) -> int:
    check_folder(config.out)
    check_unowned(config.out)
    with doing("preparing picks"):
        runner = kind(config)
    return 0 if runner.train() else STOPPED


COMMANDS = {"plan": plan, "distill": distill, "train": train, "evaluate": evaluate}


def main(argv: Sequence[str]) -> int:
    """Runs one command of the group."""
    with unbroken_help():
        return (
            tyro.extras.subcommand_cli_from_dict(COMMANDS, args=list(argv), prog="hotice pickup", description=__doc__)
            or 0
        )
