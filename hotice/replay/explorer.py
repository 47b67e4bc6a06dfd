"""Sliders over the constants of HOD-PF, for notebooks."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hotice.fields import FieldParams, build_hod_pf
from hotice.fields.defaults import MARGIN_M
from hotice.model.scene import Scene
from hotice.replay.slices import draw_descent, draw_slice

if TYPE_CHECKING:
    import ipywidgets


def field_explorer(scene: Scene, starts_W: NDArray[np.float64], *, plane: str = "xz", at_m: float = 0.0) -> Any:
    """A widget: both fields of a scene in a plane, solved anew as m, d0, xi and eta are moved.

    Args:
        scene: what to solve.
        starts_W: points (n, 3) in W [m] whose paths along the fields are drawn.
        plane: "xy", "xz" or "yz".
        at_m: place of the plane along its normal [m].
    """
    import ipywidgets

    picture = ipywidgets.Image(value=_picture(scene, starts_W, plane, at_m, MARGIN_M, FieldParams()), format="png")
    sliders = _sliders()

    def update(_: Any) -> None:
        m, d0, xi, eta = (slider.value for slider in sliders)
        params = FieldParams(influence_distance_m=d0, repulsion=xi, attraction=eta)
        picture.value = _picture(scene, starts_W, plane, at_m, m, params)

    for slider in sliders:
        slider.observe(update, "value")
    return ipywidgets.VBox([ipywidgets.HBox(sliders[:2]), ipywidgets.HBox(sliders[2:]), picture])


def _sliders() -> list[ipywidgets.Widget]:
    from ipywidgets import FloatLogSlider, FloatSlider, Layout

    paper = FieldParams()
    options: dict[str, Any] = {
        "continuous_update": False,
        "layout": Layout(width="45%"),
        "style": {"description_width": "9em"},
    }
    return [
        FloatSlider(MARGIN_M, min=0.0, max=0.3, step=0.01, description="margin m [m]", **options),
        FloatSlider(paper.influence_distance_m, min=0.05, max=0.6, step=0.05, description="reach d0 [m]", **options),
        FloatLogSlider(paper.repulsion, min=-5, max=-1, description="repulsion xi", readout_format=".1e", **options),
        FloatSlider(paper.attraction, min=0.1, max=1.5, step=0.1, description="attraction eta", **options),
    ]


def _picture(
    scene: Scene, starts_W: NDArray[np.float64], plane: str, at_m: float, margin_m: float, params: FieldParams
) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    pf = build_hod_pf(scene, margin_m=margin_m, params=params)
    figure = Figure(figsize=(15.0, 4.4), dpi=80, layout="constrained")
    FigureCanvasAgg(figure)
    for axes, field in zip(figure.subplots(1, 2), ("sgf", "ogf"), strict=True):
        draw_slice(axes, pf, field, plane=plane, at_m=at_m)
        draw_descent(axes, pf, field, starts_W, plane=plane)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
