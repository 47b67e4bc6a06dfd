"""The two protocols of evaluation: physics and perturbations, as tasks and as compiled models."""

from dataclasses import replace

import mujoco
import pytest

from hotice.errors import UnknownName
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.config import EvaluateConfig
from hotice.evaluate.start import start_trials
from hotice.model import load_scene
from hotice.model.dynamics import TRAINING_PALMS, DynamicsConfig, student_dynamics
from hotice.sim import TaskConfig
from hotice.task.protocols import PROTOCOLS, get_protocol

COARSE = TaskConfig(physics_dt_s=0.01, substeps=2)


@pytest.mark.parametrize("task", [TaskConfig(), COARSE])
def test_physics_does_not_depend_on_the_training_s(task):
    robot, paper = (get_protocol(name).task(task) for name in ("robot", "paper"))
    assert (robot.physics_dt_s, robot.substeps) == (0.002, 10)
    assert (paper.physics_dt_s, paper.substeps) == (0.005, 4)


def test_perturbations_but_dynamics_are_those_of_training():
    for protocol in PROTOCOLS.values():
        asked = protocol.task(TaskConfig())
        known = replace(TaskConfig().perturbed(), physics_dt_s=asked.physics_dt_s, substeps=asked.substeps)
        assert replace(asked, dynamics=known.dynamics) == known
        assert asked.dynamics == protocol.dynamics


@pytest.mark.parametrize("name, palms", [("robot", 0.9), ("paper", 2.0)])
def test_without_dynamics_robots_are_the_protocol_s_own(name, palms, states):
    for asked in (Conditions(protocol=name, without=("dynamics",)), Conditions(protocol=name, perturbed=False)):
        env = start_trials(load_scene("open_floor"), states[:2], 0, asked)
        for model in env.carry.models:
            assert {model.geom(f"{s}_palm_{i}").friction[0] for s in ("left", "right") for i in range(4)} == {palms}
    assert PROTOCOLS[name].task(TaskConfig(), perturbed=False).push_m_s == 0.0


def test_models_of_the_protocols(states):
    """Cones, steps and iterations of what is compiled, also on the open floor; palms within what is said."""
    scene = load_scene("open_floor")
    for name, cone, step, palms in (
        ("robot", mujoco.mjtCone.mjCONE_ELLIPTIC, 0.002, (0.6, 1.2)),
        ("paper", mujoco.mjtCone.mjCONE_PYRAMIDAL, 0.005, (2.0, 2.0)),
    ):
        env = start_trials(scene, 6 * states[:1], 0, Conditions(protocol=name))
        felt = {m.geom("left_palm_0").friction[0] for m in env.carry.models}
        assert all(palms[0] <= f <= palms[1] for f in felt) and (len(felt) == 6 or name == "paper")
        assert all(m.opt.cone == cone and m.opt.timestep == step for m in env.carry.models)
        assert all(m.opt.iterations == (100 if name == "robot" else 10) for m in env.carry.models)
        assert env.physics.self_depth is not None


def test_an_unknown_protocol_is_refused():
    with pytest.raises(UnknownName, match="papers.*robot"):
        get_protocol("papers")
    with pytest.raises(UnknownName):
        EvaluateConfig(policy="student", scenes=("gap",), protocol="real")


def test_palms_of_training_follow_the_physics_step():
    assert student_dynamics(0.005).palm_friction == TRAINING_PALMS[0.005] == student_dynamics(0.002).palm_friction
    assert student_dynamics(0.01).palm_friction == TRAINING_PALMS[0.01] == COARSE.perturbed().dynamics.palm_friction
    assert TaskConfig().perturbed().dynamics != DynamicsConfig()
