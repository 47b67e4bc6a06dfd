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
resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
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
    # an ordinary user without an allowance; imports come first, files may be another user's
    assert said(CODE.replace("print(", NOBODY + "print(")) == (False, 0)
