"""A pipeline as a YAML file: jobs, their options, and references between them, which are the graph.

    format: hotice-pipeline/1
    out: runs/paper                       # folder of all jobs
    defaults: {train: {num_envs: 4096}}   # options by command
    jobs:
      teacher:
        command: train
        each: train75                     # one copy an item: a list, a scene set or a folder of scenes
        group: 3                          # (optional) so many items share a copy
        options: {scenes: $each}          # the item of the copy
      student:
        command: distill
        # $NAME: output of a job, of all its copies, or of one: $NAME/COPY
        options: {teachers: $teacher, scenes: train75}

The file is parsed, never executed; unknown keys, repeated keys, aliases, loose references and cycles are refused, and
every command line is checked before the first job starts.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from hotice import checks
from hotice.commands.pipeline.jobs import Job, check_argv, option_names, to_argv
from hotice.documents import read_yaml
from hotice.errors import HoticeError, InvalidConfig, UnknownName
from hotice.model.shipped import shipped_sets

FORMAT = "hotice-pipeline/1"
MAX_BYTES = 1 << 20
OWN_OPTIONS = ("out", "resume")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,79}")


@dataclass(frozen=True, kw_only=True)
class Pipeline:
    """Jobs in an order in which they can run. `out` holds their folders."""

    out: Path
    jobs: tuple[Job, ...]


@dataclass(frozen=True, kw_only=True)
class _Copy:
    """A job before its references are resolved."""

    name: str
    command: str
    options: Mapping[str, Any]
    item: list[str]
    cpus: int
    gpus: float


def load_pipeline(path: Path) -> Pipeline:
    """Reads and checks a pipeline. Raises `InvalidConfig` or `InputError`."""
    document = read_yaml(path, MAX_BYTES)
    try:
        return _pipeline(document)
    except HoticeError as error:
        raise InvalidConfig(f"{path}: {error}") from None


def _pipeline(document: Any) -> Pipeline:
    top = checks.mapping("the file", document, ("format", "out", "jobs"), ("defaults",))
    if top["format"] != FORMAT:
        raise InvalidConfig(f"format is {checks.shown(top['format'])}: known is {FORMAT!r}")
    out = Path(str(top["out"])).absolute()
    defaults = {
        command: _options(f"defaults of {command}", command, options)
        for command, options in _named("defaults", top.get("defaults") or {}).items()
    }
    copies: dict[str, list[_Copy]] = {}
    for name, entry in _named("jobs", top["jobs"]).items():
        if not NAME.fullmatch(name):
            raise InvalidConfig(f"job {checks.shown(name)}: a name of letters, digits and _ . + - is needed")
        copies[name] = _copies(name, entry, defaults)
    needs = {name: {r for c in group for r in _references(c.options, copies)} for name, group in copies.items()}
    try:
        order = list(TopologicalSorter(needs).static_order())
    except CycleError as error:
        raise InvalidConfig(f"jobs need each other in a circle: {' -> '.join(reversed(error.args[1]))}") from None
    jobs: dict[str, list[Job]] = {}
    for name in order:
        jobs[name] = [_job(copy, out, jobs) for copy in copies[name]]
    return Pipeline(out=out, jobs=tuple(job for name in order for job in jobs[name]))


def _copies(name: str, entry: Any, defaults: Mapping[str, Mapping[str, Any]]) -> list[_Copy]:
    where = f"job {name!r}"
    entry = checks.mapping(where, entry, ("command",), ("options", "each", "group", "cpus", "gpus"))
    command, cpus, gpus = entry["command"], entry.get("cpus", 1), entry.get("gpus", 0)
    checks.whole(f"{where}: cpus", cpus, checks.COUNT)
    checks.number(f"{where}: gpus", gpus, checks.NOT_NEGATIVE)
    checks.whole(f"{where}: group", entry.get("group", 1), checks.COUNT)
    own = _options(where, command, entry.get("options") or {})
    options = {**defaults.get(command, {}), **own}
    if "threads" in option_names(command):
        options.setdefault("threads", cpus)
    if "each" not in entry:
        return [_Copy(name=name, command=command, options=options, item=[], cpus=cpus, gpus=gpus)]
    items = _items(where, entry["each"])
    count = entry.get("group", 1)
    groups = [[part for item in items[i : i + count] for part in item] for i in range(0, len(items), count)]
    names = [f"{name}/{_label(group)}" for group in groups]
    if repeated := sorted({n for n in names if names.count(n) > 1}):
        raise InvalidConfig(f"{where}: each has {repeated[0]!r} twice")
    return [
        _Copy(name=n, command=command, options=options, item=group, cpus=cpus, gpus=gpus)
        for n, group in zip(names, groups, strict=True)
    ]


def _items(where: str, each: Any) -> list[list[str]]:
    """Items of `each`, every one a list: scenes of a set or of a folder, or what the file lists."""
    if isinstance(each, str):
        sets = shipped_sets()
        files = sorted(str(p) for p in Path(each).glob("*.json")) if each not in sets else list(sets[each])
        if not files:
            raise UnknownName("scene set", each, sets, "a folder that holds scene files, or a list")
        return [[file] for file in files]
    if not isinstance(each, list) or not each:
        raise InvalidConfig(
            f"{where}: each is {checks.shown(each)}: a list, a scene set or a folder of scenes is needed"
        )
    return [[str(part) for part in item] if isinstance(item, list) else [str(item)] for item in each]


def _label(group: list[str]) -> str:
    text = "+".join(Path(item).name.removesuffix(".json") for item in group)
    text = re.sub(r"[^A-Za-z0-9_.+-]", "_", text).lstrip("._+-") or "item"
    return text if len(text) <= 60 else f"{text[:50]}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def _job(copy: _Copy, out: Path, before: Mapping[str, list[Job]]) -> Job:
    """Resolves references: to folders' names for the hash, to paths for the command line."""
    needed: list[Job] = []

    def outputs(reference: str) -> list[str]:
        jobs = [job for job in before[reference.split("/")[0]] if reference in (job.name, job.name.split("/")[0])]
        needed.extend(jobs)
        return [str(job.output) for job in jobs]

    options = {k: _resolve(v, copy, outputs) for k, v in copy.options.items()}
    relative = json.dumps([copy.command, options]).replace(json.dumps(str(out))[1:-1], "")
    key = hashlib.sha256(relative.encode()).hexdigest()[:10]
    folder = out / f"{copy.name.replace('/', '-')}-{key}"
    job = Job(
        name=copy.name,
        command=copy.command,
        argv=(),
        needs=tuple(dict.fromkeys(j.name for j in needed)),
        folder=folder,
        cpus=copy.cpus,
        gpus=copy.gpus,
    )
    given = {**options, "out": str(job.output)}
    if "resume" in option_names(copy.command):
        given["resume"] = True
    argv = tuple(to_argv(given))
    try:
        check_argv(copy.command, argv)
    except InvalidConfig as error:
        raise InvalidConfig(f"job {copy.name!r}: {error}") from None
    return Job(**{**vars(job), "argv": argv})


