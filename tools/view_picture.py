"""The picture of the live view in docs/view.md: a pillar is dragged into the way, ways and a slice bend round it.

    python -m tools.view_picture docs/view.webp

Needs Chromium.
"""

from __future__ import annotations

import argparse
import io
import re
import subprocess
import sys
import time
from pathlib import Path

from PIL import Image

from hotice.files import write_bytes
from tools.browser import Page, opened

WIDTH, HEIGHT = 1280, 800
SECONDS = 120.0
COMMAND = [sys.executable, "-m", "hotice", "play", "--view", "--scene", "pillars", "--no-perturbed"]
PILLAR = "pillar_2"
TO_W = (1.1, 0.1, 0.75)
WALKED_M = 0.45
"""How far the robot walks before time stands still."""
SEEN = "document.getElementById('view').dataset"


def wait(page: Page, condition: str) -> None:
    """Until a condition of the page holds. Raises `TimeoutError`."""
    end = time.monotonic() + SECONDS
    while not page.run(condition):
        if time.monotonic() > end:
            raise TimeoutError(f"never true: {condition}")
        time.sleep(0.02)


def picture(page: Page) -> Image.Image:
    """The page with the pillar in the way, and the robot on its way round it."""
    wait(page, f"{SEEN}.version !== undefined")
    page.run("document.getElementById('pause').click(); document.getElementById('restart').click()")
    order = f"{{ order: 'move', obstacle: '{PILLAR}', to: {list(TO_W)} }}"
    headers = "{ 'Content-Type': 'application/json' }"
    page.run(
        f"fetch('orders', {{ method: 'POST', headers: {headers}, body: JSON.stringify({order}) }}).then((a) => a.ok)"
    )
    page.run("document.getElementById('slice').value = 'ogf'")
    page.run("document.getElementById('slice').dispatchEvent(new Event('change'))")
    page.run("document.querySelector('[data-view=angle]').click()")
    page.run("document.getElementById('follow').click()")
    page.run("document.querySelector('[data-view=angle]').click()")
    moved = f"window.hotice.show().obstacles.find((mesh) => mesh.name === '{PILLAR}').position.y > {TO_W[1] - 0.01}"
    wait(page, f"{moved} && {SEEN}.behind === '0' && {SEEN}.mode === 'paused' && {SEEN}.time === '0'")
    page.run("document.getElementById('pause').click()")
    wait(page, f"window.hotice.page.records[0].root_pos[0] > {WALKED_M}")
    page.run("document.getElementById('pause').click()")
    wait(page, f"{SEEN}.mode === 'paused' && {SEEN}.behind === '0'")
    page.drawn()
    page.drawn()
    if page.complaints:
        raise RuntimeError(f"the page complained: {page.complaints[0]}")
    return Image.open(io.BytesIO(page.picture())).convert("RGB")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help=".webp or .png")
    asked = parser.parse_args()
    process = subprocess.Popen(COMMAND, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        told = re.search(r"http://\S+", process.stdout.readline())
        if told is None:
            raise RuntimeError("the live view did not tell its address")
        with opened(f"{told[0]}#fine", WIDTH, HEIGHT) as page:
            shot = picture(page)
    finally:
        process.terminate()
        process.wait(30)
    buffer = io.BytesIO()
    shot.save(buffer, asked.out.suffix.removeprefix(".").upper(), quality=80, method=6)
    write_bytes(asked.out, buffer.getvalue())
    print(f"{asked.out}: {len(buffer.getvalue()) / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
