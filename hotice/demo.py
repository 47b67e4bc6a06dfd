"""`make demo`: the shipped policy carries a box through three scenes.

    python -m hotice.demo [--out out/demo] [--rollouts 20]

Compiles what is compiled once, builds the fields of open floor, pipe and side gap, scores the policy with exact
geometry, writes a table (JSON), one self-contained replay page and an overview picture, and says what to type next.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

DEMO_POLICY = "student"
SCENES = ("open_floor", "pipe", "gap")
NEXT = """
next, after `source .venv/bin/activate`:
  hotice play --policy student --scene beam --out beam.html                     look at it in another scene
  hotice evaluate --policy student --scenes bench20 --rollouts 4 --seed 1       score it in twenty
  hotice train --num-envs 256 --max-minutes 10 --out runs/first                 train one of your own
  hotice --help                                                                 all commands"""


@dataclass(frozen=True, kw_only=True)
class DemoConfig:
    """The demo."""

    out: Path = Path("out/demo")
    """Folder of report, page and picture."""
    rollouts: int = 20
    """Scored trials a scene."""
    shown: int = 2
    """Rollouts a scene in the replay."""
    policy: str = DEMO_POLICY
    """Shipped policy by name, .onnx file, checkpoint folder or run."""
    scenes: tuple[str, ...] = SCENES
    """Scene names or files."""
    seed: int = 0
    """Seed of objects and starts."""


def run(config: DemoConfig) -> None:
    """Runs the demo. Raises `HoticeError`."""
    import numpy as np

    from hotice.commands.warm import warm
    from hotice.compiling import apart
    from hotice.console import PlainConsole
    from hotice.evaluate.config import EvaluateConfig
    from hotice.evaluate.record import record_rollouts
    from hotice.evaluate.run import evaluate
    from hotice.fields import build_hod_pf
    from hotice.files import check_folder, make_folder, output_file
    from hotice.learn.policy import load_policy
    from hotice.model import Box, load_scenes
    from hotice.model.carry import solve_carry
    from hotice.progress import doing
    from hotice.replay import write_html, write_overview

    console = PlainConsole()
    files = [config.out / name for name in ("report.json", "replay.html", "overview.png")]
    check_folder(config.out)
    for file in files:
        output_file(file)
    policy = load_policy(config.policy)
    scenes = load_scenes(config.scenes)
    make_folder(config.out)
    warm()
    for scene in scenes:
        pelvis = np.array([*scene.start[:2], 0.75])
        with apart() as took_s:
            length_m = float(build_hod_pf(scene).sgf.geodesic_distance(pelvis))
        console.print(
            f"fields of {scene.name}: {len(scene.obstacles)} obstacles, path of {length_m:.2f} m, {took_s():.1f} s"
        )
    report, page, picture = files
    evaluate(
        EvaluateConfig(
            policy=config.policy,
            scenes=config.scenes,
            rollouts=config.rollouts,
            seed=config.seed,
            out=report,
            perturbed=False,
        )
    )
    boxes = [Box((0.30, 0.30, 0.30), 1.5), Box((0.25, 0.38, 0.22), 2.5), Box((0.22, 0.25, 0.35), 3.0)]
    states = [solve_carry(box) for box in boxes[: config.shown]]
    records = []
    for scene in scenes:
        with doing(f"recording {scene.name}"):
            records += record_rollouts(policy, scene, states, seed=config.seed)
    write_html(records, page)
    write_overview(records[:: config.shown], picture)
    for what, path in (("report", report), ("replay", page), ("picture", picture)):
        console.print(f"{what:>8}: {path.resolve()}", soft_wrap=True)
    console.print(NEXT, soft_wrap=True)


def main(argv: list[str] | None = None) -> int:
    """Command line; see `hotice.commands.program.guarded`."""
    from hotice.commands.line.catalog import Entry
    from hotice.commands.line.parse import parse
    from hotice.commands.program import guarded

    def work() -> int:
        words = sys.argv[1:] if argv is None else argv
        run(parse(DemoConfig, words, "python -m", Entry("hotice.demo", __doc__ or "")))
        return 0

    return guarded(work)


if __name__ == "__main__":
    sys.exit(main())
