"""What a rollout looked like: a record, a self-contained web page, and pictures."""

from hotice.replay.html import write_html
from hotice.replay.picture import film_strip, write_overview
from hotice.replay.rollout import InvalidRollout, RolloutRecord
from hotice.task.rules import OUTCOMES

__all__ = ["OUTCOMES", "InvalidRollout", "RolloutRecord", "film_strip", "write_html", "write_overview"]
