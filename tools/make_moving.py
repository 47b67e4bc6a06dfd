"""Draws the scenes of `moving20` that are missing, and writes their table and pictures: `python tools/make_moving.py`.

Scene files that exist are kept: the set is fixed for good. The table goes to docs/moving_set.md, the sheet of pictures
to docs/scenes/.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np  # noqa: E402
from matplotlib import pyplot as plt  # noqa: E402
from rich.progress import track  # noqa: E402

from hotice.files import make_folder, write_text  # noqa: E402
from hotice.model import Scene  # noqa: E402
from hotice.model.generate.moving_set import ENTRIES, NAME, draw_moving  # noqa: E402
from hotice.model.generate.passing import Passing, check_passing  # noqa: E402
from hotice.model.shipped import SHIPPED, load_scenes  # noqa: E402
from hotice.replay.maps import draw_map  # noqa: E402

DOCS = Path(__file__).resolve().parent.parent / "docs"
HEAD = f"""# moving20

Written by `python tools/make_moving.py`; what the set is for: [moving.md](moving.md). Speed: of what moves. Way: the
earliest one that `hotice.model.generate.passing` finds, which knows all motions beforehand: arrival, how long of it the
robot stands, and the least distance from a disc of 40 cm radius.

![{NAME}](scenes/{NAME}.png)

Where everything is at first, the ways of what moves (dotted), and the way found (black), with a dot every half second.

| Scene | Speed [m/s] | Moving | There in [s] | Stands [s] | Clearance [m] |
|---|---|---|---|---|---|
"""


def draw_set() -> None:
    """Writes the scenes that are not there yet."""
    folder = make_folder(SHIPPED / NAME)
    for index, (kind, _) in track(list(enumerate(ENTRIES)), NAME):
        path = folder / f"{index + 1:02d}_{kind}.json"
        if not path.exists():
            draw_moving(index).save(path)


def sheet(path: Path, ways: list[tuple[Scene, Passing]]) -> None:
    """Pictures of the scenes from above."""
    figure, axes = plt.subplots(5, 4, figsize=(9.0, 11.6), squeeze=False)
    for axis, (scene, way) in zip(axes.flat, ways, strict=True):
        draw_map(axis, scene, way.path)
        marks = np.arange(0.5, way.arrival_s, 0.5)
        axis.plot(*(np.interp(marks, way.path[:, 2], way.path[:, i]) for i in range(2)), "k.", markersize=4, zorder=7)
        axis.set(xticks=[], yticks=[], xlabel="", ylabel="")
        axis.set_title(scene.name.split("/")[-1], fontsize=8, pad=2)
    figure.subplots_adjust(0.005, 0.005, 0.995, 0.98, 0.03, 0.08)
    figure.savefig(path, dpi=80, pil_kwargs={"optimize": True})
    plt.close(figure)


def main() -> None:
    """Everything that is missing, then the documents."""
    draw_set()
    ways = [(scene, check_passing(scene)) for scene in track(load_scenes([NAME]), f"{NAME}: document")]
    failed = [scene.name for scene, way in ways if not way.ok]
    if failed:
        raise SystemExit(f"no way in time: {', '.join(failed)}")
    sheet(make_folder(DOCS / "scenes") / f"{NAME}.png", ways)
    rows = [
        f"| {scene.name} | {speed} | {', '.join(o.name for o in scene.moving)} | {way.arrival_s:.1f} | "
        f"{way.waiting_s:.1f} | {way.clearance_m:.2f} |"
        for (scene, way), (_, speed) in zip(ways, ENTRIES, strict=True)
    ]
    write_text(DOCS / "moving_set.md", HEAD + "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
