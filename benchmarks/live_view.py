"""Time from the hand to what is seen in the live view: an obstacle is dragged in Chromium.

    python -m benchmarks.live_view [--drags 20] [--scene pillars]

While time stands still for the robot at the start, the second obstacle of the scene is dragged by 0.3 m, to and fro.
From the first movement of the pressed mouse, by the page's own clock: until the page shows a newer field, and until
it shows another way; from the last movement until the obstacle has come and the fields show all. Needs Chromium.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import time

import numpy as np
from rich.table import Table

from benchmarks.arguments import a_count
from hotice.console import PlainConsole
from tools.browser import Page, opened

PATIENCE_S = 60.0
FAR_M = 0.3
AIM_S = 0.5
WATCH = """(() => {
  const m = window.measured = { began: null };
  const moved = (e) => { if (e.buttons) { m.began ??= performance.now(); m.last = performance.now(); } };
  document.getElementById('view').addEventListener('pointermove', moved, true);
  window.hotice.listen((now) => {
    const ways = JSON.stringify(now.ways);
    if (m.began !== null) {
      const since = (performance.now() - m.began) / 1000;
      if (now.version > m.version) m.field ??= since;
      if (ways !== m.ways) m.way ??= since;
      const y = window.hotice.show().obstacles[1].position.y;
      if (now.behind === 0 && Math.abs(y - m.to) < 0.02) m.all ??= (performance.now() - m.last) / 1000;
    }
    m.now = { version: now.version, ways };
  });
})()"""
READY = "measured.now !== undefined && document.getElementById('view').dataset.behind === '0'"
AGAIN = "void Object.assign(measured, measured.now, { began: null, field: null, way: null, all: null })"


def wait(page: Page, condition: str) -> None:
    """Until a condition of the page holds. Raises `TimeoutError`."""
    end = time.monotonic() + PATIENCE_S
    while not page.run(condition):
        if time.monotonic() > end:
            raise TimeoutError(f"never true: {condition}")
        time.sleep(0.05)


def drags(page: Page, count: int) -> np.ndarray:
    """Times (count, 3) [s]: until a newer field, until another way, until all."""
    wait(page, "document.getElementById('view').dataset.version !== undefined")
    page.run("document.getElementById('pause').click(); document.getElementById('restart').click()")
    wait(page, "document.getElementById('view').dataset.time === '0'")
    # the camera stays where it is
    page.run("document.getElementById('follow').click(); document.querySelector('[data-view=top]').click()")
    page.run(WATCH)
    rows, way = [], FAR_M
    for _ in range(count):
        wait(page, READY)
        page.run(AGAIN)
        ends = page.run(
            f"""(() => {{
              const mesh = window.hotice.show().obstacles[1];
              const p = mesh.position.clone();
              mesh.geometry.computeBoundingBox();
              p.z += mesh.geometry.boundingBox.max.z;
              window.measured.to = p.y + {way};
              return [0, {way}].map((y) => {{
                const q = p.clone().setY(p.y + y).project(window.hotice.camera);
                return [(q.x + 1) / 2 * innerWidth, (1 - q.y) / 2 * innerHeight];
              }});
            }})()"""
        )
        page.drag(*ends)
        wait(page, "window.measured.all !== null && window.measured.way !== null")
        rows.append(json.loads(page.run("JSON.stringify([measured.field, measured.way, measured.all])")))
        way = -way
    return np.array(rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drags", type=a_count, default=20, help="how often the obstacle is dragged")
    parser.add_argument("--scene", default="pillars", help="with two obstacles at least")
    asked = parser.parse_args()
    command = [sys.executable, "-m", "hotice", "play", "--view", "--scene", asked.scene, "--no-perturbed"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        told = re.search(r"http://\S+", process.stdout.readline())
        if told is None:
            return 2
        with opened(told[0]) as page:
            times = drags(page, asked.drags)
    finally:
        process.terminate()
        process.wait(30)
    table = Table("from the hand to", "median [s]", "longest [s]", f"within {AIM_S:g} s", title=asked.scene)
    for name, column in zip(
        ("a newer field", "another way", "all shown, from the last movement"), times.T, strict=True
    ):
        within = f"{int((column <= AIM_S).sum())} of {len(column)}"
        table.add_row(name, f"{np.median(column):.2f}", f"{column.max():.2f}", within)
    PlainConsole().print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
