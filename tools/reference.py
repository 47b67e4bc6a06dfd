"""The API reference of every public face, from its docstrings; any warning, and any name that leads nowhere, fails.

    python -m tools.reference build/reference

Needs pdoc and all extras, but no network. Pages are written by pdoc; that names of hotice in backticks exist, in all
docstrings and documents, is checked here, since pdoc leaves unknown ones as they are.
"""

import argparse
import ast
import importlib
import re
import sys
import warnings
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path

import hotice

PACKAGE = Path(hotice.__file__).resolve().parent
ROOT = PACKAGE.parent
MODULES = ("hotice.errors", "hotice.model.builder", "hotice.model.frames", "hotice.model.g1")
"""Public modules that are no packages."""
DOCUMENTS = ("README.md", "CONTRIBUTING.md", "docs/**/*.md", "hotice/**/*.md", "notebooks/*.ipynb")
FOLDERS = "hotice|tests|docs|tools|benchmarks|notebooks"
# names in backticks, single or double; paths may end in a slash
NAME = re.compile(r"`+(hotice(?:\.\w+)+)(?:\(\))?`+")
PATH = re.compile(rf"`+((?:{FOLDERS})/[\w./-]*\w)/?`+")


def faces() -> list[str]:
    """Every package that says by `__all__` what is public in it, and the public modules."""
    packages = [
        ".".join(file.relative_to(ROOT).parent.parts)
        for file in sorted(PACKAGE.rglob("__init__.py"))
        if re.search(r"^__all__ = ", file.read_text(encoding="utf-8"), re.M)
    ]
    return sorted([*packages, *MODULES])


def texts() -> Iterator[tuple[str, str]]:
    """Where and what: every docstring of the package, tests and tools, also of values, and every document."""
    for folder in ("hotice", "tests", "tools", "benchmarks"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if (
                    isinstance(node, ast.Expr)
                    and isinstance(node.value, ast.Constant)
                    and isinstance(node.value.value, str)
                ):
                    yield f"{file.relative_to(ROOT)}:{node.lineno}", node.value.value
    for pattern in DOCUMENTS:
        for file in sorted(ROOT.glob(pattern)):
            for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
                yield f"{file.relative_to(ROOT)}:{number}", line


def exists(name: str) -> bool:
    """Whether a dotted name leads to a module, or to what is in one: a value, a class, a field or method of it."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        path = ROOT.joinpath(*parts[:count])
        if path.with_suffix(".py").is_file() or (path / "__init__.py").is_file():
            value = importlib.import_module(".".join(parts[:count]))
            for part in parts[count:]:
                if is_dataclass(value) and part in value.__dataclass_fields__:
                    return part == parts[-1]
                if not hasattr(value, part):
                    return False
                value = getattr(value, part)
            return True
    return False


def lost() -> list[str]:
    """Names and paths of hotice in backticks that do not exist, with where they stand."""
    found = []
    for where, text in texts():
        found += [f"{where}: {name} does not exist" for name in NAME.findall(text) if not exists(name)]
        found += [f"{where}: no file {path}" for path in PATH.findall(text) if not (ROOT / path).exists()]
    return found


def write(out: Path) -> None:
    """One page for each face. A warning of pdoc is raised as an error."""
    import pdoc

    for name in faces():
        module = importlib.import_module(name)
        for each in module.__all__:
            # lazy names are fetched, so that pdoc finds them in the module
            value = getattr(module, each)
            if isinstance(value, type) and hasattr(value, "_fields"):
                # the constructor of a named tuple is made elsewhere, where its annotations mean nothing
                value.__new__.__module__ = value.__module__
    pdoc.render.configure(docformat="google", footer_text=f"hotice {hotice.__version__}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pdoc.pdoc(*faces(), output_directory=out)


def main() -> int:
    """Exit status: 1 where a name leads nowhere."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the pages")
    out = parser.parse_args().out
    missing = lost()
    for line in missing:
        print(line, file=sys.stderr)
    write(out)
    print(f"{out / 'index.html'}: {len(faces())} faces")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
