"""What guard and runner write into their logs, where, and what a log gives back."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.recording.guard_log import GuardLog
    from hotice.deploy.recording.place import ring_folder
    from hotice.deploy.recording.replay import Replayed, replay_log
    from hotice.deploy.recording.runner_log import RunnerLog
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["GuardLog", "replay_log", "Replayed", "ring_folder", "RunnerLog"]
