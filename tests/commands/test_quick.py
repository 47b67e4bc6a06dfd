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
        ["evaluate", "--policy", "", "--scenes", "gap"],
        ["evaluate", "--policy", "runs/nobody", "--scenes", "gap"],
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


SINGLE = sorted(set(catalog.names(catalog.COMMANDS)) - {"scene", "pickup"})
HELPS = [*SINGLE, *(f"scene {n}" for n in scene.COMMANDS), *(f"pickup {n}" for n in group.COMMANDS)]


@pytest.mark.parametrize("name", HELPS)
def test_help_of_a_command_ends_with_examples(name, capsys):
    with pytest.raises(SystemExit):
        main([*name.split(), "--help"])
    shown = capsys.readouterr().out
    assert shown.splitlines()[-1].startswith(f"  hotice {name}")


def test_help_of_no_command_imports_anything_to_work_with():
    """All in one process, each beside what those before it have imported."""
    code = (
        "import contextlib, io, sys\nfrom hotice.commands.program import main\n"
        f"for name in {HELPS!r}:\n"
        "    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):\n"
        "        main([*name.split(), '--help'])\n"
        f"    loaded = [each for each in {WORK!r} if each in sys.modules]\n"
        "    assert not loaded, (name, loaded)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_catalogue_is_that_of_the_functions():
    known = ((catalog.COMMANDS, table.COMMANDS), (catalog.SCENES, scene.COMMANDS), (catalog.PICKUPS, group.COMMANDS))
    for groups, functions in known:
        assert {e.name: e.says for entries in groups.values() for e in entries} == {
            name: function.__doc__.splitlines()[0] for name, function in functions.items()
        }


def test_the_version_is_told_whatever_follows(capsys):
    assert main(["--version", "--help"]) == 0
    assert capsys.readouterr().out.startswith("hotice ")


def test_a_misspelt_command_is_told_the_nearest_one(capsys):
    assert main(["evalaute"]) == 2
    assert "did you mean evaluate?" in capsys.readouterr().err


def test_completion_knows_commands_and_options(capsys):
    with pytest.raises(SystemExit):
        main(["--tyro-print-completion", "bash"])
    shown = capsys.readouterr().out
    assert "robot-check" in shown and "--rollouts" in shown


@pytest.mark.parametrize("command", [[], ["play"], ["scene", "check"], ["deploy", "replay"]])
@pytest.mark.parametrize(
    "words, message",
    [
        (["--tyro-print-completion", "nosh"], "unknown shell 'nosh': known are bash, fish, tcsh, zsh"),
        (["--tyro-write-completion", "bash", "nowhere/a/b"], "nowhere"),
    ],
)
def test_completion_that_cannot_be_made_is_refused(command, words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "nowhere").touch()
    assert main([*command, *words]) == 2
    assert message in capsys.readouterr().err
