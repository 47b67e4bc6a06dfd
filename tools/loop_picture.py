"""The looping picture at the head of the README: pick up, carry, duck, as the replay page shows it.

    hotice play --controller pickup_then_policy --scene beam --rollouts 1 --out out/pickup.html
    python -m tools.loop_picture out/pickup.html docs/carry.webp

Needs Chromium.
"""

from __future__ import annotations

import argparse
import io
import sys
from pathlib import Path

from PIL import Image

from hotice.files import write_bytes
from tools.browser import opened

WIDTH, HEIGHT = 720, 420
FRAMES_PER_S = 12.0
HOLD_S = 1.2


def instants(end_s: float, fast: float, until_s: float) -> list[float]:
    """Instants of the rollout [s] that are shown, one after the other: `fast` times its own speed at first."""
    first = [n * fast / FRAMES_PER_S for n in range(int(min(until_s, end_s) * FRAMES_PER_S / fast))]
    return [*first, *(until_s + n / FRAMES_PER_S for n in range(int((end_s - until_s) * FRAMES_PER_S) + 1))]


def frames(page: Path, fast: float, until_s: float) -> list[Image.Image]:
    """Pictures of the first rollout."""
    with opened(f"{page.resolve().as_uri()}#rollout=1&time=0&pause&plain", WIDTH, HEIGHT) as shown:
        end = float(shown.run("document.getElementById('time').max"))
        shown.run("['sgf', 'ogf', 'trail'].forEach((id) => document.getElementById(id).click())")
        shots = []
        for time_s in instants(end, fast, until_s):
            shown.run(f"location.hash = 'rollout=1&time={time_s:.3f}&pause&plain'")
            shown.drawn()
            shots.append(Image.open(io.BytesIO(shown.picture())).convert("RGB"))
        if shown.complaints:
            raise RuntimeError(f"the page complained: {shown.complaints[0]}")
    return shots


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", type=Path, help="replay page")
    parser.add_argument("out", type=Path, help="animated .webp")
    parser.add_argument("--fast", type=float, default=6.0, help="speed of the beginning")
    parser.add_argument("--until-s", type=float, default=20.5, help="end of the beginning [s]")
    parser.add_argument("--quality", type=int, default=60, help="of the pictures, up to 100")
    asked = parser.parse_args()
    shots = frames(asked.page, asked.fast, asked.until_s)
    times = [round(1000 / FRAMES_PER_S)] * (len(shots) - 1) + [round(1000 * HOLD_S)]
    buffer = io.BytesIO()
    shots[0].save(
        buffer, "WEBP", save_all=True, append_images=shots[1:], duration=times, loop=0, quality=asked.quality, method=4
    )
    write_bytes(asked.out, buffer.getvalue())
    print(f"{asked.out}: {len(shots)} frames, {len(buffer.getvalue()) / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
