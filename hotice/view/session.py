"""One walk under way: a robot, its policy and its fields, among obstacles that somebody moves meanwhile."""

from __future__ import annotations

import queue
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import singledispatchmethod

import numpy as np
from numpy.typing import NDArray

from hotice.errors import HoticeError
from hotice.fields.live import LiveField
from hotice.model.carry import solve_carry
from hotice.model.objects import CarriedObject
from hotice.model.scene import Obstacle, Scene, Vec3
from hotice.policy import Percept, read_fields
from hotice.policy.carry_policy import CarryPolicy, Network
from hotice.policy.guidance import FieldReading, read_standing
from hotice.task.policy_task import PolicyTask
from hotice.task.sensing import STUDENT_SENSING, SensingConfig
from hotice.view import orders
from hotice.view.halting import Halting
from hotice.view.senses import Senses
from hotice.view.world import World

Array = NDArray[np.float64]
OBSTACLE_M_S = 2.0
"""Speed at which obstacles follow the hand that drags them [m/s] (ours): the robot meets a wall that comes, not one
that is suddenly inside it."""
AFTER_S = 1.0
"""A fall or a drop is shown for so long, then time stands still [s] (ours)."""
MOST_EVENTS = 20
MOST_WAITING = 100
"""Orders that wait for the next control step; more are refused."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What can be chosen, and what is chosen at first.

    Attributes:
        policies: opens a policy, by its name. policy: one of these names.
        carried: the object. noise: whether noise and delays act as students are trained under. seed: of these.
    """

    policies: Mapping[str, Callable[[], Network]]
    policy: str
    carried: CarriedObject
    noise: bool = True
    seed: int = 0


