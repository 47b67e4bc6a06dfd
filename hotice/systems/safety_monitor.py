"""The last word before the motors: commands pass while they and the robot are sound, else the answer to the fault does.

What is a fault, and what is done about it, is said in `hotice.safety`, whose loops are compiled here.
"""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from hotice import checks
from hotice.compiled import compiled
from hotice.errors import InvalidConfig
from hotice.model import g1
from hotice.model.carry import CarryState
from hotice.model.joint_limits import position_limits, torque_limits
from hotice.policy.percept import Percept
from hotice.safety import AgeLimits, Answer, CommandLimits, Fault, MeasurementLimits, judge
from hotice.safety.limits import AHEAD_S
from hotice.safety.responses import response_table, still_table
from hotice.systems.signals import (
    GUIDANCE,
    JOINT_POS,
    JOINT_VEL,
    NUM_JOINTS,
    PERCEPT,
    ROBOT_STATE,
    ROOT_RATE,
    SOURCES,
    STATUS,
)
from hotice.task.rules import UPRIGHT

Array = NDArray[np.float64]
FAULTS = len(Fault)
LEGS_AND_WAIST = np.array([not any(arm in joint for arm in ("shoulder", "elbow")) for joint in g1.ACTION_JOINTS])
_GYRO = ROOT_RATE.start
_OBSERVATION_INVALID, _GUIDANCE_INVALID = int(Fault.OBSERVATION_INVALID), int(Fault.GUIDANCE_INVALID)
_CONTROLLER_ERROR, _POSE_INVALID = int(Fault.CONTROLLER_ERROR), int(Fault.POSE_INVALID)
_AHEAD_S, _OWN = AHEAD_S, Percept.PARTS["w_WP_P"].start
_POSSIBLE_GUIDANCE = 1e4
"""No field is as strong [m/s], nothing as far away [m] (ours)."""
_REPEAT, _MOVING_RAD_S = int(Answer.REPEAT), judge.MOVING_RAD_S
_P_WP, _P_WO, _R_WO = (Percept.PARTS[name].start for name in ("p_WP", "p_WO", "R_WO"))
COUNTS, DECISION, SPARED, MEMORY = range(4)
"""Groups of the state: how often each fault was there at a check, (faults,), the first number for any; answer and
fault; which joints damp (20,); what the checks remember."""
_SINCE, _LAST, _TICK, _SAME, _TAKEN, _DAMPED_S, _ANY = 0, FAULTS, FAULTS + 20, FAULTS + 21, FAULTS + 22, FAULTS + 23, 0
_OF_STATE = slice(_SINCE + int(Fault.STATE_LATE), _SINCE + int(Fault.STATE_NOT_FINITE) + 1)
_NUMBERS, _HELD_Q = FAULTS + 24, FAULTS + 64
_SIZE = FAULTS + 84


