"""One instant of a pick-up: the motion, the plan's reference, and how far the object is."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hotice.model import g1
from hotice.model.picks.book import BOOK_PHASES, SHAPES
from hotice.sim.carry_bank import pick
from hotice.sim.physics.protocol import Physics
from hotice.sim.pickup.bank import PickBank
from hotice.sim.reader import TOUCH_HEIGHT_M
from hotice.sim.snapshot import NUM_SGF, Grasp, Layout, Memory, Motion, read_motion
from hotice.task.config import TaskConfig


@dataclass
class PickMemory(Memory):
    """`held` (N,): control steps for which the object has been in the carry state without a break.

    `leaning` (N, 2): sum over time of the pelvis' offset, clipped [m s]; teachers alone read it. `step` below zero:
    the robot waits before it begins.
    """

    held: Tensor
    leaning: Tensor


@dataclass(frozen=True, kw_only=True)
class PickSnapshot(Motion):
    """One instant of N robots that pick up, in W, whose origin is G: the middle of the feet at the start, x ahead.

    touch (N, 2): soles on the floor. action, last_action (N, 20); past (N, H), see `Memory`; time_left (N,) share.
    course_q (N, 20): joints of the plan now; phase (N,), share (N,) of it that is over.
    offset, rate (N, 2): pelvis from where the plan has it over the feet [m], [m/s]. felt (N, 4): the same from where
    the carry state has it, as a robot without a plan tells it from its encoders and the tilt. top (N,): of the
    support [m];
    told (N, 1): mass as told [kg]; wrist (N, 6) [rad]. away (N,): object from its place in the carry state, seen
    from the feet [m]; turned (N,) from upright and straight [rad]; above (N,): its lowest point over the support, large
    beside it [m]. held_s (N,). robot_hit (N,): the robot touches the support; force-free, as all here.
    """

    touch: Tensor
    action: Tensor
    last_action: Tensor
    past: Tensor
    time_left: Tensor
    grasp: Grasp
    course_q: Tensor
    phase: Tensor
    share: Tensor
    offset: Tensor
    rate: Tensor
    felt: Tensor
    top: Tensor
    told: Tensor
    wrist: Tensor
    away: Tensor
    turned: Tensor
    above: Tensor
    held_s: Tensor
    robot_hit: Tensor


class PickReader:
    """Reads `physics` and `memory` into snapshots."""

    def __init__(
        self, config: TaskConfig, bank: PickBank, layout: Layout, physics: Physics, memory: PickMemory
    ) -> None:
        self.config, self.bank, self.layout, self.physics, self.memory = config, bank, layout, physics, memory
        model = bank.models[0]
        self.ankle = torch.tensor([model.body(f"{s}_ankle_roll_link").id for s in g1.SIDES], device=bank.top.device)

    def snapshot(self, ids: Tensor | None = None) -> PickSnapshot:
        """Reads environments `ids` (default all)."""
        m, bank = self.memory, self.bank
        rows = slice(None) if ids is None else ids
        model = m.model[rows]
        step = m.step[rows]
        k = step.clamp(0, len(bank.phase) - 1)
        grasp = pick(bank.grasp, model)
        motion, xpos, xmat = read_motion(self.physics, self.layout, grasp, ids)
        feet, ahead = xpos[:, self.ankle, :2].mean(dim=1), xmat[:, self.ankle, :2, 0].sum(dim=1)
        ahead = torch.nn.functional.normalize(ahead, dim=1)
        left = torch.stack([-ahead[:, 1], ahead[:, 0]], dim=1)
        frame = torch.stack([ahead, left], dim=1)

        def seen(v_W: Tensor) -> Tensor:
            return (frame @ v_W[:, :2, None]).squeeze(-1)

        ankles = bank.ankles[model]
        place, rate = seen(motion.p_WP[:, :2] - feet) + ankles, seen(motion.v_WP)
        object_G = torch.cat([seen(motion.p_WO[:, :2] - feet) + ankles, motion.p_WO[:, 2:]], dim=1)
        up = motion.R_WO[:, 2, 2].clamp(-1.0, 1.0)
        yaw = torch.atan2(seen(motion.R_WO[:, :2, 0])[:, 1], seen(motion.R_WO[:, :2, 0])[:, 0])
        box = bank.shape[model] == SHAPES.index("box")
        turned = torch.where(box, torch.acos(torch.minimum(up, torch.cos(yaw))), torch.zeros_like(up))
        reach = half_span(motion.R_WO, grasp.half_extents, bank.shape[model])
        above = motion.p_WO[:, 2] - reach[:, 2] - bank.top[model]
        beside = motion.p_WO[:, 0] + reach[:, 0] < bank.near[model]
        above = torch.where(beside, torch.full_like(above, 1.0), above)
        ends = motion.p_WK[:, NUM_SGF + 2 :, 2]
        hits = self.physics.hits
        assert hits is not None
        return PickSnapshot(
            **vars(motion),
            touch=torch.minimum(ends[:, :2], ends[:, 2:]) < TOUCH_HEIGHT_M,
            action=m.action[rows],
            last_action=m.last_action[rows],
            past=m.past[rows],
            time_left=1.0 - step.float() / self.config.max_steps,
            grasp=grasp,
            course_q=bank.true_q[model, k],
            phase=torch.where(step < len(bank.phase), bank.phase[k], torch.full_like(k, len(BOOK_PHASES) - 1)),
            share=torch.where(step < len(bank.phase), bank.share[k], torch.zeros_like(bank.share[k])),
            offset=place - bank.true_pelvis[model, k],
            rate=rate - bank.true_rate[model, k],
            felt=torch.cat([place - bank.course_pelvis[model, -1], rate], dim=1),
            top=bank.top[model],
            told=bank.told[model],
            wrist=bank.wrist[model],
            away=(object_G - bank.place[model]).norm(dim=1),
            turned=turned,
            above=above,
            held_s=m.held[rows] * self.config.control_dt_s,
            robot_hit=hits[rows][:, 0].clone(),
        )


def half_span(R_WO: Tensor, half: Tensor, shape: Tensor) -> Tensor:
    """How far objects reach from their centre along the axes of W, (N, 3) [m].

    R_WO: (N, 3, 3). half: (N, 3) half extents [m]. shape: (N,) index into `SHAPES`; cylinders stand along their z.
    """
    box = (R_WO.abs() * half[:, None]).sum(dim=2)
    radius, along = half[:, :1], R_WO[:, :, 2].abs()
    cylinder = half[:, 2:] * along + radius * torch.sqrt((1.0 - along.square()).clamp_min(0.0))
    round_one = torch.where((shape == SHAPES.index("sphere"))[:, None], radius.expand_as(box), cylinder)
    return torch.where((shape == SHAPES.index("box"))[:, None], box, round_one)
