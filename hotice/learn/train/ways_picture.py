"""Picture of trials from above: obstacles at hip height, ways of the root, coloured by how they ended."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hotice.fields.bank import FieldBank
from hotice.learn.train.trials import TrialResults
from hotice.task.rules import OUTCOMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_SCENES = 6
HEIGHT_M = 0.6
"""Height of the cut through the scene."""
COLORS = {"success": "#15803d", "timeout": "#a16207"}
FAILURE = "#b91c1c"


def ways_figure(results: TrialResults, bank: FieldBank) -> Figure:
    """One map for each of the scenes that have most trials, at most `MOST_SCENES`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    counts = np.bincount(results.scene, minlength=bank.num_scenes)
    chosen = [int(i) for i in np.argsort(-counts, kind="stable")[:MOST_SCENES] if counts[i]]
    columns = min(3, len(chosen))
    lines = -(-len(chosen) // columns)
    figure = Figure(figsize=(4.2 * columns, 3.4 * lines), dpi=90, layout="constrained")
    FigureCanvasAgg(figure)
    cells = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes in cells[len(chosen) :]:
        axes.set_axis_off()
    for axes, scene in zip(cells, chosen, strict=False):
        cut, origin = _cut(bank, scene), bank.volumes.origin[scene]
        x, y = (origin[i] + bank.volumes.resolution_m * np.arange(cut.shape[i]) for i in (0, 1))
        axes.contourf(x, y, cut.T, levels=[-10.0, 0.0], colors=["#5f7590"])
        for i in np.flatnonzero(results.scene == scene):
            color = COLORS.get(OUTCOMES[results.outcome[i]], FAILURE)
            axes.plot(*results.ways[:, i].T, color=color, linewidth=1.0)
            axes.plot(*results.ways[-1, i], "o", color=color, markersize=3)
        goal = bank.scenes[scene].goal
        axes.plot(goal[0], goal[1], "*", color="#16a34a", markersize=11)
        won = int((results.outcome[results.scene == scene] == OUTCOMES.index("success")).sum())
        axes.set_title(f"{bank.names[scene]}: {won} of {counts[scene]}", fontsize=9)
        axes.set_aspect("equal")
        axes.tick_params(labelsize=7)
    return figure


def _cut(bank: FieldBank, scene: int) -> np.ndarray:
    """Signed distance to obstacles at `HEIGHT_M`, (X, Y) [m]."""
    volumes = bank.volumes
    shape = tuple(int(n) for n in volumes.shape[scene])
    first = int(volumes.offset[scene])
    level = round((HEIGHT_M - float(volumes.origin[scene][2])) / volumes.resolution_m)
    nodes = np.asarray(volumes.sdf[first : first + int(np.prod(shape))]).reshape(shape)
    return nodes[:, :, min(max(level, 0), shape[2] - 1)]
