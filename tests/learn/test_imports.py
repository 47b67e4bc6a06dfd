import subprocess
import sys

import pytest

HEAVY = (
    "pydrake",
    "pinocchio",
    "coal",
    "trimesh",
    "matplotlib",
    "onnx",
    "onnxruntime",
    "onnxscript",
    "gymnasium",
    "tensorboard",
)


def loaded_by(statement):
    code = f"import sys; {statement}; print(' '.join(m for m in {HEAVY!r} if m in sys.modules))"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()


def test_importing_learn_is_light():
    assert loaded_by("import hotice.learn") == []


def test_training_needs_no_analysis_library():
    heavy = loaded_by("import hotice.learn.ppo.dual_ppo, hotice.evaluate.run, hotice.commands.table, hotice.sim")
    assert not set(heavy) & {"pydrake", "pinocchio", "coal", "trimesh", "matplotlib", "onnx", "onnxscript"}


ABSENT = (
    "pydrake",
    "pinocchio",
    "coal",
    "hppfcl",
    "fcl",
    "casadi",
    "adam",
    "meshcat",
    "trimesh",
    "osqp",
    "proxsuite",
    "example_robot_data",
    "ray",
    "gymnasium",
    "matplotlib",
    "onnx",
    "onnxruntime",
    "onnxscript",
    "cyclonedds",
    "cv2",
    "imageio_ffmpeg",
    "IPython",
    "ipywidgets",
)
"""What a bare GPU node lacks."""

BARE_NODE = f"""
import sys

class Lacking:
    # finds what the finder that it stands for finds, but for what is absent

    def __init__(self, finder):
        self.finder = finder

    def find_spec(self, name, path=None, target=None):
        return None if name.split(".")[0] in {ABSENT!r} else self.finder.find_spec(name, path, target)

sys.meta_path[:] = [Lacking(finder) for finder in sys.meta_path]

import socket
class NoNetwork(socket.socket):
    def connect(self, *address):
        raise OSError("no network")
socket.socket = NoNetwork

import hotice.learn, hotice.sim, hotice.model
from hotice.commands.program import main
for options in sys.argv[1:]:
    assert main(options.split()) == 0
assert not any(name.split(".")[0] in {ABSENT!r} for name in sys.modules)
print("trained")
"""


def test_a_bare_node_trains(tiny_options, tmp_path):
    """No Drake, Pinocchio, collision or mesh package, no network: an update of dual PPO, of a student, and of its
    fine-tuning."""
    more = {"train": "--curriculum-distance-m 1", "distill": "--generalist train", "finetune": "--init distill"}
    tiny = f"{' '.join(tiny_options)} --updates 1 --scenes gap"
    commands = [f"{name} {tiny} {options} --out {name}" for name, options in more.items()]
    done = subprocess.run(
        [sys.executable, "-c", BARE_NODE, *commands], capture_output=True, text=True, timeout=500, cwd=tmp_path
    )
    assert done.returncode == 0 and done.stdout.split()[-1] == "trained", done.stderr
    assert all((tmp_path / name / "checkpoint-0000001" / "meta.json").is_file() for name in more)


@pytest.mark.slow
@pytest.mark.parity
def test_a_bare_node_trains_on_warp(tiny_options, tmp_path):
    """The same with the physics of a GPU, here on the CPU: MuJoCo Warp needs none of the absent either."""
    pytest.importorskip("mujoco_warp")
    command = f"train {' '.join(tiny_options)} --updates 1 --scenes gap --physics warp --device cpu --out warp"
    done = subprocess.run(
        [sys.executable, "-c", BARE_NODE, command], capture_output=True, text=True, timeout=500, cwd=tmp_path
    )
    assert done.returncode == 0 and done.stdout.split()[-1] == "trained", done.stderr
    assert (tmp_path / "warp" / "checkpoint-0000001" / "meta.json").is_file()


def test_the_absent_are_really_absent():
    """Else the tests above would prove nothing."""
    code = BARE_NODE.split("import hotice.learn")[0]
    for name in ("pydrake", "trimesh.creation", "pinocchio", "onnx"):
        done = subprocess.run(
            [sys.executable, "-c", f"{code}\nimport {name}"], capture_output=True, text=True, timeout=60
        )
        assert done.returncode != 0 and "ModuleNotFoundError" in done.stderr
