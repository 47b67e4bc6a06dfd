"""What a robot's run looks like: a replay page and an MCAP file from its log, and a live page in the browser."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.seeing.live_view import LiveView
    from hotice.deploy.seeing.mcap_file import write_mcap
    from hotice.deploy.seeing.moments import moment
    from hotice.deploy.seeing.recorded import RecordedRun, read_run
    from hotice.deploy.seeing.rollout import rollout_record
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["LiveView", "moment", "read_run", "RecordedRun", "rollout_record", "write_mcap"]
