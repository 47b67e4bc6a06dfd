"""Command line of hotice, also as `python -m hotice.learn`; tables of the task as Markdown."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.commands.program import main
    from hotice.commands.tables import observation_table, reward_table, termination_table
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["main", "observation_table", "reward_table", "termination_table"]
