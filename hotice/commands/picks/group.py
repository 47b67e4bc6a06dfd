"""The commands of `hotice pickup`, one function each."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hotice.failures import STOPPED
from hotice.files import check_folder, check_writable
from hotice.owner import check_unowned
from hotice.progress import doing

if TYPE_CHECKING:
    from hotice.commands.picks.config import PlanConfig
    from hotice.evaluate.pick_config import PickEvaluateConfig
    from hotice.learn.distill.pick_config import PickDistillConfig
    from hotice.learn.train.config import TrainConfig
    from hotice.learn.train.pick_config import PickTrainConfig
    from hotice.learn.train.runner import Runner


def plan(config: PlanConfig) -> int:
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


def distill(config: PickDistillConfig) -> int:
    """Make a student of a book of picks (DAgger), under noise and delays."""
    from hotice.learn.distill.pick_dagger import PickDistillRunner

    return _train(PickDistillRunner, config)


def train(config: PickTrainConfig) -> int:
    """Go on from a student with dual PPO, under noise and delays."""
    from hotice.learn.train.pickup import PickRunner

    return _train(PickRunner, config)


def evaluate(config: PickEvaluateConfig) -> int:
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


def _train(kind: Callable[[Any], Runner], config: TrainConfig) -> int:
    from hotice.learn.branches.run import runner_of

    check_folder(config.out)
    check_unowned(config.out)
    with doing("preparing picks"):
        runner = runner_of(kind, config)
    return 0 if runner.train() else STOPPED


COMMANDS = {"plan": plan, "distill": distill, "train": train, "evaluate": evaluate}
