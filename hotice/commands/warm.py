"""Compiling beforehand what scenes, fields, policies and rollouts need, so that later commands begin at once."""

from __future__ import annotations

import os
import time

import numpy as np

from hotice import compiled
from hotice.compiling import COMPILING
from hotice.console import PlainConsole
from hotice.files import write_text

SCENE, POLICY = "gap", "student"
SHORT_S = 0.1
DONE = "warm"
"""File beside what was compiled that says that all of this is there."""


def warm_once() -> None:
    """`warm`, unless it was done before, or nothing is kept: processes that begin together do not compile alike."""
    folder = compiled.kept_in()
    if folder is not None and not (folder / DONE).exists() and not os.environ.get("HOTICE_QUIET"):
        warm(PlainConsole(stderr=True))


def warm(console: PlainConsole | None = None) -> None:
    """Runs a short rollout and every kind of query of a field; says how much was compiled."""
    from hotice.evaluate.conditions import Conditions
    from hotice.evaluate.record import record_rollouts
    from hotice.fields import build_hod_pf
    from hotice.learn.policy import load_policy
    from hotice.model import Box, load_scene
    from hotice.model.carry import solve_carry
    from hotice.model.generate.traversable import check_traversable

    begin, scene, box = time.perf_counter(), load_scene(SCENE), Box((0.30, 0.30, 0.25), 1.5)
    field = build_hod_pf(scene)
    pelvis = np.array([*scene.start[:2], 0.75])
    for guidance in (field.sgf, field.ogf):
        for query in ("sample", "potential", "signed_distance", "geodesic_distance"):
            getattr(guidance, query)(pelvis)
    check_traversable(scene)
    record_rollouts(load_policy(POLICY), scene, [solve_carry(box)], Conditions(horizon_s=SHORT_S))
    console, spent = console or PlainConsole(), COMPILING.spent_s
    folder = compiled.kept_in()
    if folder is not None:
        write_text(folder / DONE, "")
    if COMPILING.functions:
        console.print(f"compiled {COMPILING.functions} functions in {spent:.0f} s, once for this version of hotice")
    else:
        console.print(f"nothing left to compile, {time.perf_counter() - begin:.0f} s to see it")
