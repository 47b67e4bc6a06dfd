"""Files from elsewhere are parsed, never executed: nothing in the package can unpickle, or run code that a file
brings."""

import ast
import pickle
from pathlib import Path

import pytest

import hotice

PACKAGE = Path(hotice.__file__).parent
MODULES = (
    "pickle",
    "_pickle",
    "cPickle",
    "pickletools",
    "dill",
    "cloudpickle",
    "joblib",
    "marshal",
    "shelve",
    "jsonpickle",
)
NEVER = (
    "eval",
    "exec",
    "builtins.eval",
    "builtins.exec",
    "pandas.read_pickle",
    "torch.jit.load",
    "torch.hub.load",
    "torch.package.PackageImporter",
    "yaml.unsafe_load",
    "yaml.unsafe_load_all",
    "yaml.full_load",
    "yaml.full_load_all",
    "numpy.lib.format.read_array",
    "torch.serialization.load",
    "torch.storage._load_from_bytes",
    "scipy.io.loadmat",
)
SAFE_LOADERS = {"yaml.SafeLoader", "yaml.CSafeLoader", "yaml.BaseLoader"}


class Scan(ast.NodeVisitor):
    """Collects what can run code from a file: `found` holds (line, name)."""

    def __init__(self, source):
        self.names, self.safe = {}, set(SAFE_LOADERS)
        for _ in range(2):  # the second time all names are known
            self.found = []
            self.visit(ast.parse(source))

    def visit_Import(self, node):
        for each in node.names:
            self.names[each.asname or each.name.split(".")[0]] = each.name if each.asname else each.name.split(".")[0]
            self._module(node, each.name)

    def visit_ImportFrom(self, node):
        for each in node.names:
            self.names[each.asname or each.name] = f"{node.module}.{each.name}"
            self._module(node, f"{node.module}.{each.name}")

    def visit_ClassDef(self, node):
        if any(self._name(base) in self.safe for base in node.bases):
            self.safe.add(node.name)
        self.generic_visit(node)

    def visit_Call(self, node):
        name, given = self._name(node.func), {k.arg: k.value for k in node.keywords}
        if name in NEVER or (name == "torch.load" and not self._is(given.get("weights_only"), True)):
            self.found.append((node.lineno, name))
        if name in ("numpy.load", "numpy.fromfile") and not self._is(
            given.get("allow_pickle", ast.Constant(False)), False
        ):
            self.found.append((node.lineno, name))
        if name in ("yaml.load", "yaml.load_all"):
            loader = given.get("Loader", node.args[1] if len(node.args) > 1 else None)
            if loader is None or self._name(loader) not in self.safe:
                self.found.append((node.lineno, name))
        if name in ("importlib.import_module", "__import__") and node.args:
            text = ast.unparse(node.args[0])
            self.found += [(node.lineno, f"{name}({text})")] if any(m in text for m in MODULES) else []
        self.generic_visit(node)

    def visit_Attribute(self, node):
        """Also without a call: `load = torch.jit.load`."""
        if self._name(node) in NEVER:
            self.found.append((node.lineno, self._name(node)))
        self.generic_visit(node)

    def _module(self, node, name):
        if name.split(".")[0] in MODULES or name in NEVER:
            self.found.append((node.lineno, name))

    def _name(self, node):
        """Dotted name with its imports resolved; "" for anything else."""
        parts = []
        while isinstance(node, ast.Attribute):
            parts.append(node.attr)
            node = node.value
        if not isinstance(node, ast.Name):
            return ""
        return ".".join([self.names.get(node.id, node.id), *reversed(parts)])

    @staticmethod
    def _is(node, value):
        return isinstance(node, ast.Constant) and node.value is value


def test_nothing_in_the_package_can_unpickle():
    files = sorted(PACKAGE.rglob("*.py"))
    assert len(files) > 100
    found = {str(f.relative_to(PACKAGE)): s.found for f in files if (s := Scan(f.read_text())).found}
    assert found == {}


BAD = (
    "import pickle",
    "import _pickle as p",
    "from pickle import loads",
    "import joblib.numpy_pickle",
    "from dill import load",
    "import torch\ntorch.load(path)",
    "import torch as t\nt.load(path, weights_only=False)",
    "from torch import load\nload(path)",
    "import torch\ntorch.load(path, weights_only=flag)",
    "import torch.jit\ntorch.jit.load(path)",
    "import numpy as np\nnp.load(path, allow_pickle=True)",
    "from numpy import load\nload(path, allow_pickle=flag)",
    "import yaml\nyaml.load(text)",
    "import yaml\nyaml.load(text, yaml.Loader)",
    "import yaml\nyaml.load(text, Loader=yaml.FullLoader)",
    "from yaml import unsafe_load\nunsafe_load(text)",
    "import yaml\nclass L(yaml.Loader): pass\nyaml.load(text, L)",
    "eval(text)",
    "exec(text)",
    "import pandas as pd\npd.read_pickle(path)",
    "import torch\nload = torch.jit.load",
    "import importlib\nimportlib.import_module('pickle')",
    "def f():\n    import marshal",
)
GOOD = (
    "import yaml\nyaml.load(text, L)\nclass L(yaml.SafeLoader): pass",
    "import torch\ntorch.load(path, weights_only=True)",
    "import numpy as np\nnp.load(path)",
    "net.eval()",
    "self.load(path)",
    "import numpy as np\nnp.load(path, allow_pickle=False)",
    "import yaml\nyaml.safe_load(text)",
    "import json\njson.load(f)",
    "import yaml\nclass L(yaml.SafeLoader): pass\nyaml.load(text, L)",
    "import yaml\nyaml.load(text, Loader=yaml.SafeLoader)",
    "from safetensors.torch import load\nload(content)",
)


@pytest.mark.parametrize("source", BAD)
def test_the_scan_finds_what_it_should(source):
    assert Scan(source).found


@pytest.mark.parametrize("source", GOOD)
def test_and_nothing_else(source):
    assert Scan(source).found == []


class Bomb:
    """Runs code when it is unpickled."""

    def __reduce__(self):
        return (open, ("exploded", "w"))


@pytest.mark.parametrize("suffix", [".onnx", ".json", ".yaml", ".npz", ""])
def test_a_pickle_under_any_name_is_refused_and_not_run(suffix, tmp_path, monkeypatch, capfd):
    from hotice.commands.program import main

    monkeypatch.chdir(tmp_path)
    path = tmp_path / f"bomb{suffix}"
    path.write_bytes(pickle.dumps(Bomb()))
    folder = tmp_path / "checkpoint-0000001"
    folder.mkdir()
    for name in ("meta.json", "tensors.safetensors"):
        (folder / name).write_bytes(path.read_bytes())
    for argv in (
        ["evaluate", "--policy", str(path), "--scenes", "open_floor"],
        ["evaluate", "--policy", "carry", "--scenes", str(path)],
        ["evaluate", "--policy", str(folder), "--scenes", "open_floor"],
        ["pipeline", str(path)],
        ["scene", "check", str(path)],
    ):
        assert main(argv) in (1, 2), argv  # 1: a scene that is checked and wrong
    assert not (tmp_path / "exploded").exists()