@dataclass(frozen=True, kw_only=True)
class SafetyLimits:
    """When commands no longer pass in a station. `measurement` and `command` are wider than a robot's.

    Students that carry well reach 28 rad/s, 5 rad/s of the pelvis' gyro, joints 0.15 rad beyond their ranges, targets
    0.43 rad beyond and 1.2 rad from one to the next (`docs/station.md`); a robot's limits belong into its guard.
    """

    tilt_rad: float = math.acos(UPRIGHT)
    """Largest lean of the pelvis, at most π: a fall, as in the task."""
    falling_rad: float = MeasurementLimits.falling_rad
    """Largest lean of the pelvis 0.15 s ahead at its present rate, at most π: a fall that has begun."""
    joint_margin_rad: float = 0.2
    """How far a joint may be pressed beyond its range."""
    joint_speed_rad_s: float = 45.0
    """Largest joint speed."""
    gyro_rad_s: float = 12.0
    """Largest turning rate of the pelvis, of each axis."""
    target_margin_rad: float = 1.2
    """How far a target may be beyond its joint's range: the motor never gets there, but presses that hard."""
    step_rad: float = 2.5
    """Largest change of a target from one command to the next."""
    torque_share: float = 1.5
    """Largest torque as a share of the motor's limit; a motor drawn weaker is asked for more."""
    arms_hold_s: float = 1.0
    """How long the arms of a damped robot keep squeezing the object."""
    ages: AgeLimits = field(default_factory=AgeLimits)
    """Ages from which something is late."""

    def __post_init__(self) -> None:
        if not isinstance(self.ages, AgeLimits):
            raise InvalidConfig(f"ages is {checks.shown(self.ages)}: see `AgeLimits`")
        checks.numbers(self, checks.NOT_NEGATIVE, "arms_hold_s")
        self.measurement, self.command  # noqa: B018 - they check the rest

    @property
    def measurement(self) -> MeasurementLimits:
        """Limits of one measurement."""
        return MeasurementLimits(
            tilt_rad=self.tilt_rad,
            falling_rad=self.falling_rad,
            joint_margin_rad=self.joint_margin_rad,
            joint_speed_rad_s=self.joint_speed_rad_s,
            gyro_rad_s=self.gyro_rad_s,
        )

    @property
    def command(self) -> CommandLimits:
        """Limits of one command."""
        return CommandLimits(
            target_margin_rad=self.target_margin_rad, step_rad=self.step_rad, torque_share=self.torque_share
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class SafePosture:
    """Joint targets [rad] and static torques [N m] that hold before any command; ranges [rad]; gains, limits.

    All (20,), order `g1.ACTION_JOINTS`.
    """

    target: Array
    torque: Array
    lower: Array
    upper: Array
    kp: Array
    kd: Array
    limit: Array

    @classmethod
    def of(cls, carry: CarryState) -> SafePosture:
        """The posture of a carry state: object held, knees bent."""
        lower, upper = position_limits(g1.ACTION_JOINTS)
        kp, kd = g1.gains()
        return cls(
            target=carry.joint_target,
            torque=carry.torque,
            lower=lower,
            upper=upper,
            kp=kp,
            kd=kd,
            limit=torque_limits(g1.ACTION_JOINTS),
        )


_finite = compiled(judge.all_finite)
_find_state, _find_pose = compiled(judge.find_state), compiled(judge.find_pose)
_lean_ahead, _find_falling = compiled(judge.lean_ahead), compiled(judge.find_falling)
_find_command, _find_ages = compiled(judge.find_command), compiled(judge.find_ages)
_remember, _decide, _stands_still = compiled(judge.remember), compiled(judge.decide), compiled(judge.stands_still)


@compiled
def _within(vector, most):
    for value in vector:
        # NaN fails every comparison
        if not abs(value) <= most:
            return False
    return True


@compiled
def _known(code, otherwise):
    """A fault by its number; a number that is none, which would be written elsewhere, is another one."""
    return int(code) if code < FAULTS else otherwise


@compiled
def _passes(command, lower, upper):
    for i in range(len(command)):
        # NaN fails every comparison
        if not (lower[i] <= command[i] <= upper[i]):
            return False
    return True


@compiled
def _check(
    now,
    state,
    percept,
    guidance,
    sources,
    command,
    tick,
    status,
    memory,
    counts,
    table,
    still_holds,
    limits,
    final,
):
    """Answer and fault of one check, after the checks before, which `memory` and `counts` hold.

    `final`: the robot is damped, and what its arms hold stays what it was.
    """
    lower, upper, c_lower, c_upper, measurement, command_limits, ages, targets = limits
    begun = np.full(FAULTS, np.inf)
    q, qd, gyro = state[JOINT_POS], state[JOINT_VEL], state[_GYRO : _GYRO + 3]
    quat = state[3:7]
    _find_state(begun, now, quat, gyro, q, qd, lower, upper, measurement)
    _find_falling(begun, now, _lean_ahead(quat, gyro, _AHEAD_S), measurement)
    if len(percept):
        p_WP, p_WO = percept[_P_WP : _P_WP + 3], percept[_P_WO : _P_WO + 3]
        _find_pose(begun, now, p_WP, p_WO, percept[_R_WO : _R_WO + 9], measurement)
        if not (_finite(percept) and _within(percept[_OWN : _OWN + 43], measurement[4])):
            begun[_OBSERVATION_INVALID] = now
    if not _within(guidance, _POSSIBLE_GUIDANCE):
        begun[_GUIDANCE_INVALID] = now
    last = memory[_LAST : _LAST + 20]
    _find_command(begun, now, command, last, c_lower, c_upper, command_limits, targets)
    # the same numbers of a robot that moves are no measurement
    same, fastest = True, 0.0
    for i in range(20):
        fastest = max(fastest, abs(qd[i]))
        same = same and memory[_NUMBERS + i] == q[i] and memory[_NUMBERS + 20 + i] == qd[i]
        memory[_NUMBERS + i], memory[_NUMBERS + 20 + i] = q[i], qd[i]
    if not same or fastest < _MOVING_RAD_S:
        memory[_SAME] = np.inf
    elif not math.isfinite(memory[_SAME]):
        memory[_SAME] = memory[_TAKEN]
    memory[_TAKEN] = now
    stamps, before = np.full(4, now), np.full(4, np.nan)
    stamps[0], before[0] = tick, memory[_TICK]
    memory[_TICK] = tick
    if math.isfinite(status[0]):
        stamps[1] = status[0]
    if len(sources):
        stamps[2:] = sources[:2]
        for fault in sources[2:]:
            if not fault <= 0:
                begun[_known(fault, _POSE_INVALID)] = now
    _find_ages(begun, now, stamps, before, memory[_SAME], ages)
    if not status[1] <= 0:
        begun[_known(status[1], _CONTROLLER_ERROR)] = now
    since = memory[_SINCE : _SINCE + FAULTS]
    _remember(begun, now, since, counts)
    answer, fault = _decide(now, since, _stands_still(quat, gyro, qd), table, still_holds)
    if answer < _REPEAT and not final:
        last[:], memory[_HELD_Q : _HELD_Q + 20] = command, q
    return answer, fault


def held_torque(state: Array, posture: SafePosture, torque: Array, q: Array) -> Array:
    """Torques (20,) that hold the joints at `q` (20,) beside a `torque` (20,) that did; that alone where unknown."""
    now, qd = state[JOINT_POS], state[JOINT_VEL]
    with np.errstate(invalid="ignore", over="ignore"):
        held = torque + posture.kp * (q - now) - posture.kd * qd
    return np.clip(np.where(np.isfinite(held), held, torque), -posture.limit, posture.limit)


def damping_torque(state: Array, posture: SafePosture) -> Array:
    """Torques (20,) that only damp, none where a joint's speed is unknown; for motors that cannot damp by themselves.

    By the trained damping: more of it shakes light joints where torques are held for a time step. Plants of a station
    damp by themselves, and do not follow it.
    """
    qd = state[JOINT_VEL]
    return np.clip(-posture.kd * np.where(np.isfinite(qd), qd, 0.0), -posture.limit, posture.limit)


def damping_target(state: Array, target: Array) -> Array:
    """Joint targets (20,) at which servos mostly damp: where the joints are, `target` (20,) where that is unknown."""
    q = state[JOINT_POS]
    return np.where(np.isfinite(q), q, target)


class SafetyMonitor(LeafSystem):
    """Judges robot and command, and lets a command pass or answers.

    Inputs `robot_state` (84,), `tick` (1,), `command` (20,); optional `watched_percept` (119,), `watched_guidance`
    (122,), `sources` (4,), `status` (2,). Outputs `command` (20,), safe; `answer` (2,); `damped` (20,); `faults` (27,).

    `robot_state`: what the robot measures, of which joints, quaternion and gyro are read; `tick`: when, by its own
    clock [s]. `sources`, `status`, `answer`: see `signals`. `damped`: 1 for joints whose motors shall only damp, for
    plants with such motors; for others `command` says it as well as it can. `faults`: at how many checks each `Fault`
    was there, by its number; the first counts checks with any.

    All is checked at the start of each control period, and an answer lasts for the period. In between every command is
    tested, so that none that is not finite or out of range ever passes: the last valid one is given again. Damping is
    final: the arms keep squeezing for a while, then damp too; at once where torques are commanded and the robot's state
    is not known.

    Args:
        posture: what is held after a fault. limits: what is one.
        control_dt_s: period of the checks.
        torques: commands are torques [N m]; otherwise joint targets [rad] of the motors' servos.
    """

    def __init__(
        self,
        posture: SafePosture,
        limits: SafetyLimits,
        control_dt_s: float,
        torques: bool = True,
    ) -> None:
        super().__init__()
        self.posture, self.limits, self.torques = posture, limits, torques
        margin = limits.target_margin_rad
        self._lower = -limits.torque_share * posture.limit if torques else posture.lower - margin
        self._upper = limits.torque_share * posture.limit if torques else posture.upper + margin
        self._table, self._still_holds = response_table(), still_table()
        self._limits = (
            posture.lower,
            posture.upper,
            self._lower,
            self._upper,
            judge.measurement_array(limits.measurement),
            np.array([0.0, limits.step_rad]),
            judge.age_array(limits.ages),
            not torques,
        )
        memory = np.full(_SIZE, np.nan)
        memory[:FAULTS], memory[_SAME], memory[_DAMPED_S] = np.inf, np.inf, np.inf
        groups = [self.DeclareDiscreteState(v) for v in (np.zeros(FAULTS), np.zeros(2), np.zeros(NUM_JOINTS), memory)]
        self._state = self.DeclareVectorInputPort("robot_state", ROBOT_STATE)
        self._tick = self.DeclareVectorInputPort("tick", 1)
        self._command = self.DeclareVectorInputPort("command", NUM_JOINTS)
        self._percept = self.DeclareVectorInputPort("watched_percept", PERCEPT)
        self._guidance = self.DeclareVectorInputPort("watched_guidance", GUIDANCE)
        self._sources = self.DeclareVectorInputPort("sources", SOURCES)
        self._status = self.DeclareVectorInputPort("status", STATUS)
        reads = {self.discrete_state_ticket(g) for g in groups} | {self._state.ticket(), self._command.ticket()}
        self.DeclareVectorOutputPort("command", NUM_JOINTS, self._output_command, reads)
        for name, group in (("faults", COUNTS), ("answer", DECISION), ("damped", SPARED)):
            self.DeclareStateOutputPort(name, groups[group])
        self.DeclarePeriodicUnrestrictedUpdateEvent(control_dt_s, 0.0, self._check)

    def _check(self, context: Context, state: State) -> None:
        before, last_fault = context.get_discrete_state(DECISION).value().tolist()
        now = context.get_time()
        memory = state.get_mutable_discrete_state(MEMORY).get_mutable_value()
        counts = state.get_mutable_discrete_state(COUNTS).get_mutable_value()
        status = self._status.Eval(context) if self._status.HasValue(context) else _UNKNOWN
        answer, fault = _check(
            now,
            self._state.Eval(context),
            self._percept.Eval(context) if self._percept.HasValue(context) else _NOTHING,
            self._guidance.Eval(context) if self._guidance.HasValue(context) else _NOTHING,
            self._sources.Eval(context) if self._sources.HasValue(context) else _NOTHING,
            self._command.Eval(context),
            self._tick.Eval(context)[0],
            status,
            memory,
            counts,
            self._table,
            self._still_holds,
            self._limits,
            before == Answer.DAMP,
        )
        counts[_ANY] += fault > 0
        if before == Answer.DAMP:
            self._spare(now, memory, state)
        elif fault or before or last_fault:
            state.get_mutable_discrete_state(DECISION).SetFromVector([float(answer), float(fault)])
            if answer == Answer.DAMP:
                memory[_DAMPED_S] = now
                self._spare(now, memory, state)

    def _spare(self, now: float, memory: Array, state: State) -> None:
        # torques that hold are made of the measured state: of an old one they swing the arms until they fly
        blind = self.torques and bool(np.isfinite(memory[_OF_STATE]).any())
        arms = blind or now - memory[_DAMPED_S] >= self.limits.arms_hold_s - 1e-9
        state.get_mutable_discrete_state(SPARED).SetFromVector(np.maximum(LEGS_AND_WAIST, arms).astype(float))

    def _output_command(self, context: Context, output: BasicVector) -> None:
        command = self._command.Eval(context)
        answer = int(context.get_discrete_state(DECISION).value()[0])
        if answer < Answer.REPEAT and _passes(command, self._lower, self._upper):
            output.SetFromVector(command)
            return
        memory, posture, measured = context.get_discrete_state(MEMORY).value(), self.posture, self._state.Eval(context)
        last, q = memory[_LAST : _LAST + NUM_JOINTS], memory[_HELD_Q : _HELD_Q + NUM_JOINTS]
        if math.isnan(last[0]):  # nothing was valid yet
            last, q = posture.torque if self.torques else posture.target, posture.target
        held = held_torque(measured, posture, last, q) if self.torques and answer >= Answer.HOLD else last
        if answer == Answer.DAMP:
            damping = damping_torque(measured, posture) if self.torques else damping_target(measured, last)
            held = np.where(context.get_discrete_state(SPARED).value() > 0, damping, held)
        output.SetFromVector(held)


_UNKNOWN, _NOTHING = np.array([np.nan, 0.0]), np.empty(0)
