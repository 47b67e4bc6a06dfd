"""What goes on behind a page: a walk after another, among obstacles that somebody moves meanwhile."""

from __future__ import annotations

import queue
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import singledispatchmethod

import numpy as np

from hotice.errors import HoticeError
from hotice.fields.live import LiveField
from hotice.model.carry import CarryState, solve_carry
from hotice.model.objects import CarriedObject
from hotice.model.scene import Obstacle, Scene
from hotice.policy.carry_policy import Network
from hotice.task.policy_task import PolicyTask
from hotice.view import orders
from hotice.view.obstacles import Obstacles
from hotice.view.walk import Walk

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
        scene: as it was at first. live: its fields now. choice: what acts now. known: what orders may name.
        walk: the one that is under way. paused: whether time stands. slice: which of a field is shown.
    """

    def __init__(self, scene: Scene, live: LiveField, choice: Choice) -> None:
        """Begins the first walk. Raises `HoticeError`: a policy or an object that cannot be used."""
        self.scene, self.live = scene, live
        self.known = orders.Known(scene=scene, policies=tuple(choice.policies))
        self.paused, self.slice = False, orders.Slice(field="none", height_m=0.75)
        self._orders: queue.Queue[orders.Order | Network] = queue.Queue(MOST_WAITING)
        self._obstacles, self._walks = Obstacles(scene), 0
        self._begin(choice, choice.policies[choice.policy](), solve_carry(choice.carried))

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Where obstacles are now, which the fields may not show yet."""
        return tuple(self._obstacles.now.values())

    def order(self, order: orders.Order | Network) -> None:
        """Has it obeyed at the next step; a policy takes the place of the one that acts. Raises `HoticeError`."""
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
                self.walk.tell("fault", str(error))
        goes_on, dt_s = not self.paused and not self.walk.ended, self.walk.task.control_dt_s
        moved = self._obstacles.advance(self.walk.time_s + dt_s * goes_on, dt_s)
        self._show(moved)
        if goes_on:
            self.walk.step(moved)
        else:
            self.walk.world.put(moved)

    def _show(self, moved: tuple[Obstacle, ...]) -> None:
        """Has the fields follow."""
        if moved:
            self.live.move({each.name: (each.position_m, each.quaternion_wxyz) for each in moved})

    def _begin(self, choice: Choice, network: Network, carry: CarryState) -> None:
        """A walk from the start, with other noise than the one before. Where it raises, all is as it was."""
        self._check_fields(network)
        seed = choice.seed + self._walks
        walk = Walk(self.live, network, carry, self.obstacles, noise=choice.noise, seed=seed)
        self.choice, self._network, self._carry, self.walk = choice, network, carry, walk
        self._walks += 1
        moved = self._obstacles.restart()
        walk.world.put(moved)
        self._show(moved)

    def _check_fields(self, network: Network) -> None:
        """Raises `HoticeError` for a policy that reads other fields than those that are built."""
        task = PolicyTask.from_meta(network.meta, network.name)
        wanted, built = (task.resolution_m, task.margin_m), (self.live.grid.resolution_m, self.live.margin_m)
        if not np.allclose(wanted, built):
            raise HoticeError(
                f"{network.name} reads fields of {wanted[0]:g} m with a margin of {wanted[1]:g} m, built are those of "
                f"{built[0]:g} m with {built[1]:g} m: start anew with --policy {network.name}"
            )

    @singledispatchmethod
    def _obey(self, order: object) -> None:
        """A policy that was loaded meanwhile."""
        network: Network = order  # type: ignore[assignment]
        self._begin(self.choice, network, self._carry)
        self.walk.tell("note", f"{network.name} was loaded")

    @_obey.register
    def _(self, order: orders.Move) -> None:
        self._obstacles.bring(order.obstacle, order.to_W)

    @_obey.register
    def _(self, order: orders.Restore) -> None:
        self._obstacles.let_go()

    @_obey.register
    def _(self, order: orders.Push) -> None:
        if self.paused or self.walk.over:
            raise HoticeError("time stands still: nothing is pushed; go on or begin anew first")
        self.walk.world.push(order.velocity_W)
        self.walk.tell("note", "pushed by {:.2f}, {:.2f} m/s".format(*order.velocity_W))

    @_obey.register
    def _(self, order: orders.Take) -> None:
        carry = solve_carry(order.carried)
        self._begin(replace(self.choice, carried=order.carried), self._network, carry)

    @_obey.register
    def _(self, order: orders.UsePolicy) -> None:
        network = self.choice.policies[order.policy]()
        self._begin(replace(self.choice, policy=order.policy), network, self._carry)

    @_obey.register
    def _(self, order: orders.Noise) -> None:
        self._begin(replace(self.choice, noise=order.on), self._network, self._carry)

    @_obey.register
    def _(self, order: orders.Pause) -> None:
        self.paused = order.on

    @_obey.register
    def _(self, order: orders.Restart) -> None:
        self._begin(self.choice, self._network, self._carry)

    @_obey.register
    def _(self, order: orders.Slice) -> None:
        self.slice = order
