"""Command lines of README, documents, cards and help name options that there are."""

import re
from pathlib import Path

import pytest

from hotice.commands.line import catalog
from hotice.commands.line.options import OPTIONS, PICKUP_OPTIONS, SCENE_OPTIONS, field_names

ROOT = Path(__file__).parents[2]
GROUPS = {"": OPTIONS, "scene": SCENE_OPTIONS, "pickup": PICKUP_OPTIONS}
LINE = re.compile(r"\bhotice +(?:(scene|pickup) +)?([a-z][\w-]*)((?:[^`\n|#]|\\\|)*)")
NOT_THERE = {("train", "task")}
"""What a page names to say that it is not there (docs/pickup.md)."""
OTHER_NAMES: dict[tuple[str, str], str] = {("play", "scene"): "scenes"}
PAGES = [path for pattern in ("*.md", "docs/*.md", "hotice/policies/*.md") for path in sorted(ROOT.glob(pattern))]


def wrong(text):
    """Command and option, for each option that its command does not have; and how many options were looked at."""
    found, count = [], 0
    for group, command, rest in LINE.findall(text):
        if command not in GROUPS[group] or (command == "deploy" and rest.split()[:1] == ["replay"]):
            continue
        known = field_names(GROUPS[group][command])
        for option in re.findall(r"(?<![\w-])--([a-z][a-z0-9-]*)", rest):
            count += 1
            name = OTHER_NAMES.get((command, option), option).replace("-", "_")
            if not {name, name.removeprefix("no_")} & (known | {"help"}) and (command, option) not in NOT_THERE:
                found.append((f"{group} {command}".strip(), option))
    return found, count


def test_what_is_wrong_is_seen():
    assert wrong("`hotice play --scenes gap --policie x`, `hotice scene show a --far --no-robot`") == (
        [("play", "policie"), ("scene show", "far")],
        4,
    )


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_options_of_a_page_are_there(path):
    assert wrong(path.read_text(encoding="utf-8"))[0] == []


def test_options_of_examples_are_there():
    groups = (catalog.COMMANDS, catalog.SCENES, catalog.PICKUPS)
    text = "\n".join(line for each in groups for entries in each.values() for e in entries for line in e.examples)
    found, count = wrong(text)
    assert found == [] and count > 40
