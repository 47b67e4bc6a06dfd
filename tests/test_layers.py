"""Imports point left only, by the lines of the layout in docs/design.md; no circles, no crowded folders, heavy packages
where they may be.

Everything is read from the source, without importing it: imports for types and inside functions count too.
"""

import ast
import re
from collections import defaultdict
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

import hotice

PACKAGE = Path(hotice.__file__).parent
DESIGN = PACKAGE.parent / "docs" / "design.md"
DOORS = {(f"hotice{name}.__main__", "hotice.commands.program") for name in ("", ".learn")}
"""The arrows that point right: `python -m hotice` and `python -m hotice.learn`."""
CROWDED = 20
"""Most modules in a folder."""

HEAVY = {"pydrake", "pinocchio", "coal", "casadi", "adam", "osqp", "proxsuite", "meshcat"}
"""What comes with the extra `drake`."""
ANALYSIS = {"trimesh", "matplotlib", "onnx", "onnxruntime", "onnxscript", "gymnasium", "tensorboard", "ray"}

NEVER = {
    "model": {"torch"},
    "task": {"torch"} | HEAVY | ANALYSIS,
    "policy": {"torch"} | HEAVY,
    "safety": {"torch", "numba", "mujoco"} | HEAVY | ANALYSIS,
    "control": {"torch"},
    "systems": {"torch", "tyro"},
    "deploy": {"torch"} | HEAVY,
    "fields": HEAVY,
    "sim": HEAVY,
    "learn": HEAVY,
}
"""What a layer imports nowhere, not inside a function either."""
NOT_AT_IMPORT = {
    "model": {"torch"} | HEAVY,
    "task": {"torch"} | HEAVY,
    "policy": {"torch"} | HEAVY,
    "safety": {"torch", "numba", "mujoco"} | HEAVY | ANALYSIS,
    "control": {"torch"},
    "systems": {"torch"},
    "deploy": {"torch"} | HEAVY,
    "sim": HEAVY,
    "learn": HEAVY,
    "evaluate": HEAVY,
}
"""What importing a layer's modules loads neither directly nor by what they import (but for `EXEMPT`)."""
EXEMPT = {
    "hotice.model.collision",
    "hotice.model.collision_geometry",
    "hotice.control.pick_plan.paths.kinematics",
}
"""Modules that are nothing without their heavy package, and are imported inside functions only."""


@cache
def modules() -> dict[str, ast.Module]:
    """Every module of the package by its name."""
    found = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
        found[".".join(parts).removesuffix(".__init__")] = ast.parse(file.read_text(encoding="utf-8"))
    return found


def imported(nodes, *, names=False) -> set[str]:
    """Modules that these nodes import; with `names`, `module.name` where a name is no module."""
    found = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"a relative import of {node.module}: write it out from hotice"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                found.add(full if names or full in modules() else node.module)
    return found


def at_import(body) -> list[ast.stmt]:
    """Statements that run when a module is imported: not those of functions, nor those for types alone."""
    found = []
    for statement in body:
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        found.append(statement)
        if isinstance(statement, ast.If) and ast.unparse(statement.test) == "TYPE_CHECKING":
            found += at_import(statement.orelse)
            continue
        for part in ("body", "orelse", "finalbody"):
            found += at_import(getattr(statement, part, []))
        for handler in getattr(statement, "handlers", []):
            found += at_import(handler.body)
    return found


@cache
def graph() -> dict[str, set[str]]:
    """Which modules of the package each module imports, anywhere in it."""
    return {name: imported(ast.walk(tree)) & modules().keys() - {name} for name, tree in modules().items()}


def home(full: str) -> str:
    """Module where a name of ours lives: `hotice.fields.FieldBank` of a lazy face comes from `hotice.fields.bank`."""
    while full not in modules():
        module, _, name = full.rpartition(".")
        origin = module
        for node in ast.walk(modules()[module]) if (PACKAGE.parent / module.replace(".", "/")).is_dir() else ():
            if isinstance(node, ast.ImportFrom) and name in {alias.name for alias in node.names}:
                origin = f"{node.module}.{name}"
        full = origin
    return full


@cache
def loads(module: str) -> tuple[set[str], set[str]]:
    """What importing a module loads directly: modules of the package, and first names of other packages."""
    ours, others = {module.rpartition(".")[0]} & modules().keys(), set()
    for full in imported(at_import(modules()[module].body), names=True):
        if full.split(".")[0] == "hotice":
            ours.add(home(full))
        else:
            others.add(full.split(".")[0])
    return ours, others


