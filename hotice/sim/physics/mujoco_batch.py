"""Physics on the CPU: `mujoco.batch`, threaded, with live torch views of its rows."""

from __future__ import annotations

import contextlib
import copy
import warnings
from collections.abc import Callable, Iterator, Sequence

import mujoco
import mujoco.batch
import numpy as np
import torch
from torch import Tensor

from hotice import checks
from hotice.errors import InvalidConfig
from hotice.machine import usable_cores
from hotice.model.builder import HIT_SENSORS

_STAGE = mujoco.mjtStage
_NEVER_EXPANDED = frozenset({"names", "paths", "text_data", "key_qpos", "key_qvel", "key_ctrl", "qpos_spring"})


def _view(array: np.ndarray) -> Tensor:
    """A torch tensor on the same memory, also of arrays that only the simulator may write."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return torch.from_numpy(array)


@contextlib.contextmanager
def unlogged() -> Iterator[None]:
    """Silences MuJoCo's warnings, also MUJOCO_LOG.TXT: the task finds and counts diverged states itself."""
    before, quiet = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    quiet.logto_file = quiet.logto_console = False
    quiet.set()
    try:
        yield
    finally:
        before.set()


class MujocoBatch:
    """`Physics` on `mujoco.batch.Batch`; see there for the attributes. Tensors are float64 on the CPU.

    `only`: simulations that `step` advances, (n,) ids, or None for all; the others stand still and hit nothing.
    """

    def __init__(self, models: Sequence[mujoco.MjModel], num_envs: int, threads: int = 0) -> None:
        checks.whole("num_envs", num_envs, checks.COUNT)
        self.num_envs = num_envs
        self.only: Tensor | None = None
        self.device = torch.device("cpu")
        self.models = list(models)
        first = copy.copy(self.models[0])
        first.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a diverged state must stay visible
        self.batch = mujoco.batch.Batch(first, num_envs, nthread=threads or usable_cores(), persistent=True)
        self.qpos, self.qvel, self.ctrl = (_view(self.batch.bind(n)) for n in ("qpos", "qvel", "ctrl"))
        self._warmstart = _view(self.batch.bind("qacc_warmstart"))
        self._time = _view(self.batch.bind("time"))
        nbody = self.models[0].nbody
        self.xpos = _view(self.batch.bind("xpos")).view(num_envs, nbody, 3)
        self.xmat = _view(self.batch.bind("xmat")).view(num_envs, nbody, 3, 3)
        self.cvel = _view(self.batch.bind("cvel")).view(num_envs, nbody, 6)
        self.com = _view(self.batch.bind("subtree_com")).view(num_envs, nbody, 3)
        self._force = _view(self.batch.bind("actuator_force"))
        self.actuator_force = self._force.clone()  # of the last step: not a function of the state, so it is kept
        has_sensors = mujoco.mj_name2id(self.models[0], mujoco.mjtObj.mjOBJ_SENSOR, HIT_SENSORS[0]) >= 0
        self._sensed = _view(self.batch.bind("sensordata")) if has_sensors else None
        self.hits = torch.zeros(num_envs, 2, dtype=torch.bool) if has_sensors else None
        self.self_depth = torch.zeros(num_envs) if has_sensors else None
        moving = self.models[0].nmocap
        self.follow: Callable[[int], tuple[Tensor, Tensor]] | None = None
        self.met = torch.zeros(num_envs, moving, dtype=torch.bool) if has_sensors and moving else None
        self._mocap = tuple(_view(self.batch.bind(n)) for n in ("mocap_pos", "mocap_quat")) if moving else ()
        self._rows = {name: np.stack([getattr(m, name) for m in self.models]) for name in differing_fields(self.models)}
        self._fields = {name: self.batch.expand(name) for name in self._rows}
        self.set_models(torch.arange(num_envs), torch.arange(num_envs) % len(self.models))

    def set_models(self, ids: Tensor, model_ids: Tensor) -> None:
        """Writes every parameter in which the models differ."""
        rows, which = ids.numpy(), model_ids.numpy()
        for name, values in self._rows.items():
            self._fields[name][rows] = values[which].reshape(len(rows), *self._fields[name].shape[1:])

    def step(self, substeps: int, target: Tensor | None = None, delay: Tensor | None = None) -> None:
        if self.hits is not None:
            self._step_with_hits(substeps, target, delay)
        elif target is None or delay is None:
            self._step(substeps, self._moved())
        else:  # equal delays together: every call reads and writes all the memory of its simulations
            for first in torch.unique(delay.clamp(max=substeps)).tolist():
                ids = self._moved(delay.clamp(max=substeps) == first)
                if first:
                    self._step(first, ids)
                if first < substeps:
                    self.ctrl[ids] = target[ids].to(self.ctrl.dtype)
                    self._step(substeps - first, ids)
        self.actuator_force.copy_(self._force)

    def _step_with_hits(self, substeps: int, target: Tensor | None, delay: Tensor | None) -> None:
        """The same one by one: a contact counts in whichever physics step it happens."""
        assert self.hits is not None and self._sensed is not None and self.self_depth is not None
        self.hits.zero_()
        self.self_depth.zero_()
        if self.met is not None:
            self.met.zero_()
        ids = self._moved()
        moved = slice(None) if ids is None else ids
        for k in range(substeps):
            if target is not None and delay is not None:
                arrives = delay == k
                self.ctrl[arrives] = target[arrives].to(self.ctrl.dtype)
            self._place_moving(k)
            self._step(1, ids, _STAGE.mjSTAGE_ACC if k == substeps - 1 else _STAGE.mjSTAGE_VEL)
            sensed = self._sensed[moved]
            self.hits[moved] |= sensed[:, :2] > 0
            if self.met is not None:
                self._see_moving(moved, sensed[:, 3:] > 0)
            self.self_depth[moved] = torch.maximum(self.self_depth[moved], -sensed[:, 2].float())

    def _place_moving(self, k: int) -> None:
        """Places what moves where it will be after physics step k: contacts see it a step ahead at most."""
        if self.follow is not None:
            for place, value in zip(self._mocap, self.follow(k), strict=True):
                place.copy_(value.view(place.shape))

    def _see_moving(self, moved: Tensor | slice, sensed: Tensor) -> None:
        """Counts contacts (n, 2 M), of robot and object with each moving obstacle in turn."""
        assert self.met is not None and self.hits is not None
        each = sensed.view(len(sensed), -1, 2)
        self.met[moved] |= each.any(dim=2)
        self.hits[moved] |= each.any(dim=1)

    def _moved(self, which: Tensor | None = None) -> Tensor | None:
        """Ids (n,) of the simulations that move, of those in `which` (N,) bool; None for all."""
        if which is None:
            return self.only
        ids = torch.nonzero(which).squeeze(1)
        return ids if self.only is None else ids[torch.isin(ids, self.only)]

    def _step(self, substeps: int, ids: Tensor | None, stage: mujoco.mjtStage = _STAGE.mjSTAGE_VEL) -> None:
        """Steps `ids`, then computes stages of the new state; contact sensors are current from `mjSTAGE_ACC` on."""
        if ids is not None and not len(ids):
            return
        try:
            with unlogged():
                rows = None if ids is None else ids.to(torch.int32).numpy()
                self.batch.step(ids=rows, nstep=substeps, stage=stage)
        except mujoco.batch.SimulationError as error:  # those rows keep their state: mark them, the task ends them
            self.qvel[torch.as_tensor(np.asarray(error.ids), dtype=torch.int64)] = torch.nan

    def state(self) -> dict[str, Tensor]:
        rows = {
            "qpos": self.qpos,
            "qvel": self.qvel,
            "ctrl": self.ctrl,
            "warmstart": self._warmstart,
            "time": self._time,
            "actuator_force": self.actuator_force,
        }
        return {name: value.clone() for name, value in rows.items()}

    def load_state(self, state: dict[str, Tensor]) -> None:
        self.batch.reset(stage=_STAGE.mjSTAGE_NONE)
        self.qpos[:], self.qvel[:], self.ctrl[:] = state["qpos"], state["qvel"], state["ctrl"]
        self._warmstart[:], self._time[:] = state["warmstart"], state["time"]
        self.batch.forward(stage=_STAGE.mjSTAGE_VEL)
        if "actuator_force" in state:  # absent in checkpoints written before it was kept
            self.actuator_force.copy_(state["actuator_force"])

    def forward(self, ids: Tensor) -> None:
        self._warmstart[ids] = 0.0
        self.batch.forward(ids=ids.to(torch.int32).numpy(), stage=_STAGE.mjSTAGE_VEL)
        self.actuator_force[ids] = 0.0
        if self.hits is not None:
            self.hits[ids] = False
        if self.met is not None:
            self.met[ids] = False


