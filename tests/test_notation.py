"""The page of symbols names modules and objects that exist."""

import importlib
import importlib.util
import re
from pathlib import Path

import pytest

TEXT = (Path(__file__).parents[1] / "docs" / "notation.md").read_text()
NAMES = sorted(set(re.findall(r"`(hotice(?:\.\w+)+)`", TEXT)))


def exists(name):
    """Whether a dotted name is a module, or an attribute of one."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        module = ".".join(parts[:end])
        try:
            found = importlib.util.find_spec(module)
        except ModuleNotFoundError:
            found = None
        if found is not None:
            if end == len(parts):
                return True
            target = importlib.import_module(module)
            for part in parts[end:]:
                if not hasattr(target, part):
                    return False
                target = getattr(target, part)
            return True
    return False


@pytest.mark.parametrize("name", NAMES)
def test_names_on_the_page_exist(name):
    if name.startswith(("hotice.control", "hotice.systems")):
        pytest.importorskip("pydrake")
    assert exists(name)


def test_every_letter_of_the_five_types_is_in_the_table_of_frames():
    cells = re.findall(r"^\| ([A-Z](?:, [A-Z])*) \|", TEXT, re.MULTILINE)
    assert set("WEPYTHOGJFKBMLR") <= {letter for cell in cells for letter in cell.split(", ")}
    assert len(NAMES) > 20
