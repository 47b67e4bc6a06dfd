"""What draws without a screen: EGL, else OSMesa; on other systems than Linux what MuJoCo takes there."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from ctypes.util import find_library
from functools import lru_cache
from typing import Any

from hotice.errors import HoticeError

CHOICES = {"egl": "mujoco.egl", "osmesa": "mujoco.osmesa"} if sys.platform == "linux" else {"own": "mujoco.gl_context"}
"""Module of each, the better one first."""
LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
PROBE_S = 60.0
_PROBE = """
import importlib, mujoco, sys
context = importlib.import_module(sys.argv[1]).GLContext(16, 16)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), mujoco.mjtFontScale.mjFONTSCALE_100.value).free()
context.free()
"""


class NoRenderer(HoticeError):
    """Nothing on this machine draws without a screen."""


@lru_cache
def find_renderer() -> tuple[str, str]:
    """Name of what draws (a key of `CHOICES`), and why nothing better does, empty for the best.

    Each is tried in a process of its own: libraries of OpenGL cannot be loaded twice, and some drivers end a process.
    `MUJOCO_GL`, where it names one of them, leaves that one alone.

    Raises:
        NoRenderer: none of them draws.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    faults = []
    for name in [wanted] if wanted in CHOICES else CHOICES:
        fault = _fault(name)
        if not fault:
            return name, "; ".join(faults)
        faults.append(f"{name}: {fault}")
    raise NoRenderer(
        f"a film needs OpenGL, and nothing draws without a screen here ({'; '.join(faults)}): on Linux install EGL "
        "with a driver (Debian and Ubuntu: apt install libegl1 libgl1-mesa-dri, which draws in software where there "
        "is no graphics card)"
    )


def open_context(width: int, height: int) -> Any:
    """A context of OpenGL to draw in, which is to be made current and freed. Raises `NoRenderer`."""
    name, _ = find_renderer()
    return importlib.import_module(CHOICES[name]).GLContext(width, height)


def _fault(name: str) -> str:
    """Why one does not draw, in a line; empty: it does."""
    command = [sys.executable, "-c", _PROBE, CHOICES[name]]
    try:
        tried = subprocess.run(command, capture_output=True, text=True, timeout=PROBE_S)
    except subprocess.TimeoutExpired:
        return f"does not answer within {PROBE_S:g} s"
    if tried.returncode == 0:
        return ""
    if name in LIBRARIES and find_library(LIBRARIES[name]) is None:
        return f"lib{LIBRARIES[name]} is not found"
    return (tried.stderr.strip().splitlines() or [f"ends with {tried.returncode}"])[-1]
