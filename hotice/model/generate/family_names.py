"""Family of a scene, read from its name: generated scenes and those of sets are named after it."""

from __future__ import annotations

import re

from hotice.model.generate.families import CHECKED, GRADED, MOVING

KINDS = (*GRADED, *CHECKED, "indoor", *MOVING)
"""Families that are no mixture of others."""
SINGLE = {"open_floor": "open", **{name: name for name in ("beam", "gap", "pillars", "pipe", "table_edge")}}
"""Families of the single scenes that come with hotice."""
_KIND = "|".join(sorted(KINDS, key=len, reverse=True))
_NAME = re.compile(rf"(?P<set>[^/]+/\d+_)?(?P<family>{_KIND})(?(set)|(?:_s\d+|(?<=indoor)_[a-z_]+)?_\d+)")


def family_of(name: str) -> str | None:
    """Family of a scene by its name (`beam_s3_04`, `indoor_kitchen_012`, `bench20/06_beam_across`, …) or None."""
    if name in SINGLE:
        return SINGLE[name]
    match = _NAME.fullmatch(name)
    return match["family"] if match else None
