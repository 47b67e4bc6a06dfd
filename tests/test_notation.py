"""The page of symbols names modules and objects that exist."""

import re
from pathlib import Path

import pytest

from tools.reference import exists

TEXT = (Path(__file__).parents[1] / "docs" / "notation.md").read_text()
NAMES = sorted(set(re.findall(r"`(hotice(?:\.\w+)+)`", TEXT)))


@pytest.mark.parametrize("name", NAMES)
def test_names_on_the_page_exist(name):
    if name.startswith(("hotice.control", "hotice.systems")):
        pytest.importorskip("pydrake")
    assert exists(name)


def test_every_letter_of_the_five_types_is_in_the_table_of_frames():
    cells = re.findall(r"^\| ([A-Z](?:, [A-Z])*) \|", TEXT, re.MULTILINE)
    assert set("WEPYTHOGJFKBMLR") <= {letter for cell in cells for letter in cell.split(", ")}
    assert len(NAMES) > 20
