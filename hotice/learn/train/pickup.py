"""Training of the pick-up: its environment, and dual PPO that goes on from a student of planned picks."""

from __future__ import annotations

from pathlib import Path

from hotice.errors import InvalidConfig
from hotice.learn import distributed
from hotice.learn.train.config import TrainConfig
from hotice.learn.train.pick_config import PickTrainConfig
from hotice.learn.train.runner import Runner
from hotice.model.picks.book import PickBook
from hotice.sim.physics.threads import use_threads
from hotice.sim.pickup.env import PickUpEnv
from hotice.task import pickup


def pickup_env(config: TrainConfig, picks: Path | None) -> PickUpEnv:
    """The environment of a run. Raises `InvalidState` for a file that is no book of picks."""
    if picks is None:
        raise InvalidConfig("no picks: a book of picks is needed, make one with `hotice pickup plan`")
    use_threads(config.threads)
    seed = config.seed + distributed.SEED_STRIDE * distributed.rank()
    task = pickup.perturbed(config.task) if config.perturbed else config.task
    device, threads, book = config.torch_device(), config.threads, PickBook.load(picks)
    return PickUpEnv(config.num_envs, book, config.preset, device, config.physics, seed, config=task, threads=threads)


class PickRunner(Runner):
    """Improves a student of the pick-up."""

    config: PickTrainConfig
    env: PickUpEnv  # type: ignore[assignment]

    def __init__(self, config: PickTrainConfig, env: PickUpEnv | None = None) -> None:
        super().__init__(config, env or pickup_env(config, config.picks))  # type: ignore[arg-type]

    def _spread(self) -> None:
        self.env.spread()
