"""Runs command lines of hotice in this process, one after another, as told on standard input.

A request is a line of JSON: `argv`, `cwd`, `limit_s`. The answer is one too: `status`, `out`, `err`. Where a line
takes longer than its limit, this process writes the stacks of all threads and ends; memory is limited from the start.
"""

import faulthandler
import json
import os
import resource
import sys
import traceback
from pathlib import Path

MEMORY_BYTES = 3 * 2**30
"""How much a line may allocate beyond what the imported packages take."""


def limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def run(argv: list[str]) -> int:
    """Exit status of a command line, as `python -m hotice.learn` would give it."""
    from hotice.commands.program import main

    try:
        return main(argv)
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
            return 1
        return end.code or 0
    except BaseException:
        traceback.print_exc()
        return 1


def serve(answers: int, out: Path, err: Path) -> None:
    for request in map(json.loads, sys.stdin):
        for path, fd in ((out, 1), (err, 2)):
            file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(file, fd)
            os.close(file)
        os.chdir(request["cwd"])
        faulthandler.dump_traceback_later(request["limit_s"], exit=True)
        status = run(request["argv"])
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

    limit_memory()
    serve(answers, Path(sys.argv[1]), Path(sys.argv[2]))
