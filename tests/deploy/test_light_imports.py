import subprocess
import sys

HEAVY = ("torch", "mujoco", "numba", "scipy", "pydrake", "pinocchio", "onnxruntime", "cyclonedds", "cv2")
MODULES = (
    "command",
    "switcher",
    "link.memory",
    "link.publishers",
    "messages.remote",
    "dds.link",
    "dds.service",
    "guard.process",
    "guard.keyboard",
    "guard.dry",
    "slot.slot",
    "programs.guard",
)


def test_messages_links_and_guard_need_numpy_alone():
    """What keeps sending while everything else is down must not depend on it; cyclonedds comes with a node."""
    imports = ", ".join(f"hotice.deploy.{name}" for name in MODULES)
    code = f"import sys, {imports}; print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