@cache
def loaded(name: str) -> set[str]:
    """First names of all packages that importing a module loads, by way of what it imports too."""
    todo, seen, outside = [name], set(), set()
    while todo:
        if (module := todo.pop()) not in seen:
            seen.add(module)
            ours, others = loads(module)
            todo += ours
            outside |= others
    return outside


def layer(module: str) -> str:
    """Folder or module below `hotice` in which a module lies."""
    return module.split(".")[1] if "." in module else module


@cache
def contract() -> tuple[dict[str, set[str]], set[str]]:
    """What each layer may import, and the ground that all may import; from the layout in docs/design.md."""
    block = re.search(r"^## Layout\n.*?```text\n(.*?)```", DESIGN.read_text(encoding="utf-8"), re.S | re.M)
    assert block, "the layout in docs/design.md holds the layers' lines in a block ```text"
    may, ground = defaultdict(set), set()
    for line in block[1].splitlines():
        steps = [{name.strip() for name in step.split(",")} for step in line.split("(")[0].split("←")]
        if "(ground" in line:
            ground |= steps[0]
        for left, right in pairwise(steps):
            for name in right:
                may[name] |= left
    for name in list(may):
        todo = list(may[name])
        while todo:
            more = may.get(todo.pop(), set()) - may[name]
            may[name] |= more
            todo += more
        assert name not in may[name], f"the layout's lines lead from {name} back to it"
    return dict(may), ground


def against(may: dict[str, set[str]], ground: set[str]) -> set[tuple[str, str]]:
    """Arrows between modules that point right."""
    return {
        (module, other)
        for module, others in graph().items()
        for other in others
        if layer(module) != layer(other)
        and layer(other) not in may.get(layer(module), set()) | ground | {"hotice"}
        and (module, other) not in DOORS
    }


def circles(arrows: dict[str, set[str]]) -> list[set[str]]:
    """Groups of modules of which each leads to each."""
    reach = {}
    for name in arrows:
        todo, seen = list(arrows[name]), set()
        while todo:
            other = todo.pop()
            if other not in seen:
                seen.add(other)
                todo += arrows[other]
        reach[name] = seen
    return [set(group) for group in {frozenset(b for b in reach[a] if a in reach[b]) for a in arrows if a in reach[a]}]


def test_every_layer_has_a_line_in_the_layout():
    may, ground = contract()
    left = {name for names in may.values() for name in names}
    folders = {layer(name) for name in modules()} - {"hotice", "__main__"}
    assert folders - ground == (set(may) | left) - ground
    assert ground <= folders


def test_imports_point_left():
    arrows = against(*contract())
    assert not arrows, "\n".join(f"{a} imports {b}" for a, b in sorted(arrows))


def test_an_arrow_to_the_right_is_seen():
    may, ground = contract()
    without = {**may, "learn": may["learn"] - {"sim"}}
    assert any(layer(a) == "learn" and layer(b) == "sim" for a, b in against(without, ground))


def test_the_ground_imports_the_ground_only():
    ground = contract()[1]
    assert all(layer(other) in ground | {"hotice"} for m in graph() if layer(m) in ground for other in graph()[m])


def test_no_circles():
    found = circles(graph())
    assert not found, "\n".join(", ".join(sorted(group)) for group in found)


def test_a_circle_is_seen():
    arrows = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": {"e"}, "e": set()}
    assert circles(arrows) == [{"b", "c"}]


def test_no_crowded_folder():
    folders = {file.parent for file in PACKAGE.rglob("*.py")}
    count = {folder: len(list(folder.glob("*.py"))) - 1 for folder in folders}
    assert not {folder: n for folder, n in count.items() if n > CROWDED}


@pytest.mark.parametrize("name", NEVER)
def test_a_layer_never_imports(name):
    found = {
        (module, package)
        for module, tree in modules().items()
        if layer(module) == name and module not in EXEMPT
        for full in imported(ast.walk(tree))
        if (package := full.split(".")[0]) in NEVER[name]
    }
    assert not found


@pytest.mark.parametrize("name", NOT_AT_IMPORT)
def test_importing_a_layer_does_not_load(name):
    found = {
        (module, package)
        for module in modules()
        if layer(module) == name and module not in EXEMPT
        for package in loaded(module) & NOT_AT_IMPORT[name]
    }
    assert not found


def test_what_an_import_loads_is_seen():
    assert "torch" in loaded("hotice.fields.bank")
    assert "torch" in loaded("hotice.sim.env")
    assert "pydrake" in loaded("hotice.systems.policy")