def differing_fields(models: Sequence[mujoco.MjModel]) -> list[str]:
    """Names of the model fields that are not the same in every model.

    Raises `InvalidConfig` for another layout or other settings of the simulator (`opt`). `stat.meaninertia` may differ:
    it scales the tolerance at which the solver stops.
    """
    first = models[0]
    names = []
    for name in sorted(mujoco.batch.MODEL_FIELDS):
        if name.startswith("opt.") or name in _NEVER_EXPANDED:
            continue
        values = [np.asarray(getattr(m, name)) for m in models]
        if any(v.shape != values[0].shape for v in values):
            raise InvalidConfig(f"models differ in the shape of {name}: one layout is needed in a batch")
        if any(not np.array_equal(v, values[0]) for v in values[1:]):
            names.append(name)
    if any((m.nq, m.nv, m.nu) != (first.nq, first.nv, first.nu) for m in models):
        raise InvalidConfig("models differ in their joints: one layout is needed in a batch")
    for name in sorted(n for n in mujoco.batch.MODEL_FIELDS if n.startswith("opt.")):
        values = [np.asarray(getattr(m.opt, name.removeprefix("opt."))) for m in models]
        if any(not np.array_equal(v, values[0]) for v in values[1:]):
            raise InvalidConfig(
                f"models differ in {name}, which a batch reads off the first: build them with one setting"
            )
    return names
