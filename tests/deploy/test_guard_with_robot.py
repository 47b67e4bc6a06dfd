"""The guard and the simulated robot together, in lock step: from the gantry to a robot that stands with its object."""

import numpy as np
import pytest

from hotice.deploy.command import LIMITS
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.guard import Guard
from hotice.deploy.guard.modes import Mode
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.slot.records import TARGETS
from tests.deploy.simulated_fixture import STEP_S, Lab


class Operated(Lab):
    """A lab whose robot is commanded by a guard, with targets that hold the carry state."""

    def __init__(self, **config):
        super().__init__(start="held", **config)
        told = self.holding()
        self.targets = np.zeros((), TARGETS)
        self.targets["q"], self.targets["tau"], self.targets["warm"] = np.clip(told.q, *LIMITS[:2]), told.tau, 1
        self.events = []
        self.guard = Guard(
            self.link,
            self.read,
            lambda status: None,
            self.clock,
            GuardConfig(),
            charge=lambda: float(self.robot.states.battery()["soc"]),
            on_event=self.events.append,
        )

    def read(self):
        """A runner that is always on time."""
        self.targets["number"] += 1
        self.targets["stamp_s"] = self.clock.now()
        return self.targets.copy()

    def go_on(self, seconds, *keys):
        """Presses keys and lives on; the guard's mode then."""
        if keys:
            self.robot.press(*keys)
        for _ in range(round(seconds / STEP_S)):
            self.guard.tick()
            self.clock.sleep(STEP_S)
        return self.guard.mode


def test_an_encoder_that_slips_for_one_sample_is_no_fault_of_a_simulated_robot():
    """Neither guard nor runner, which reads the guard's states, ever see it."""
    lab = Operated(fault=("encoder-jump@1.6s+0.002s",))
    lab.go_on(0.8)
    lab.go_on(0.3, "start")
    lab.go_on(0.3, "L2", "up")
    measured, jumps = lab.guard.measured, 0
    torques = []
    for _ in range(150):
        before = measured.newest
        lab.go_on(STEP_S)
        jumps += measured.refused_in_a_row
        assert np.abs(measured.newest.record["motor_state"]["q"] - before.record["motor_state"]["q"]).max() < 0.1
        received = lab.robot.end.command()
        torques.append(received.record["motor_cmd"]["tau"][JOINTS].copy())
    assert jumps == 1 and lab.guard.mode is Mode.POSTURE
    assert np.abs(np.diff(torques, axis=0)).max() < 1.0


@pytest.mark.slow
def test_from_the_gantry_to_standing_and_to_the_stop():
    lab = Operated(noise="trained")

    def told():
        return [event.text for event in lab.events]

    assert lab.go_on(1.0) is Mode.OFF, told()
    assert lab.go_on(1.0, "start") is Mode.DAMPING, told()
    assert lab.go_on(3.5, "L2", "up") is Mode.READY, told()
    lab.go_on(1.0, "F1")
    assert lab.robot.handing.stage == "held"
    lab.go_on(0.6, "F1")
    assert lab.go_on(2.5, "F2") is Mode.READY, told()
    assert not lab.world.failure
    assert lab.world.lowest_sole_m == pytest.approx(0.0, abs=5e-3)
    assert lab.go_on(1.5, "L2", "B") is Mode.DAMPING
    assert lab.world.data.qpos[2] < 0.6
