"""A shell for all attacks of a process, and bad files by the ending under which a command reads them."""

import shutil

import pytest

from tests.attack import bad_files
from tests.attack.shell import Shell


@pytest.fixture(scope="session")
def shell(tmp_path_factory):
    made = Shell(tmp_path_factory.mktemp("attack") / "shell")
    yield made
    made.close()


@pytest.fixture(scope="session")
def bad(tmp_path_factory):
    """Paths of bad files by ending and name."""
    root = tmp_path_factory.mktemp("bad")
    places = bad_files.make_places(root / "places")
    found = {}
    for ending in bad_files.ENDINGS:
        folder = root / ending[1:]
        folder.mkdir()
        found[ending] = {
            **{f"place_{name}": path for name, path in places.items()},
            **{f"link_{name}": path for name, path in bad_files.linked(folder, ending, places).items()},
            **{f"text_{name}": path for name, path in bad_files.write_contents(folder, ending).items()},
        }
    yield found
    shutil.rmtree(root)


@pytest.fixture
def attack(shell, tmp_path):
    """Function: runs command lines (id, argv, allowed), each in an empty folder; fails with all that is wrong.

    `unsaid`: word of a message that a line reaches only when it has accepted what is bad in it.
    """

    def run(lines, unsaid=None):
        wrong = []
        for number, (name, argv, allowed) in enumerate(lines):
            cwd = tmp_path / f"line{number}"
            cwd.mkdir()
            outcome = shell([str(word) for word in argv], cwd)
            faults = [*outcome.faults(allowed), *(["was accepted"] if unsaid and unsaid in outcome.err else [])]
            wrong += [f"{name}: {fault}: {outcome.err.strip()[-300:]}" for fault in faults]
            shutil.rmtree(cwd)
        if wrong:
            pytest.fail("\n".join(wrong), pytrace=False)

    return run
