"""Scoring a policy or the walking baseline: success rate and mean distance, with exact collision geometry (paper, V-A).

A trial ends at success, at a failure, or after 5 s. Success: the root comes within 0.1 m (horizontally) of the goal
before any fall, drop or collision of robot or object. Mean distance: root to goal at the end of each trial, averaged.
Every link of the robot and the object are tested against every obstacle geometry in the simulator, in every physics
step. The simulation goes on beyond that end, for other referees and for where the robot is at 5 s:
`hotice.evaluate.referees`.

The work is done in blocks (`hotice.evaluate.scorer`), shared out to processes; what is done is kept, so that an
evaluation that was interrupted goes on.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hotice.console import PlainConsole
from hotice.errors import Stopped
from hotice.evaluate.carriers import Carrier, load_carrier
from hotice.evaluate.config import EvaluateConfig
from hotice.evaluate.processes import Block, score_blocks
from hotice.evaluate.report import make_report, print_report
from hotice.evaluate.scorer import Scorer
from hotice.evaluate.trials import Trials, TrialStore
from hotice.files import check_folder, check_writable, write_text
from hotice.owner import check_unowned, sole_owner
from hotice.progress import counting


def evaluate(config: EvaluateConfig) -> dict[str, Any]:
    """Scores a policy, or the walk, on scenes, prints a table, writes the report; returns it. Raises `HoticeError`."""
    carrier = load_carrier(config)
    if config.out is not None:
        check_writable(config.out)
        check_folder(_trials_of(config.out))
        check_unowned(_trials_of(config.out))
    scorer = Scorer.of(config)
    console = PlainConsole(stderr=True)
    if config.out is None:
        done = _score_all(scorer, carrier, None)
    else:
        with sole_owner(_trials_of(config.out)):
            done = _score_all(scorer, carrier, _open_store(config.out, scorer, carrier, console))
    scores = [
        (scene.name, Trials.joined(done[block] for block in scorer.blocks() if block[0] == number))
        for number, scene in enumerate(scorer.scenes)
    ]
    report = make_report(carrier, config, scores, [scene.name for scene in scorer.scenes if scene.moving])
    if config.out is not None:
        write_text(config.out, json.dumps(report, indent=1) + "\n")
    print_report(report, PlainConsole(width=None if PlainConsole().is_terminal else 130))
    return report


def _trials_of(out: Path) -> Path:
    """Folder of what is done, beside the report."""
    return Path(f"{out}.trials")


def _open_store(out: Path, scorer: Scorer, carrier: Carrier, console: PlainConsole) -> TrialStore:
    """Store of earlier trials beside the report; prints whether the evaluation goes on from them."""
    names = [scene.name for scene in scorer.scenes]
    store = TrialStore(_trials_of(out), scorer.settings(carrier), names)
    if store.changed:
        console.print(f"{store.folder} was made with another {', '.join(store.changed)}: starting anew")
    elif store.blocks:
        console.print(f"{len(store.blocks)} of {len(scorer.blocks())} blocks are in {store.folder}: going on")
    return store


def _score_all(scorer: Scorer, carrier: Carrier, store: TrialStore | None) -> dict[Block, Trials]:
    """Trials of all blocks; scores and stores those that are not yet, under a bar of progress."""
    config, done = scorer.config, store.blocks if store is not None else {}
    before = sum(trials.rollouts for trials in done.values())
    left = [block for block in scorer.blocks() if block not in done]
    with counting("trials", config.rollouts * len(scorer.scenes), before) as told:
        scored = score_blocks(scorer, carrier, left, config.threads, lambda n: told(before + n))
        try:
            for (scene, block), trials in scored:
                done[scene, block] = trials
                if store is not None:
                    store.add(scene, block, trials)
        except KeyboardInterrupt:
            if store is None or not done:
                raise
            kept = f"{len(done)} of {len(scorer.blocks())} blocks are kept in {store.folder}"
            raise Stopped(f"{kept}: the same command goes on") from None
    return done
