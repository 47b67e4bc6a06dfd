"""Runs command lines of hotice in this process, one after another, as told on standard input.

A request is a line of JSON: `argv`, `cwd`, `limit_s`. The answer is one too: `status`, `out`, `err`. Where a line
takes longer than its limit, this process writes the stacks of all threads and ends; memory is limited from the start.
"""

import faulthandler
import json
import os
import resource
import signal
import sys
import traceback
from pathlib import Path

MEMORY_BYTES = 3 * 2**30
"""How much a line may allocate beyond what the imported packages take."""

CPU_S = 20.0
"""How long a line may compute; a machine that is busy with other things makes it no slower."""


def limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def run(argv: list[str]) -> int:
    """Exit status of a command line, as `python -m hotice.learn` would give it."""
    from hotice.commands.program import main
    from hotice.errors import HoticeError
    from hotice.failures import one_line

    try:
        if argv[:1] and argv[0].startswith("load:"):
            load(argv[0].removeprefix("load:"), Path(argv[1]))
            return 0
        return main(argv)
    except HoticeError as error:
        print(one_line(f"hotice: {error}"), file=sys.stderr)
        return 2
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
            return 1
        return end.code or 0
    except BaseException:
        traceback.print_exc()
        return 1


def load(kind: str, path: Path) -> None:
    """Reads a file as the command would that begins to work after it."""
    if kind == "station":
        from hotice.systems.setup.config import StationConfig

        StationConfig.load(path)
    elif kind == "pipeline":
        from hotice.commands.pipeline.file import load_pipeline

        load_pipeline(path)
    elif kind == "record":
        from hotice.replay import RolloutRecord

        RolloutRecord.load(path)
    elif kind == "fields":
        from hotice.fields import cache

        cache.load(path.parent, path.stem)
    elif kind == "plan":
        from hotice.control.pick_plan import cache

        cache.load(path.parent, path.stem)
    elif kind == "trials":
        from hotice.evaluate import read_trials

        read_trials(path.parent)
    elif kind == "log":
        from hotice.deploy.log.reader import read_log

        read_log(path.parent, "guard")
    elif kind == "cloud":
        from hotice.model.importers.formats import octomap, pcd, ply

        content = path.read_bytes()
        readers = {".pcd": pcd.read_pcd, ".ply": ply.read_ply, ".bt": lambda data: octomap.read_octomap(data, 0.05)}
        readers[path.suffix](content)
    elif kind == "mesh":
        from hotice.model.importers.meshes import read_triangles

        read_triangles(path.read_bytes(), path.suffix)
    else:
        raise AssertionError(kind)


def serve(answers: int, out: Path, err: Path) -> None:
    for request in map(json.loads, sys.stdin):
        for path, fd in ((out, 1), (err, 2)):
            file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(file, fd)
            os.close(file)
        os.chdir(request["cwd"])
        faulthandler.dump_traceback_later(request["limit_s"], exit=True)
        signal.setitimer(signal.ITIMER_PROF, CPU_S)
        status = run(request["argv"])
        signal.setitimer(signal.ITIMER_PROF, 0)
        faulthandler.cancel_dump_traceback_later()
        sys.stdout.flush()
        sys.stderr.flush()
        said = {"out": out.read_text(errors="replace"), "err": err.read_text(errors="replace")}
        os.write(answers, (json.dumps({"status": status, **said}) + "\n").encode())


if __name__ == "__main__":
    answers = os.dup(1)
    import hotice.commands.table  # noqa: F401 - before the limit, which counts from here
    import hotice.learn.policy  # noqa: F401
    import hotice.model.importers.scene_import  # noqa: F401

    faulthandler.register(signal.SIGPROF, chain=True)  # the chain ends with the default: to end the process
    limit_memory()
    serve(answers, Path(sys.argv[1]), Path(sys.argv[2]))