def _resolve(value: Any, copy: _Copy, outputs: Any) -> Any:
    """An option's value with its references replaced; those to several things become several values."""
    if isinstance(value, list):
        found = [_resolve(part, copy, outputs) for part in value]
        return [x for part in found for x in (part if isinstance(part, list) else [part])]
    if not (isinstance(value, str) and value.startswith("$")):
        return value
    several = copy.item if value == "$each" else outputs(value[1:])
    if not several:
        raise InvalidConfig(f"job {copy.name!r}: $each stands for the items of 'each', which is missing")
    return several if len(several) > 1 else several[0]


def _references(options: Mapping[str, Any], copies: Mapping[str, list[_Copy]]) -> set[str]:
    """Jobs that options refer to. Raises `InvalidConfig` for one that is not there."""
    found = set()
    for value in options.values():
        for part in value if isinstance(value, list) else [value]:
            if not (isinstance(part, str) and part.startswith("$")) or part == "$each":
                continue
            name = part[1:].split("/")[0]
            if part[1:] not in copies and part[1:] not in {c.name for c in copies.get(name, [])}:
                known = [*copies, *(c.name for group in copies.values() for c in group)]
                raise UnknownName("job", part[1:], set(known))
            found.add(name)
    return found


def _options(where: str, command: Any, given: Any) -> Mapping[str, Any]:
    names = option_names(command) - set(OWN_OPTIONS)
    options = _named(f"options of {where}", given)
    for name, value in options.items():
        if name in OWN_OPTIONS:
            raise InvalidConfig(f"{where}: the pipeline chooses {name!r} itself")
        if name not in names:
            raise InvalidConfig(f"{where}: {UnknownName(f'option of {command}', name, names)}")
        if not all(isinstance(v, (str, int, float, bool)) for v in (value if isinstance(value, list) else [value])):
            raise InvalidConfig(f"{where}: {name} is {checks.shown(value)}: a value or a list of values is needed")
    return options


def _named(where: str, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise InvalidConfig(f"{where}: names with values are needed, not {type(value).__name__}")
    return value
