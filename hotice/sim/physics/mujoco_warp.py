"""Physics on an NVIDIA GPU: MuJoCo Warp, sharing its memory with torch; on the CPU for parity tests."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Sequence

import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp
from torch import Tensor

from hotice import checks
from hotice.errors import InvalidConfig, SimulationError
from hotice.model.builder import HIT_SENSORS
from hotice.sim.physics.mujoco_batch import differing_fields

CONTACTS = 48
"""Contacts an environment on average: soles 8, palms 8, the object against trunk and floor the rest."""
CONSTRAINTS = 280
"""Rows of constraints an environment: 20 dry frictions, joint limits and four a contact."""
_NOT_SIMULATED = frozenset({"bvh_aabb", "dof_M0", "dof_length"})
"""Model fields that serve ray casts, sleeping and the compiler: MuJoCo Warp steps without them."""

_LIMITED = int(mjw.OverflowType.ITERATIONS | mjw.OverflowType.LS_ITERATIONS)
"""Solvers that stopped at their iteration limit are no overflow: MuJoCo's stop there too."""


class MujocoWarp:
    """`Physics` on MuJoCo Warp; see there for the attributes. Tensors are float32 on the GPU.

    All models share shapes (`geom_type`); sizes, masses and every other parameter may differ. A control step is one
    CUDA graph. Models with obstacles are scored exactly on the CPU only.

    Raises:
        InvalidConfig: no environment, models that cannot share a batch, or models with obstacles.
        SimulationError: (in `step`) the contacts or constraints of a step outgrew their buffers.
    """

    def __init__(
        self,
        models: Sequence[mujoco.MjModel],
        num_envs: int,
        device: torch.device | str,
        contacts: int = CONTACTS,
        constraints: int = CONSTRAINTS,
    ) -> None:
        checks.whole("num_envs", num_envs, checks.COUNT)
        self.num_envs = num_envs
        self.device = torch.device(device)
        self.hits: Tensor | None = None
        self.self_depth: Tensor | None = None
        self.met: Tensor | None = None
        self.follow: Callable[[int], tuple[Tensor, Tensor]] | None = None
        self.models = list(models)
        first = copy.copy(self.models[0])
        first.opt.jacobian = mujoco.mjtJacobian.mjJAC_AUTO  # sparse ones are for the CPU
        if mujoco.mj_name2id(first, mujoco.mjtObj.mjOBJ_SENSOR, HIT_SENSORS[0]) >= 0:
            raise InvalidConfig("models with obstacles need the backend 'mujoco': MuJoCo Warp here steps training only")
        differing = [name for name in differing_fields(self.models) if name not in _NOT_SIMULATED]
        _check_batched(differing)
        wp.config.log_level = wp.LOG_WARNING if self.device.type == "cuda" else wp.LOG_ERROR  # no word on each kernel
        wp.init()
        self._wp_device = wp.device_from_torch(self.device)
        with wp.ScopedDevice(self._wp_device):
            self._m = mjw.put_model(first, batch_sizes=dict.fromkeys(differing, num_envs))
            self._m.opt.warn_overflow = 0  # found and raised by `step`
            self._d = mjw.make_data(first, nworld=num_envs, nconmax=contacts, njmax=constraints)
        d = self._d
        self.qpos, self.qvel, self.ctrl = (wp.to_torch(a) for a in (d.qpos, d.qvel, d.ctrl))
        self.xpos, self.xmat, self.com = (wp.to_torch(a) for a in (d.xpos, d.xmat, d.subtree_com))
        self.cvel = wp.to_torch(d.cvel)
        self._warmstart, self._time = wp.to_torch(d.qacc_warmstart), wp.to_torch(d.time)
        self._force, self._overflow = wp.to_torch(d.actuator_force), wp.to_torch(d.overflow)
        self.actuator_force = self._force.clone()
        self._rows = {
            name: torch.tensor(np.stack([getattr(m, name) for m in self.models]), dtype=torch.float32, device=device)
            for name in differing
        }
        self._fields = {name: wp.to_torch(getattr(self._m, name)) for name in differing}
        self._graphs: dict[int, wp.Graph] = {}
        everyone = torch.arange(num_envs, device=self.device)
        self.set_models(everyone, everyone % len(self.models))

    def set_models(self, ids: Tensor, model_ids: Tensor) -> None:
        """Writes every parameter in which the models differ."""
        for name, values in self._rows.items():
            field = self._fields[name]
            field[ids] = values[model_ids].view(len(ids), *field.shape[1:])

    def step(self, substeps: int, target: Tensor | None = None, delay: Tensor | None = None) -> None:
        at_once = substeps if target is None or delay is None else 1
        for k in range(0, substeps, at_once):
            if target is not None and delay is not None:
                self.ctrl.copy_(torch.where((delay == k)[:, None], target.to(self.ctrl.dtype), self.ctrl))
            self._run(at_once)
        self.actuator_force.copy_(self._force)
        overflow = self._overflow & ~_LIMITED
        if overflow.any():
            full = [str(kind.name) for kind in mjw.OverflowType if (overflow & int(kind)).any()]
            worlds = int((overflow != 0).sum())
            raise SimulationError(
                f"{' and '.join(full)} buffers of MuJoCo Warp overflowed in {worlds} of {self.num_envs} environments: "
                f"raise CONTACTS ({CONTACTS}) or CONSTRAINTS ({CONSTRAINTS}) in hotice.sim.physics.mujoco_warp"
            )

    def forward(self, ids: Tensor) -> None:
        self._warmstart[ids] = 0.0
        self.actuator_force[ids] = 0.0
        self._run(0)

    def state(self) -> dict[str, Tensor]:
        return {name: value.clone() for name, value in self._state().items()}

    def load_state(self, state: dict[str, Tensor]) -> None:
        for name, value in self._state().items():
            value.copy_(state[name])
        self._run(0)

    def _state(self) -> dict[str, Tensor]:
        return {
            "qpos": self.qpos,
            "qvel": self.qvel,
            "ctrl": self.ctrl,
            "warmstart": self._warmstart,
            "time": self._time,
            "actuator_force": self.actuator_force,
        }

    def _run(self, substeps: int) -> None:
        """Steps, then brings poses and velocities up to date; on a GPU as one graph, in torch's stream."""
        if self.device.type == "cpu":
            self._launch(substeps)
            return
        if substeps not in self._graphs:
            self._launch(substeps)  # compiles; a capture must not
            with wp.ScopedCapture(self._wp_device) as capture:
                self._launch(substeps)
            assert capture.graph is not None  # there is one once a capture has ended
            self._graphs[substeps] = capture.graph
            return
        wp.capture_launch(self._graphs[substeps], stream=wp.stream_from_torch(torch.cuda.current_stream(self.device)))

    def _launch(self, substeps: int) -> None:
        with wp.ScopedDevice(self._wp_device):
            for _ in range(substeps):
                mjw.step(self._m, self._d)
            derived: tuple[Callable, ...] = (mjw.kinematics, mjw.com_pos, mjw.com_vel)
            for stage in derived:
                stage(self._m, self._d)


def _check_batched(names: Sequence[str]) -> None:
    shapes: dict[str, tuple] = {field.name: getattr(field.type, "shape", ()) for field in dataclasses.fields(mjw.Model)}
    shared = [name for name in names if shapes.get(name, ())[:1] != ("*",)]
    if shared:
        raise InvalidConfig(
            f"models differ in {', '.join(shared)}, which MuJoCo Warp holds once for all environments: "
            "give every model one geom of each object shape (build_model(..., object_shapes=...))"
        )
