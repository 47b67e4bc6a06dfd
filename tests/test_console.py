"""Names and paths are printed as they are."""

import ast
import io
from pathlib import Path

import pytest
from rich.table import Table

import hotice
from hotice.console import PlainConsole
from hotice.failures import one_line

NASTY = "[/bold] :smile: [red]x[/nope]"


@pytest.fixture
def console():
    made = PlainConsole(width=100)
    made.file = io.StringIO()
    return made


def test_markup_is_text(console):
    console.print(NASTY)
    table = Table(NASTY, title=NASTY)
    table.add_row(NASTY)
    console.print(table)
    console.rule(NASTY)
    with console.status(NASTY):
        pass
    assert console.file.getvalue().count(NASTY) == 5


def test_everything_prints_through_it():
    """A console of rich's own would read names as markup: `[/bold]` in a path is an exception there."""
    folder = Path(hotice.__file__).parent
    users = {
        str(file.relative_to(folder))
        for file in folder.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.ImportFrom)
        and (node.module == "rich.console" and any(a.name == "Console" for a in node.names) or node.module == "rich")
        and any(a.name in ("Console", "print", "get_console") for a in node.names)
    }
    assert users == {"console.py"}


def test_one_line_moves_no_cursor():
    assert one_line("a\nb\x1b[31m\r\x00 ä [/bold]\udcff") == "a b\\x1b[31m\\r\\x00 ä [/bold]\\udcff"