class Session:
    """Call `tick` once a control period; `order` may be called by any thread.

    Attributes:
        scene: as it was at first. live: its fields now. choice: what acts now.
        world, percept, reading: the robot, what it sensed and read in the last step (before the first: at the start).
        paused, over: whether time stands; a fall, drop or diverged state, by its name; empty for none.
        events: what happened, newest last, as the page lists it. slice: which is shown.
    """

    def __init__(self, scene: Scene, live: LiveField, choice: Choice) -> None:
        """Puts the robot at the start. Raises `HoticeError`: a policy or an object that cannot be used."""
        self.scene, self.live, self.choice = scene, live, choice
        self.known = orders.Known(scene=scene, policies=tuple(choice.policies))
        self.paused, self.slice = False, orders.Slice(field="none", height_m=0.75)
        self._orders: queue.Queue[orders.Order | Network] = queue.Queue(MOST_WAITING)
        self._obstacles: dict[str, Obstacle] = {obstacle.name: obstacle for obstacle in scene.obstacles}
        self._wanted: dict[str, Vec3] = {}
        self._walks = 0
        self._network = self._opened(choice.policy)
        self._carry = solve_carry(choice.carried)
        self.world = self._made_world()
        self._begin()

    @property
    def task(self) -> PolicyTask:
        """Constants of the policy that acts."""
        return self._policy.task

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Where obstacles are now, which the fields may not show yet."""
        return tuple(self._obstacles.values())

    @property
    def standing(self) -> str:
        """Why the robot stands, see `hotice.view.halting`; empty: it walks."""
        return self._halting.why

    def order(self, order: orders.Order | Network) -> None:
        """Has it obeyed at the next step; a policy takes the place of the one of its name. Raises `HoticeError`."""
        try:
            self._orders.put_nowait(order)
        except queue.Full:
            raise HoticeError(f"{MOST_WAITING} orders wait already: send fewer") from None

    def tick(self) -> None:
        """Obeys what was ordered, moves obstacles, and lets the robot live for a control period unless time stands.

        Raises `FieldsNotBuilt` when the process that builds fields has ended.
        """
        while not self._orders.empty():
            order = self._orders.get_nowait()
            try:
                self._obey(order)
            except HoticeError as error:
                self._tell("fault", str(error))
        self._move_obstacles()
        if not self.paused and not (self.over and self.time_s >= self._ended_s + AFTER_S):
            self._step()

    def _step(self) -> None:
        pf, state = self.live.fields, self.world.state()
        self.percept = self._senses.measure(*state)
        self.reading = read_fields(pf, self.percept, self.task)
        before, why = self.standing, self._halting.look(self.live, self.percept, self.reading)
        if why != before and not self.over:
            self._tell("note", why or "walks on")
        read = self.reading
        if why:
            read = read_standing(read, self.percept, self._halting.place_W, self.task, pf.params.attraction)
        target = self._policy.act(self.percept, read)
        if target is None:
            self._end("unstable", "the policy's input or output is not finite")
            return
        self.world.step(target, self._senses.delay)
        self.time_s += self.task.control_dt_s
        for solid, obstacle in sorted(self.world.touched - self._touches):
            self._tell("touch", f"{solid} touches {obstacle}")
        self._touches |= self.world.touched
        failed = self.world.failure
        if failed and not self.over:
            self._end(failed, failed)
        if failed != "unstable":
            self.qpos = self.world.state()[0].copy()

    @property
    def touches(self) -> int:
        """Pairs of a solid and an obstacle that have touched since the start."""
        return len(self._touches)

    def _end(self, outcome: str, text: str) -> None:
        self.over, self._ended_s = outcome, self.time_s if outcome != "unstable" else -np.inf
        self._tell("fault", text)

    def _tell(self, kind: str, text: str) -> None:
        self.events = [*self.events, {"time": round(self.time_s, 2), "kind": kind, "text": text}][-MOST_EVENTS:]

    def _begin(self) -> None:
        """A walk from the start, with other noise than the one before."""
        choice = self.choice
        self._policy = CarryPolicy(self._network, self._carry)
        self._senses = Senses(
            choice.carried,
            STUDENT_SENSING if choice.noise else SensingConfig(),
            self.task.control_dt_s,
            self.world.substeps,
            choice.seed + self._walks,
        )
        self._walks += 1
        self._halting = Halting()
        self.world.restart()
        self.time_s, self.over, self._ended_s = 0.0, "", np.inf
        self.events: list[dict[str, object]] = []
        self._touches: set[tuple[str, str]] = set()
        qpos, qvel = self.world.state()
        self.qpos: Array = qpos.copy()
        self.percept: Percept = self._senses.measure(qpos, qvel)
        self.reading: FieldReading = read_fields(self.live.fields, self.percept, self.task)

    def _made_world(self) -> World:
        task = PolicyTask.from_meta(self._network.meta, self._network.name)
        world = World(self._carry, self.scene, task.control_dt_s)
        world.put(self.obstacles)
        return world

    def _opened(self, name: str) -> Network:
        network = self.choice.policies[name]()
        self._check_fields(network)
        return network

    def _check_fields(self, network: Network) -> None:
        """Raises `HoticeError` for a policy that reads other fields than those that are built."""
        task = PolicyTask.from_meta(network.meta, network.name)
        wanted, built = (task.resolution_m, task.margin_m), (self.live.grid.resolution_m, self.live.margin_m)
        if not np.allclose(wanted, built):
            raise HoticeError(
                f"{network.name} reads fields of {wanted[0]:g} m with a margin of {wanted[1]:g} m, built are those of "
                f"{built[0]:g} m with {built[1]:g} m: start anew with --policy {network.name}"
            )

    def _move_obstacles(self) -> None:
        reach, moved = OBSTACLE_M_S * self.task.control_dt_s, {}
        for name, to_W in list(self._wanted.items()):
            now = self._obstacles[name]
            way = np.subtract(to_W, now.position_m)
            far = float(np.linalg.norm(way))
            if far <= reach:
                del self._wanted[name]
                moved[name] = replace(now, position_m=to_W)
            else:
                moved[name] = replace(now, position_m=tuple(now.position_m + way * (reach / far)))
        if moved:
            self._obstacles |= moved
            self.world.put(moved.values())
            self.live.move({name: (o.position_m, o.quaternion_wxyz) for name, o in moved.items()})

    @singledispatchmethod
    def _obey(self, order: object) -> None:
        """A policy that was loaded meanwhile, of the name of the one that acts."""
        network: Network = order  # type: ignore[assignment]
        self._check_fields(network)
        self._use(network, self.choice.policy)
        self._tell("note", f"{network.name} was loaded anew")

    @_obey.register
    def _(self, order: orders.Move) -> None:
        self._wanted[order.obstacle] = order.to_W

    @_obey.register
    def _(self, order: orders.Restore) -> None:
        self._wanted |= {obstacle.name: obstacle.position_m for obstacle in self.scene.obstacles}

    @_obey.register
    def _(self, order: orders.Push) -> None:
        if self.paused or self.over:
            raise HoticeError("time stands still: nothing is pushed; go on or begin anew first")
        self.world.push(order.velocity_W)
        self._tell("note", "pushed by {:.2f}, {:.2f} m/s".format(*order.velocity_W))

    @_obey.register
    def _(self, order: orders.Take) -> None:
        carry = solve_carry(order.carried)
        self._carry, self.choice = carry, replace(self.choice, carried=order.carried)
        self.world = self._made_world()
        self._begin()

    @_obey.register
    def _(self, order: orders.UsePolicy) -> None:
        self._use(self._opened(order.policy), order.policy)

    @_obey.register
    def _(self, order: orders.Noise) -> None:
        self.choice = replace(self.choice, noise=order.on)
        self._begin()

    @_obey.register
    def _(self, order: orders.Pause) -> None:
        self.paused = order.on

    @_obey.register
    def _(self, order: orders.Restart) -> None:
        self._begin()

    @_obey.register
    def _(self, order: orders.Slice) -> None:
        self.slice = order

    def _use(self, network: Network, name: str) -> None:
        CarryPolicy(network, self._carry)  # says what does not fit, while all is as it was
        self._network, self.choice = network, replace(self.choice, policy=name)
        self.world = self._made_world()
        self._begin()
