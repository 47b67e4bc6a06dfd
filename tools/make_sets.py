"""Draws the benchmark sets that are missing, and writes their tables and pictures: `python tools/make_sets.py`.

Scene files that exist are kept: the sets are fixed for good. Tables go to docs/scene_sets.md, sheets of pictures to
docs/scenes/.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import matplotlib
import numpy as np
from rich.progress import track

from hotice.files import make_folder, write_text
from hotice.model import Scene
from hotice.model.generate import Traversal, check_traversable, generate
from hotice.model.generate.families import LARGEST_M, LOADS_M
from hotice.model.generate.sets import SETS, draw_entry
from hotice.model.generate.typical import TYPICAL
from hotice.model.scene import CATEGORIES
from hotice.model.shipped import SHIPPED, load_scenes

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # noqa: E402

DOCS = Path(__file__).resolve().parent.parent / "docs"
SPACING_M = 0.04
COLORS = {"ground": (0.80, 0.45, 0.10), "side": (0.25, 0.42, 0.65), "overhead": (0.62, 0.30, 0.62)}


def draw_set(name: str) -> None:
    """Writes the scenes of a set that are not there yet."""
    folder = make_folder(SHIPPED / name)
    rejected = []
    for index, entry in track(list(enumerate(SETS[name])), name):
        path = folder / f"{index + 1:02d}_{entry.family}.json"
        if not path.exists():
            scene, failed = draw_entry(name, index)
            rejected += failed
            write_text(path, _compact(scene))
    for reject in rejected:
        print(f"rejected {reject.scene}, draw {reject.draw}: {reject.reason}")


def _compact(scene: Scene) -> str:
    """A scene file with one line for each obstacle."""
    data = scene.to_dict()
    lines = [json.dumps(o) for o in data.pop("obstacles")]
    return json.dumps(data)[:-1] + ', "obstacles": [\n' + ",\n".join(lines) + "\n]}\n"


def table(ways: list[tuple[Scene, Traversal]]) -> str:
    """Markdown of name, obstacles by category, way, strides, clearance and postures of each scene."""
    rows = [
        "| Scene | Ground | Side | Overhead | Way [m] | Strides | Clearance [m] | Lowest posture | Load |",
        "|---|" * 9,
    ]
    rows[1] = "|" + "---|" * 9
    for scene, way in ways:
        count = Counter(o.category for o in scene.obstacles)
        drops = [int(p.split("_")[1]) for p in way.postures if p.startswith("crouched")]
        lowest = f"crouched {max(drops)} cm" if drops else "upright"
        lifts = " ".join(w for w in ("raised", "lowered") if any(w in p for p in way.postures)) or "kept"
        cells = [scene.name, *(count[c] for c in CATEGORIES), f"{way.length_m:.2f}", len(way.strides)]
        rows.append("| " + " | ".join(map(str, [*cells, f"{way.clearance_m:.3f}", lowest, lifts])) + " |")
    return "\n".join(rows) + "\n"


def sheet(path: Path, ways: list[tuple[Scene, Traversal]], columns: int) -> None:
    """Pictures of scenes from above and from the right, with the way that the check found."""
    rows = -(-len(ways) // columns)
    figure, axes = plt.subplots(
        2 * rows, columns, figsize=(1.9 * columns, 2.5 * rows), height_ratios=[2.0, 1.5] * rows, squeeze=False
    )
    for axis in axes.flat:
        axis.axis("off")
    for n, (scene, way) in enumerate(ways):
        top, side = axes[2 * (n // columns) : 2 * (n // columns) + 2, n % columns]
        _views(top, side, scene)
        top.plot(way.path[:, 0], way.path[:, 1], color="black", linewidth=0.8)
        top.plot(*way.strides.T, "|", color="red", markersize=4)
        top.plot(*scene.goal, "*", color="green", markersize=5)
        top.set_title(scene.name.split("/")[-1], fontsize=6, pad=1)
    figure.subplots_adjust(0.004, 0.004, 0.996, 0.99, 0.03, 0.06)
    figure.savefig(path, dpi=75 if columns > 5 else 90, pil_kwargs={"optimize": True})
    plt.close(figure)


def _views(top, side, scene: Scene) -> None:
    low, high = np.array(scene.bounds_m)
    axes = [np.arange(a + 0.5 * SPACING_M, b, SPACING_M) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    above, beside = (np.ones((n, len(axes[0]), 3)) for n in (len(axes[1]), len(axes[2])))
    for category in CATEGORIES:
        part = Scene(
            "part", scene.bounds_m, scene.start, scene.goal, tuple(o for o in scene.obstacles if o.category == category)
        )
        solid = part.signed_distance(points) < 0.5 * SPACING_M
        for image, seen in ((above, solid.any(axis=2).T), (beside, solid.any(axis=1).T)):
            image[seen] = 0.35 * image[seen] + 0.65 * np.array(COLORS[category])
    for axis in (top, side):
        axis.axis("on")
        axis.set(xticks=[], yticks=[])
        axis.spines[:].set(color="0.75", linewidth=0.5)
    top.imshow(above, origin="lower", extent=(low[0], high[0], low[1], high[1]), interpolation="nearest")
    side.imshow(beside, origin="lower", extent=(low[0], high[0], low[2], high[2]), interpolation="nearest")


def main() -> None:
    """Everything that is missing, then the documents."""
    make_folder(DOCS / "scenes")
    text = ["# Benchmark sets\n", "Written by `python tools/make_sets.py`; columns and pictures: see `scenes.md`.\n"]
    for name in SETS:
        draw_set(name)
        ways = [(s, check_traversable(s)) for s in track(load_scenes([name]), f"{name}: document")]
        failed = [s.name for s, way in ways if not way.ok]
        if failed:
            raise SystemExit(f"not traversable: {', '.join(failed)}")
        sheet(DOCS / "scenes" / f"{name}.png", ways, 5 if len(ways) == 20 else 10)
        text += [f"## {name}\n", f"![{name}](scenes/{name}.png)\n", table(ways)]
    write_text(DOCS / "scene_sets.md", "\n".join(text))
    for family in track([*TYPICAL, "random"], "families"):
        load = LOADS_M.get(family, LARGEST_M)
        scenes = generate(family, 5).scenes
        ways = [(s, check_traversable(s, carried_half_extents_m=load)) for s in scenes]
        sheet(DOCS / "scenes" / f"family_{family}.png", ways, 5)


if __name__ == "__main__":
    main()
