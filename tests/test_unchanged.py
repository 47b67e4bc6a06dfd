"""What must not change while the house is rearranged, as hashes: training, scores, a station, an exported policy.

Hashes hold on the kind of machine, and with the packages, that they were recorded with; elsewhere the comparison is
skipped. `HOTICE_RECORD=1 pytest tests/test_unchanged.py` records them anew: do that where a change is meant, and say so
in its commit.
"""

import hashlib
import importlib.metadata
import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import numpy_helper
from pydrake.systems.analysis import Simulator
from safetensors.numpy import load_file

from hotice.systems import StationConfig, make_station

pytestmark = pytest.mark.slow
RECORDED = Path(__file__).parent / "unchanged.json"
PACKAGES = ("numpy", "torch", "mujoco", "drake", "onnx", "numba", "scipy", "onnxruntime")
TRAIN = (
    "train --scenes open_floor gap --num-envs 8 --steps 8 --minibatches 2 --hidden 16 --critic-hidden 16 --threads 1 "
    "--carry-states 2 --episode-s 0.6 --perturbed --scan --history 2 --goal-stay-s 0.1 --seed 3 --updates 3 --out run"
)
EVALUATE = "evaluate --policy student --scenes gap beam --rollouts 3 --threads 1 --horizon-s 1.0 --seed 2 --out r.json"


def machine():
    cpu = next((x for x in Path("/proc/cpuinfo").read_text().splitlines() if x.startswith("flags")), "")
    flags = sorted(f for f in cpu.split() if f.startswith(("avx", "fma", "amx")))
    return {
        "cpu": f"{platform.machine()} {' '.join(flags)}",
        "packages": {name: importlib.metadata.version(name) for name in PACKAGES},
    }


def digest(*parts):
    total = hashlib.sha256()
    for part in parts:
        total.update(part if isinstance(part, bytes) else str(part).encode())
    return total.hexdigest()[:16]


def command(folder, line):
    subprocess.run([sys.executable, "-m", "hotice.learn", *line.split()], cwd=folder, check=True, capture_output=True)


def arrays(tensors):
    return [x for name in sorted(tensors) for x in (name, np.ascontiguousarray(tensors[name]).tobytes())]


def report(content):
    """A report without what may change: when, where, at which commit and how fast it was made."""
    keep = ("seed", "rollouts", "success_rate", "mean_distance_m", "protocol", "referees", "scenes", "policy")
    return json.dumps({k: content[k] for k in keep if k in content}, sort_keys=True)


@pytest.fixture(scope="module")
def hashes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("unchanged")
    command(folder, TRAIN)
    (checkpoint,) = (folder / "run").glob("checkpoint-0000003")
    (tensors,) = checkpoint.glob("*.safetensors")
    command(folder, "export --policy run --out policy.onnx")
    graph = onnx.load(folder / "policy.onnx").graph
    command(folder, EVALUATE)
    setup = folder / "station.yaml"
    setup.write_text("{scene: beam, sensing: student, dynamics: robot, push_m_s: 1.0, seed: 4}\n")
    station = make_station(StationConfig.load(setup), controller="policy")
    simulator = Simulator(station)
    adaptor = station.GetSubsystemByName("state_adaptor")
    states = []
    for k in range(51):
        simulator.AdvanceTo(0.02 * k)
        port = adaptor.GetOutputPort("robot_state")
        states.append(port.Eval(adaptor.GetMyContextFromRoot(simulator.get_context())).copy())
    return {
        "training": digest(*arrays(load_file(tensors))),
        "policy": digest(*arrays({x.name: numpy_helper.to_array(x) for x in graph.initializer})),
        "report": digest(report(json.loads((folder / "r.json").read_text()))),
        "station": digest(np.array(states).tobytes()),
    }


def test_nothing_has_changed(hashes):
    if os.environ.get("HOTICE_RECORD"):
        RECORDED.write_text(json.dumps({"machine": machine(), "hashes": hashes}, indent=2) + "\n")
    recorded = json.loads(RECORDED.read_text())
    if recorded["machine"] != machine():
        pytest.skip("recorded with other packages or on another kind of processor")
    assert hashes == recorded["hashes"]
