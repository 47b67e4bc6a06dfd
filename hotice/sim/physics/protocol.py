"""Protocol of every physics backend: batched states as torch tensors, zero-copy, and a step.

Everything above this protocol is torch and does not know which simulator runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

from hotice.errors import InvalidConfig, UnknownName

if TYPE_CHECKING:
    import mujoco
    import torch
    from torch import Tensor

BACKENDS = ("mujoco", "warp")


class Physics(Protocol):
    """N simulations of models that share one layout (same bodies and joints) and differ in parameters.

    Tensors are live views of the simulator: state tensors may be written, then `forward(ids)` brings the derived ones
    up to date. World frame, SI units, quaternions wxyz.

    Attributes:
        qpos (N, nq), qvel (N, nv), ctrl (N, nu): state and servo targets, writable.
        xpos (N, B, 3), xmat (N, B, 3, 3): body frames. cvel (N, B, 6): spatial velocity (angular, linear) at `com`.
        hits: (N, 2) bool, whether robot and object touched an obstacle during the last step, or None where the models
            hold no obstacles.
        self_depth: (N,) how deep the robot's parts were in each other at most during the last step [m], or None like
            `hits`.
        met: (N, M) bool, whether each of the M moving obstacles touched robot or object during the last step, or None
            where the models hold none; `hits` counts them too.
        follow: where the moving obstacles of models that hold some are: a function of k that gives their positions
            (N, M, 3) and quaternions (N, M, 4) after physics step k of a control step; None: where they are.
        com (N, B, 3): centre of mass of the subtree below each body.
        actuator_force (N, nu) [N m] in the last substep, zero after `forward`: a copy.
    """

    num_envs: int
    device: torch.device
    qpos: Tensor
    qvel: Tensor
    ctrl: Tensor
    xpos: Tensor
    xmat: Tensor
    cvel: Tensor
    com: Tensor
    actuator_force: Tensor
    hits: Tensor | None
    self_depth: Tensor | None
    met: Tensor | None
    follow: Callable[[int], tuple[Tensor, Tensor]] | None

    def step(self, substeps: int, target: Tensor | None = None, delay: Tensor | None = None) -> None:
        """Advances all simulations; derived tensors then describe the new state.

        With `target` (N, nu) and `delay` (N,) int64, simulation i keeps its `ctrl` for `delay[i]` physics steps and
        then takes `target[i]`; where the delay is not shorter than `substeps`, it keeps it.
        """
        ...

    def forward(self, ids: Tensor) -> None:
        """Derived tensors of simulations `ids` (n,) from their state; clears their solver warm start."""
        ...

    def state(self) -> dict[str, Tensor]:
        """Copies of everything that the next step depends on, beside the models."""
        ...

    def load_state(self, state: dict[str, Tensor]) -> None:
        """Restores `state()`; the next steps are then the same bit for bit."""
        ...

    def set_models(self, ids: Tensor, model_ids: Tensor) -> None:
        """Gives simulations `ids` (n,) the parameters of the models `model_ids` (n,)."""
        ...


def make_physics(
    backend: str, models: Sequence[mujoco.MjModel], num_envs: int, device: torch.device | str, threads: int = 0
) -> Physics:
    """The named backend: "mujoco" on the CPU, "warp" on an NVIDIA GPU (or, slowly, the CPU).

    Raises `UnknownName`, and `InvalidConfig` for a device that the backend cannot use or packages that are missing.
    """
    if backend == "mujoco":
        import torch

        from hotice.sim.physics.mujoco_batch import MujocoBatch

        if torch.device(device).type != "cpu":
            raise InvalidConfig(
                f"physics 'mujoco' runs on the device 'cpu', not on {str(device)!r}: use physics 'warp'"
            )
        return MujocoBatch(models, num_envs, threads)
    if backend == "warp":
        try:
            from hotice.sim.physics.mujoco_warp import MujocoWarp
        except ImportError as error:
            raise InvalidConfig(f"physics 'warp' needs {error.name}: pip install 'hotice[gpu]'") from None
        return MujocoWarp(models, num_envs, device)
    raise UnknownName("physics backend", backend, BACKENDS)
