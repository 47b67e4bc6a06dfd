"""Faces of packages: public names that are imported when they are first asked for.

A package lists its names in `__all__` and imports them for type checkers, editors and readers alone:

    if TYPE_CHECKING:
        from hotice.fields.bank import FieldBank
    else:
        __getattr__, __dir__ = lazy_face(__name__)

    __all__ = ["FieldBank"]

So `import hotice.fields` costs nothing, and what it would import lies open. (lazy_loader's stubs do the same from a
second file; PEP 810 will do it in the language.)
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any


def lazy_face(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package, for the names that it imports under `if TYPE_CHECKING:`.

    A name is kept in the package once it was asked for. Raises `AttributeError` for any other name, as modules do.
    """
    module = sys.modules[package]
    homes = dict(_names_for_types(ast.parse(inspect.getsource(module))))

    def __getattr__(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(homes[name]), name)
        setattr(module, name, value)
        return value

    def __dir__() -> list[str]:
        return sorted({*vars(module), *homes})

    return __getattr__, __dir__


def _names_for_types(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Name and module of every `from module import name` under `if TYPE_CHECKING:`."""
    for statement in tree.body:
        if (
            isinstance(statement, ast.If)
            and isinstance(statement.test, ast.Name)
            and statement.test.id == "TYPE_CHECKING"
        ):
            for node in statement.body:
                if isinstance(node, ast.ImportFrom) and node.module:
                    yield from ((alias.name, node.module) for alias in node.names)
