import subprocess
import sys

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
    heavy = loaded_by("import hotice.learn.dual_ppo, hotice.learn.evaluate, hotice.learn.commands, hotice.sim")
    assert not set(heavy) & {"pydrake", "pinocchio", "coal", "trimesh", "matplotlib", "onnx", "onnxscript"}
