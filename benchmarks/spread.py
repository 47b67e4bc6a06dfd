"""The spread of success over trial numbers against the binomial one, from the trials that evaluations kept.

    for seed in 0 1 2 3 4; do
      hotice evaluate --policy student --scenes bench20 --rollouts 250 --seed $seed --out r-$seed.json
    done
    python -m benchmarks.spread r-*.json.trials

A ratio of 1: trials are independent. Sampling alone gives 1 ± 1/√(2 T), T being the trials of a scene, all seeds
together.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from hotice.errors import HoticeError
from hotice.evaluate import read_trials, spread_ratio, success_table


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "folders", nargs="+", type=Path, help="OUT.trials of evaluations of the same scenes, a seed each"
    )
    parser.add_argument("--referee", choices=("exact", "points"), default="exact")
    args = parser.parse_args(arguments)
    try:
        won = success_table([read_trials(folder) for folder in args.folders], args.referee)
        ratio = spread_ratio(won)
    except HoticeError as error:
        print(f"spread: {error}", file=sys.stderr)
        return 2
    scenes, trials = won.shape
    print(
        f"{len(args.folders)} evaluations of {scenes} scenes, {trials} trials a scene, success {won.mean():.1%}: "
        f"spread over trial numbers {ratio:.3f} of the binomial one (sampling: ± {(2 * trials) ** -0.5:.3f})"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
