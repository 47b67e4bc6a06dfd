"""Guidance fields: signed and geodesic distance, SGF, OGF and their sampling. A name is imported when it is used."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.fields.alignment import cosine, encode, residual_cosine
    from hotice.fields.bank import FieldBank, FieldSample
    from hotice.fields.command import navigation_command
    from hotice.fields.guidance import Guidance, query
    from hotice.fields.hod_pf import GuidanceField, HodPf, build_hod_pf
    from hotice.fields.live import LiveField
    from hotice.fields.potential import FieldParams
    from hotice.fields.similarity import scene_similarity, similarity_matrix, similarity_to_set
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "FieldBank",
    "FieldParams",
    "FieldSample",
    "Guidance",
    "GuidanceField",
    "HodPf",
    "LiveField",
    "build_hod_pf",
    "cosine",
    "encode",
    "navigation_command",
    "query",
    "residual_cosine",
    "scene_similarity",
    "similarity_matrix",
    "similarity_to_set",
]
