"""Step adjustment: place and time of the next landing, and the zero-moment point's distance from the sole's middle.

With the zero-moment point at r + delta, r the middle of the stance foot, the DCM at the landing in time T is

    xi(T) = r + delta + (xi - r - delta) exp(omega T) = p + b,

p the foothold and b the offset the next step begins with. Walking is viable while b is kept, so the problem is a small
quadratic programme in (p, b, delta, tau = exp(omega T)); delta (1 - tau) is taken at the planned tau. After Khadiv et
al., "Walking control based on step timing adaptation" (2020), with the zero-moment point as a third means.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.model.frames import rotation_z

Array = NDArray[np.float64]
NUM = 5
"""Variables, in the frame of the stance foot: p (2), delta (2), tau / tau_planned (1); b follows."""


_UPPER = np.triu_indices(NUM)
_ORDER = np.lexsort(_UPPER)  # by columns, as OSQP stores the cost


@dataclass(frozen=True, kw_only=True)
class AdjustConfig:
    """Weights (of squared metres, and of the squared relative change of tau) and bounds."""

    foothold_weight: float = 1.0
    offset_weight: float = 100.0
    zmp_weight: float = 0.3
    timing_weight: float = 0.02
    zmp_reach_m: tuple[float, float] = (0.045, 0.018)
    """Half extents of the zero-moment point's region about the middle of the sole: forward, sideways [m]."""
    forward_m: tuple[float, float] = (-0.25, 0.40)
    """Foothold ahead of the stance foot, least and most [m]."""
    sideways_m: tuple[float, float] = (0.17, 0.42)
    """Foothold beside the stance foot, on its own side, least and most [m]."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.POSITIVE, "foothold_weight", "offset_weight", "zmp_weight", "timing_weight")
        checks.interval("forward_m", self.forward_m)
        checks.interval("sideways_m", self.sideways_m)


@dataclass(frozen=True)
class Adjustment:
    """foothold (2,), offset b (2,), zmp (2,) in W [m]; remaining_s: time to landing [s]; solved: OSQP converged."""

    foothold: Array
    offset: Array
    zmp: Array
    remaining_s: float
    solved: bool


@dataclass
class StepAdjuster:
    """The programme, set up once and solved every control step."""

    config: AdjustConfig = field(default_factory=AdjustConfig)
    _solver: Any = None

    def solve(
        self,
        dcm: Array,
        stance: Array,
        stance_yaw: float,
        foothold: Array,
        offset: Array,
        remaining_s: float,
        omega: float,
        side: float,
        *,
        shift_s: tuple[float, float] = (-0.1, 0.1),
        slack_m: tuple[float, float, float] = (np.inf, np.inf, np.inf),
        freeze: bool = False,
    ) -> Adjustment:
        """Best landing for a measured DCM.

        Args:
            dcm: (2,) measured [m]. stance: (2,) middle of the stance sole [m], stance_yaw [rad].
            foothold: (2,) planned landing [m]; offset: (2,) planned DCM minus foothold at landing [m].
            remaining_s: planned time to landing [s]. omega: [1/s]. side: +1 when the left foot swings, else -1.
            shift_s: by how much the landing may come earlier and later [s]. slack_m: by how much it may be moved back,
                ahead and away from the stance foot [m]. freeze: keep foothold and time.
        """
        # All in the frame of the stance foot, in which reach and the sole are boxes.
        R = rotation_z(stance_yaw)[:2, :2]
        xi, p, b = R.T @ (dcm - stance), R.T @ (foothold - stance), R.T @ offset
        tau = float(np.exp(omega * remaining_s))
        cfg = self.config
        # b = xi tau x + delta (1 - tau) - p, x = tau' / tau, is linear in the variables y = (p, delta, x)
        offset_of = np.zeros((2, NUM))
        offset_of[:, 0:2], offset_of[:, 2:4], offset_of[:, 4] = -np.eye(2), (1.0 - tau) * np.eye(2), tau * xi
        near, far = cfg.sideways_m
        low = np.array([cfg.forward_m[0], near if side > 0 else -far])
        high = np.array([cfg.forward_m[1], far if side > 0 else -near])
        low[0], high[0] = max(low[0], p[0] - slack_m[0]), min(high[0], p[0] + slack_m[1])
        if side > 0:
            high[1] = min(high[1], p[1] + slack_m[2])
        else:
            low[1] = max(low[1], p[1] - slack_m[2])
        low, high = np.minimum(low, p), np.maximum(high, p)  # the plan itself is always allowed
        # Time enters as the ratio of exponentials, in which the problem is linear.
        t_low, t_high = np.exp(omega * shift_s[0]), np.exp(omega * shift_s[1])
        if freeze:
            low, high, t_low, t_high = p, p, 1.0, 1.0
        reach = np.array(cfg.zmp_reach_m)
        weight = np.repeat([cfg.foothold_weight, cfg.zmp_weight, cfg.timing_weight], [2, 2, 1])
        wish = np.concatenate([p, np.zeros(2), [1.0]])
        H = np.diag(weight) + cfg.offset_weight * offset_of.T @ offset_of
        g = -weight * wish - cfg.offset_weight * offset_of.T @ b
        lower, upper = np.concatenate([low, -reach, [t_low]]), np.concatenate([high, reach, [t_high]])
        x, solved = self._solve(H, g, lower, upper, np.clip(wish, lower, upper))
        return Adjustment(
            stance + R @ x[:2],
            R @ (offset_of @ x),
            stance + R @ np.clip(x[2:4], -reach, reach),
            # From the ratio of exponentials back to a time.
            float(np.log(max(x[4], 1e-6) * tau) / omega),
            solved,
        )

    def _solve(self, H: Array, g: Array, lower: Array, upper: Array, otherwise: Array) -> tuple[Array, bool]:
        """Minimum of ½ xᵀH x + gᵀx within bounds, from a cold start, so that equal measurements give equal steps."""
        unit = 1.0 / np.sqrt(np.diag(H))  # x = unit * y
        H, g, lower, upper = unit[:, None] * H * unit, unit * g, lower / unit, upper / unit
        entries = H[_UPPER][_ORDER]
        if not all(np.isfinite(part).all() for part in (entries, g, lower, upper)):
            return otherwise, False
        if self._solver is None:
            import osqp
            from scipy import sparse

            cost = sparse.csc_matrix((entries, (_UPPER[0][_ORDER], _UPPER[1][_ORDER])), shape=(NUM, NUM))
            self._solver = osqp.OSQP()
            self._solver.setup(
                P=cost,
                q=g,
                A=sparse.eye(NUM, format="csc"),
                l=lower,
                u=upper,
                verbose=False,
                eps_abs=1e-6,
                eps_rel=1e-6,
                max_iter=4000,
                polishing=False,
                adaptive_rho=False,
                rho=0.03,
                warm_starting=False,
                check_termination=10,
                scaling=0,
            )
        else:
            self._solver.update(q=g, Px=entries, l=lower, u=upper)
        result = self._solver.solve(raise_error=False)
        if result.info.status != "solved" or not np.isfinite(result.x).all():
            # What a failed solve leaves in its work space is unknown: the next one starts from a new one.
            self._solver = None
            return otherwise, False
        return np.clip(unit * np.asarray(result.x), unit * lower, unit * upper), True
