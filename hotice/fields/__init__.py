"""What guides: signed and geodesic distance, SGF, OGF and their sampling. A name is imported when it is used."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hotice.fields.alignment import cosine, encode, residual_cosine
    from hotice.fields.bank import FieldBank, FieldSample
    from hotice.fields.guidance import Guidance, query
    from hotice.fields.hod_pf import GuidanceField, HodPf, build_hod_pf
    from hotice.fields.potential import FieldParams
    from hotice.fields.similarity import scene_similarity, similarity_matrix, similarity_to_set

_LAZY = {
    "FieldBank": "bank",
    "FieldSample": "bank",
    "Guidance": "guidance",
    "query": "guidance",
    "GuidanceField": "hod_pf",
    "HodPf": "hod_pf",
    "build_hod_pf": "hod_pf",
    "FieldParams": "potential",
    "scene_similarity": "similarity",
    "similarity_matrix": "similarity",
    "similarity_to_set": "similarity",
    "cosine": "alignment",
    "encode": "alignment",
    "residual_cosine": "alignment",
}

__all__ = [
    "FieldBank",
    "FieldParams",
    "FieldSample",
    "Guidance",
    "GuidanceField",
    "HodPf",
    "build_hod_pf",
    "cosine",
    "encode",
    "query",
    "residual_cosine",
    "scene_similarity",
    "similarity_matrix",
    "similarity_to_set",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
