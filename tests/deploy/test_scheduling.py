"""Priority and memory of the deployment's programs."""

import subprocess
import sys

import pytest

CODE = """
from hotice.deploy.guard.scheduling import stay_in_memory
print(stay_in_memory(), next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmLck")))
"""
NOBODY = """
import os, resource
resource.setrlimit(resource.RLIMIT_MEMLOCK, (MOST, MOST))
if os.geteuid() == 0:
    os.setuid(65534)
"""


def said(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    kept, locked_kb = done.stdout.split()
    return kept == "True", int(locked_kb)


@pytest.mark.skipif(sys.platform != "linux", reason="Linux keeps memory so")
def test_memory_is_kept_where_it_is_allowed_and_told_where_it_is_not():
    kept, locked_kb = said(CODE)
    assert kept == (locked_kb > 5000)


@pytest.mark.skipif(sys.platform != "linux", reason="Linux keeps memory so")
@pytest.mark.parametrize("kb", [0, 4096])
def test_a_limit_is_told_and_not_run_into_later(kb):
    """An ordinary user's; imports come before it, since files may be another user's."""
    limited = NOBODY.replace("MOST", str(1024 * kb))
    assert said(CODE.replace("print(", limited + "print(")) == (False, 0)
