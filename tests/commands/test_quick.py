"""Help and refusals cost little: whatever a command works with is imported after its words are understood."""

import subprocess
import sys

import pytest

from hotice.commands import scene, table
from hotice.commands.line import catalog
from hotice.commands.picks import group
from hotice.commands.program import main

WORK = ("torch", "mujoco", "numba", "scipy", "onnxruntime", "onnx", "pydrake", "pinocchio", "cyclonedds", "matplotlib")


def after(*argv):
    """Exit status, packages of those above and other large ones that were imported, and what was said."""
    names = (*WORK, "numpy", "tyro", "rich")
    code = (
        "import sys\nfrom hotice.commands.program import main\n"
        f"try: status = main({[str(a) for a in argv]!r})\nexcept SystemExit as end: status = end.code or 0\n"
        f"print(status, *[name for name in {names!r} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *said, last = done.stderr.strip().splitlines()
    status, *loaded = last.split()
    return int(status), set(loaded), done.stdout, "\n".join(said)


@pytest.mark.parametrize("argv", [["--help"], [], ["scene", "--help"], ["evalaute"], ["--version"], ["scene", "lst"]])
def test_help_and_unknown_commands_import_nothing(argv):
    assert after(*argv)[1] == set()


@pytest.mark.parametrize(
    "argv",
    [
        ["train", "--num-envs", "0"],
        ["train", "--scenes", "nowhere"],
        ["train", "--no-such-option"],
        ["evaluate", "--policy", "student", "--scenes", "nowhere"],
        ["evaluate", "--policy", "nobody", "--scenes", "gap"],
        ["play", "--policy", "nobody"],
        ["benchmark", "--scenes", "nowhere"],
        ["reproduce", "table9"],
        ["robot-sim", "--box", "1"],
        ["deploy", "--scene", "nowhere"],
        ["scene", "check", "--far"],
        ["scene", "import"],
    ],
)
def test_refusals_import_nothing_to_work_with(argv):
    status, loaded, _, said = after(*argv)
    assert status == 2 and said and not loaded & set(WORK)


@pytest.mark.parametrize("name", [*catalog.names(catalog.COMMANDS), *(f"scene {n}" for n in scene.COMMANDS)])
def test_help_of_a_command_imports_nothing_to_work_with_and_ends_with_examples(name, capsys):
    if name in ("scene", "pickup"):
        return
    with pytest.raises(SystemExit):
        main([*name.split(), "--help"])
    shown = capsys.readouterr().out
    assert shown.splitlines()[-1].startswith(f"  hotice {name}")


def test_the_catalogue_is_that_of_the_functions():
    known = ((catalog.COMMANDS, table.COMMANDS), (catalog.SCENES, scene.COMMANDS), (catalog.PICKUPS, group.COMMANDS))
    for groups, functions in known:
        assert {e.name: e.says for entries in groups.values() for e in entries} == {
            name: function.__doc__.splitlines()[0] for name, function in functions.items()
        }


def test_a_misspelt_command_is_told_the_nearest_one(capsys):
    assert main(["evalaute"]) == 2
    assert "did you mean evaluate?" in capsys.readouterr().err


def test_completion_knows_commands_and_options(capsys):
    with pytest.raises(SystemExit):
        main(["--tyro-print-completion", "bash"])
    shown = capsys.readouterr().out
    assert "robot-check" in shown and "--rollouts" in shown
