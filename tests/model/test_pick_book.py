"""Books of picks: what is none is refused in words."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hotice.errors import InvalidState
from hotice.model.picks.book import PickBook

BOOK = Path(__file__).parents[1] / "sim" / "data" / "picks.npz"


@pytest.fixture(scope="module")
def book():
    return PickBook.load(BOOK)


@pytest.mark.parametrize(
    "name, change, message",
    [
        ("mass", lambda v: v * np.nan, "not finite"),
        ("joint_pos", lambda v: v + 1e4, "numbers up to 1000 needed"),
        ("mass", lambda v: np.array([None] * len(v)), "mass of a book of picks is object"),
        ("support", lambda v: v[:1], "shape"),
        ("support", lambda v: -v, "not above 0 m"),
        ("shape", lambda v: v + 3, "whole numbers from 0 to 2"),
        ("shape", lambda v: v + 0.5, "whole numbers from 0 to 2"),
        ("phase", lambda v: v.astype(float), "whole numbers from 0 to 7"),
        ("phase", lambda v: v[::-1], "goes back"),
        ("start", lambda v: v * 0.9, "length is not 1"),
    ],
)
def test_numbers_that_cannot_be_are_refused(book, name, change, message):
    with pytest.raises(InvalidState, match=message):
        replace(book, **{name: change(getattr(book, name))})


def test_files_that_hold_no_book_are_refused(book, tmp_path):
    path = tmp_path / "x.npz"
    with pytest.raises(InvalidState, match="no such file"):
        PickBook.load(path)
    path.write_bytes(BOOK.read_bytes()[:1000])
    with pytest.raises(InvalidState, match="is no archive of arrays"):
        PickBook.load(path)
    np.savez(path, **{name: value for name, value in vars(book).items() if name not in ("lean", "mass")})
    with pytest.raises(InvalidState, match="is no book of picks: mass, lean not in it"):
        PickBook.load(path)
    np.savez(path, **vars(book) | {"mass": -book.mass})
    with pytest.raises(InvalidState, match="is no book of picks: box: mass_kg"):
        PickBook.load(path)
