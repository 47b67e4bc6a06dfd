"""The deployment beside the evaluator: the same trials, and the same observations of the same states."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.evaluated import become, evaluated_trials, next_pushes
from hotice.deploy.clock import SimulatedClock
from hotice.deploy.frames import Pose, lidar_in_pelvis
from hotice.deploy.guard.modes import Mode
from hotice.deploy.link.memory import MemoryBus
from hotice.deploy.programs.prepare import Prepared, estimator_of
from hotice.deploy.runner import RobotRunner
from hotice.deploy.simulated import SimulatedRobot, SimulatedRobotConfig
from hotice.deploy.slot.records import STATUS
from hotice.deploy.sources import MemorySource, PoseSample, TagSample
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.start import CPU
from hotice.fields import build_hod_pf
from hotice.fields.bank import FieldBank
from hotice.learn.policy import load_policy
from hotice.model import builder, g1, load_scene
from hotice.model.dynamics import ROBOT_DYNAMICS, perturb
from hotice.model.robot_state import RobotState
from hotice.policy import PolicyTask, open_policy
from hotice.sim.carry_bank import CarryBank
from hotice.sim.env import TransportEnv
from hotice.sim.events import push
from hotice.task.sensing import STUDENT_SENSING
from tests.deploy.simulated_fixture import carry

pytest.importorskip("cv2", reason="tags need the extra `deploy`")
BOX = (0.3, 0.3, 0.25, 1.5)
STEPS, SEED = 12, 7
NOISELESS = replace(
    STUDENT_SENSING,
    gyro_rad_s=1e-9,
    **dict.fromkeys(("joint_pos_rad", "joint_vel_rad_s", "gravity", "object_pos_m", "object_rot_rad"), 0.0),
    **dict.fromkeys(("root_pos_m", "root_yaw_rad", "action_delay_s"), 0.0),
    sensor_delay_steps=0,
)
"""The student's sensing, filters and rates and all, but without noise and delays; a gyro that is exact would have
gravity taken as it is measured."""


class Deployed:
    """A runner whose robot is put into states from outside."""

    def __init__(self, scene, policy):
        self.clock = SimulatedClock()
        self.poses = MemorySource(self.clock, PoseSample.decode)
        self.tags = MemorySource(self.clock, TagSample.decode)
        config = SimulatedRobotConfig(box=BOX, noise="none")
        self.robot = SimulatedRobot(
            config, MemoryBus(self.clock).robot(), pose=self.poses, tags=self.tags, carry=carry(BOX), scene=scene
        )
        opened = open_policy(policy)
        task = PolicyTask.from_meta(opened.meta, opened.name)
        made = Prepared(opened, build_hod_pf(scene, task.resolution_m, task.margin_m), carry(BOX))
        self._status, self.put = np.zeros((), STATUS), []
        self._status["mode"] = Mode.CARRY
        estimator = estimator_of(made, self.poses, self.tags)
        self.runner = RobotRunner(
            made.policy, made.pf, made.carry, estimator, lambda: self._status, self.put.append, self.clock
        )
        self.runner.warm()

    def see(self, state: RobotState, localized: bool):
        """One tick in a state, with tags, and with localization or without."""
        world, number = self.robot.world, int(self._status["sequence"]) + 1
        world.place(state)
        ids, corners = self.robot.sight.look()
        self.tags.send(
            TagSample(number=number, measured_s=self.clock.now(), ids=np.array(ids), corners_px=corners).encode()
        )
        if localized:
            lidar = Pose.of(state.p_WP, state.quat_WP) @ lidar_in_pelvis(np.zeros(3))
            self.poses.send(
                PoseSample(number=number, measured_s=self.clock.now(), p_ML=lidar.p, quat_ML=lidar.quat).encode()
            )
        self._status["sequence"] = number
        self._status["state"] = self.robot.states.write(np.zeros(40, np.uint8), np.ones(29, bool))
        self.runner.tick()
        self.clock.sleep(0.02)
        return self.runner.policy.observation, self.runner.policy.action


def state_of(env) -> RobotState:
    """The one robot of an environment, with the joints that are welded there."""
    q, v, layout = env.physics.qpos[0].numpy(), env.physics.qvel[0].numpy(), env.layout
    joints, speeds = np.zeros(29), np.zeros(29)
    places = [g1.ALL_JOINTS.index(name) for name in g1.ACTION_JOINTS]
    joints[[g1.ALL_JOINTS.index(name) for name in g1.WRIST_JOINTS]] = carry(BOX).wrist_pos
    joints[places], speeds[places] = q[7:27], v[6:26]
    return RobotState(
        p_WP=q[:3],
        quat_WP=q[3:7],
        v_WP=v[:3],
        w_WP_P=v[3:6],
        joint_pos=joints,
        joint_vel=speeds,
        carried=carry(BOX).carried,
        p_WO=q[layout.object_q : layout.object_q + 3],
        quat_WO=q[layout.object_q + 3 : layout.object_q + 7],
    )


@pytest.mark.parametrize("name", ["gap", "beam"])
def test_observations_are_those_of_the_evaluator(name):
    """Same policy, scene, seed: states of a walk there, through LowState, localization, tags and estimator here."""
    scene, policy = load_scene(name), load_policy("student", threads=1)
    task = replace(Conditions(perturbed=False).task(policy.meta["task"]), sensing=NOISELESS)
    bank = CarryBank.of([carry(BOX)], task.physics_dt_s, CPU, scene=scene, elliptic=True, dynamics=task.dynamics)
    fields = FieldBank.build([scene], task.resolution_m, task.margin_m, workers=1)
    # of both feet either may begin; a runner's clock begins with the left one
    env = TransportEnv(1, fields, bank, policy.meta["preset"], seed=SEED, config=task, threads=1)
    deployed, hold = Deployed(scene, "student"), NOISELESS.hold_steps(task.control_dt_s)
    read, _ = env.reset()
    assert env.memory.phase[0] == 0.0
    for step in range(STEPS):
        seen, action = deployed.see(state_of(env), localized=step % hold == 0)
        assert np.abs(seen - read[0].numpy()).max() < 1e-5, step
        acted = policy.act(read)
        np.testing.assert_allclose(action, np.clip(acted[0].numpy(), -task.action_limit, task.action_limit), atol=1e-5)
        read = env.step(acted).policy
    # it walks: what was compared is no standing robot
    assert np.linalg.norm(env.physics.qvel[0, :2]) > 0.1
    assert deployed.put and deployed.runner.acted


def test_a_robot_of_an_evaluation_with_all_its_joints():
    built = {joints: builder.build_model(carry(BOX).carried, load_scene("gap"), joints=joints) for joints in (20, 29)}
    same = become(builder.build_model(carry(BOX).carried, load_scene("gap"), joints=29), built[20])
    for field in ("body_mass", "body_inertia", "body_ipos", "actuator_gainprm", "actuator_biasprm", "geom_friction"):
        np.testing.assert_array_equal(getattr(same, field), getattr(built[29], field))
    drawn = perturb(built[20], ROBOT_DYNAMICS, np.random.default_rng(1))
    other = become(same, drawn)
    for body in (g1.TORSO_BODY, builder.OBJECT_BODY, "left_wrist_yaw_link"):
        assert other.body(body).mass == drawn.body(body).mass != built[29].body(body).mass
    for joint in ("left_knee_joint", "right_elbow_joint"):
        assert other.joint(joint).frictionloss == drawn.joint(joint).frictionloss > 0.0
        ours, theirs = (m.actuator(joint.removesuffix("_joint")) for m in (other, drawn))
        np.testing.assert_array_equal(ours.gainprm, theirs.gainprm)
        np.testing.assert_array_equal(ours.forcerange, theirs.forcerange)
    assert other.geom("left_sole_0").friction[0] == drawn.geom("left_sole_0").friction[0] != 1.0


def test_pushes_are_told_before_they_come():
    """At the evaluation's rate, and no larger."""
    task = Conditions().task({})
    bank = CarryBank.of([carry(BOX)], task.physics_dt_s, CPU)
    fields = FieldBank.build([load_scene("open_floor")], 0.08, 0.08, workers=1)
    env, sizes = TransportEnv(1, fields, bank, config=task, threads=1), []
    for _ in range(2000):
        before, told = env.physics.qvel[0, :2].numpy().copy(), next_pushes(env)[0]
        push(env.physics, task, env.generator)
        np.testing.assert_allclose(env.physics.qvel[0, :2].numpy() - before, told, atol=1e-5)
        sizes.append(np.linalg.norm(told))
    # once in 7.5 s on average
    assert 2 < np.count_nonzero(sizes) < 15 and 0.1 <= max(sizes) <= 1.0


@pytest.mark.slow
def test_trials_are_those_of_the_evaluation():
    """Starts, objects and verdicts."""
    trials = list(evaluated_trials("student", ("gap",), 3, 1))
    assert [t.outcome for t in trials] == ["success"] * 3 and len({t.carry.carried for t in trials}) == 3
    starts = np.array([t.scene.start for t in trials])
    assert 0.0 < np.abs(starts[:, :2]).max() <= 0.03 and 0.0 < np.abs(starts[:, 2]).max() <= 0.1
    assert all(len(t.pushes_W) >= 250 for t in trials)
