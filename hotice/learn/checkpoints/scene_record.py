"""One entry of what a policy was trained on: what was written for some scenes, and the digests of what came of it."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hotice.model.scene import Scene
from hotice.model.scene_digest import scene_digest
from hotice.model.shipped import FAMILY_PREFIX, shipped_scenes, shipped_sets

SHORT = 12
"""Hexadecimal digits that are kept of the digest of a single scene."""
TOLD_BY = ("run", "ledger", "hand")
"""Who says that these scenes were trained on, the most reliable first: the run itself, as it trained; the training
ledger, afterwards; a user, who named them."""
UNKNOWN_FAMILY = "unknown"
KINDS = ("family", "set", "scene", "files")


@dataclass(frozen=True, kw_only=True)
class SceneRecord:
    """Scenes of one set, family, name, file or folder.

    scenes: how they are written on the command line, a family with its seed. count: how many. families: how many of
    each family. digest: SHA-256 over those of all scenes, in order. digests: the first `SHORT` digits of each scene's
    (see `hotice.model.scene_digest`), or none where there are too many. told_by: of `TOLD_BY`.
    """

    scenes: str
    count: int
    families: dict[str, int]
    digest: str
    digests: tuple[str, ...]
    told_by: str

    @classmethod
    def of(cls, item: str, scenes: Sequence[Scene], told_by: str = "run") -> SceneRecord:
        """The entry of an item of the command line and the scenes that it stands for."""
        from hotice.model.generate.family_names import family_of

        digests = [scene_digest(scene) for scene in scenes]
        families = Counter(family_of(scene.name) or UNKNOWN_FAMILY for scene in scenes)
        return cls(
            scenes=_with_seed(str(item)),
            count=len(scenes),
            families=dict(sorted(families.items())),
            digest=over_all(digests),
            digests=tuple(d[:SHORT] for d in digests),
            told_by=told_by,
        )

    @property
    def kind(self) -> str:
        """Kind of record, one of `KINDS`: a generated family, a shipped set, a shipped scene, or files."""
        if self.scenes.startswith(FAMILY_PREFIX):
            return "family"
        if self.scenes in shipped_sets():
            return "set"
        single = self.scenes in shipped_scenes() or self.scenes in shipped_sets().get(
            self.scenes.rpartition("/")[0], ()
        )
        return "scene" if single else "files"

    def covers(self, digests: Sequence[str]) -> bool:
        """Whether scenes of these digests are exactly these."""
        return over_all(digests) == self.digest

    def to_json(self) -> dict[str, Any]:
        """JSON-ready; `digests` is one text, digits after digits, so that a record of a thousand scenes stays small."""
        return {
            "scenes": self.scenes,
            "kind": self.kind,
            "count": self.count,
            "families": self.families,
            "digest": self.digest,
            "digests": "".join(self.digests),
            "told_by": self.told_by,
        }

    @classmethod
    def from_json(cls, data: Any) -> SceneRecord:
        """Inverse of `to_json`. Raises `KeyError`, `TypeError` or `ValueError` for what no entry can be."""
        text, told_by, count = data["digests"], data["told_by"], data["count"]
        if told_by not in TOLD_BY:
            raise ValueError(f"told_by is {told_by!r}: known are {', '.join(TOLD_BY)}")
        if isinstance(count, bool) or not isinstance(count, int) or count < 1:
            raise ValueError(f"count is {count!r}: a number of at least 1 is needed")
        digests = tuple(text[i : i + SHORT] for i in range(0, len(text), SHORT))
        if digests and (len(digests) != count or len(digests[-1]) != SHORT):
            raise ValueError(f"digests are of {len(text) / SHORT:g} scenes, {count} are counted")
        families = {str(name): int(n) for name, n in data["families"].items()}
        return cls(
            scenes=str(data["scenes"]),
            count=count,
            families=families,
            digest=str(data["digest"]),
            digests=digests,
            told_by=told_by,
        )


def over_all(digests: Sequence[str]) -> str:
    """One digest over those of several scenes, in order."""
    return hashlib.sha256("".join(digests).encode()).hexdigest()


def _with_seed(item: str) -> str:
    """`family:NAME:COUNT` with the seed that it means."""
    return f"{item}:0" if item.startswith(FAMILY_PREFIX) and item.count(":") == 2 else item
