"""The public face: names in `__all__`, few for each package, each with one meaning, and enough for whoever only reads
the documents and notebooks."""

import ast
import importlib
import inspect
import json
import re
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import pytest

import hotice
from tools.reference import MODULES, faces

PACKAGE = Path(hotice.__file__).parent
ROOT = PACKAGE.parent
MOST = 17
"""Most names of a face, but for the family of errors."""


FACES = faces()
PACKAGES = [name for name in FACES if name not in MODULES]
ON_DRAKE = "hotice.systems"


def face(name):
    if name == ON_DRAKE:
        pytest.importorskip("pydrake")
    return importlib.import_module(name)


@pytest.mark.parametrize("name", FACES)
def test_a_face_is_small_sorted_and_told(name):
    module = face(name)
    names = module.__all__
    assert names == sorted(names, key=str.lower) or names == sorted(names)
    assert len(set(names)) == len(names) <= MOST or name == "hotice.errors"
    assert module.__doc__
    for each in names:
        value = getattr(module, each)
        if inspect.isclass(value) or inspect.isroutine(value):
            assert value.__doc__, f"{name}.{each} has no docstring"
    assert set(names) <= set(dir(module))
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nothing'"):
        module.nothing  # noqa: B018


def test_a_name_means_one_thing():
    pytest.importorskip("pydrake")
    homes = {}
    for name in FACES:
        for each in face(name).__all__:
            homes.setdefault(each, {})[name] = id(getattr(face(name), each))
    assert not {each: sorted(where) for each, where in homes.items() if len(set(where.values())) > 1}


@pytest.mark.parametrize("name", PACKAGES)
def test_no_module_is_named_as_a_name_of_its_face(name):
    """Importing the module would put it in the name's place."""
    folder = ROOT / name.replace(".", "/")
    inside = {path.stem for path in folder.iterdir()}
    assert not inside & set(face(name).__all__)


@pytest.mark.parametrize("name", PACKAGES)
def test_types_are_told_of_every_name(name):
    """A type checker and the lazy face read the same imports: all of `__all__`, nothing else."""
    tree = ast.parse((ROOT / name.replace(".", "/") / "__init__.py").read_text(encoding="utf-8"))
    (block,) = (n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING")
    imports = [n for n in block.body if isinstance(n, ast.ImportFrom)]
    assert sorted(alias.name for n in imports for alias in n.names) == sorted(face(name).__all__)


def test_importing_all_faces_imports_nothing_else():
    code = (
        f"import sys, {', '.join(PACKAGES)}\n"
        "heavy = {'numpy', 'torch', 'mujoco', 'pydrake', 'pinocchio', 'matplotlib', 'numba'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    pytest.importorskip("pydrake")
    subprocess.run([sys.executable, "-c", code], check=True)


def python_of(path: Path) -> list[str]:
    """Blocks of Python code in a document or notebook."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        return re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)
    cells = json.loads(text)["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


DOCUMENTS = [
    path
    for pattern in ("*.md", "docs/**/*.md", "hotice/**/*.md", "notebooks/*.ipynb")
    for path in sorted(ROOT.glob(pattern))
    if python_of(path)
]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_documents_import_from_faces_alone(path):
    for block in python_of(path):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.Import):
                assert not [alias.name for alias in node.names if alias.name.startswith("hotice.")]
            elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "hotice":
                for alias in node.names:
                    public = f"{node.module}.{alias.name}" in FACES or (
                        node.module in FACES and alias.name in face(node.module).__all__
                    )
                    assert public, f"{node.module}.{alias.name} is in no face"


@pytest.mark.slow
@pytest.mark.parametrize(
    "block",
    [block for page in ("README.md", "docs/python.md") for block in python_of(ROOT / page)],
    ids=lambda block: re.findall("import (.*)", block)[-1],
)
def test_the_code_for_a_first_look_runs(block, tmp_path, monkeypatch):
    if "pydrake" in block:
        pytest.importorskip("pydrake")
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "document", "exec"), {})


def test_types_are_shipped():
    assert files("hotice").joinpath("py.typed").is_file()
    assert '"hotice" = ["py.typed"]' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
