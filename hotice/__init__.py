"""hotice: a Unitree G1 carries objects through clutter. Import what you need from the packages below this one."""

import os

__version__ = "0.1.0"

# onnxruntime reports its use to its maker otherwise, and keeps a file for that in the temporary folder
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
