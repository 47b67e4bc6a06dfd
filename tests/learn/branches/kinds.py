"""Runners that die, in the process of a branch."""

import os
import signal

from hotice.errors import DivergedError
from hotice.learn.train.runner import Runner


class KilledOnce(Runner):
    """Branch 1 is killed during update 4, the first time."""

    def learn_once(self):
        if self.config.out.name == "branch-1" and self.update == 3:
            mark = self.config.out / "killed"
            if not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)
        return super().learn_once()


class AlwaysDiverges(Runner):
    """Branch 1 diverges in its first update of each round."""

    def learn_once(self):
        if self.config.out.name == "branch-1":
            raise DivergedError("its weights are not finite")
        return super().learn_once()


class NoneLives(Runner):
    """All branches diverge."""

    def learn_once(self):
        raise DivergedError("its weights are not finite")
