"""Help texts: each paragraph of a docstring is one line where the terminal is wide enough for it."""

import dataclasses

import docstring_parser
import pytest
from tyro.constructors import MISSING, ConstructorRegistry, StructTypeInfo

from hotice.commands.line.help_text import unbroken_help, whole_paragraphs
from hotice.commands.line.options import OPTIONS, PICKUP_OPTIONS, SCENE_OPTIONS
from hotice.commands.program import main

CONFIGS = {
    **OPTIONS,
    **{f"scene {name}": kind for name, kind in SCENE_OPTIONS.items()},
    **{f"pickup {name}": kind for name, kind in PICKUP_OPTIONS.items()},
}


def help_texts(config):
    """Help text by name of all options of a configuration, those of nested ones too."""
    spec = ConstructorRegistry.get_struct_spec(StructTypeInfo.make(config, MISSING, in_union_context=False))
    for field in spec.fields:
        if dataclasses.is_dataclass(field.type):
            yield from help_texts(field.type)
        yield f"{config.__name__}.{field.name}", field.helptext() or ""


@pytest.mark.parametrize("name", CONFIGS)
def test_no_option_has_a_break_within_its_help(name):
    with unbroken_help():
        texts = dict(help_texts(CONFIGS[name]))
    assert any(texts.values())
    assert {key: text for key, text in texts.items() if "\n" in text.replace("\n\n", "").replace("\n- ", "")} == {}


@pytest.mark.parametrize("command, config", [(name, CONFIGS[name]) for name in ("play", "scene import")])
def test_a_wide_terminal_shows_each_help_on_one_line(command, config, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "2000")
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    shown = capsys.readouterr().out
    docs = [p.description for parent in config.__mro__[:-1] for p in docstring_parser.parse_from_object(parent).params]
    parts = [" ".join(part.split()) for text in docs for part in text.split("\n\n")]
    assert len(parts) > 10 and [part for part in parts if part not in shown] == []


def test_paragraphs_and_items_stay_apart():
    text = """One that
        goes on.



        Another:
        - an item
          of two lines
        - a second
    """
    assert whole_paragraphs(text) == "One that goes on.\n\nAnother:\n- an item of two lines\n- a second"
