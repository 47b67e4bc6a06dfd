"""Places of systems and ways of wires in the drawing of a diagram: pure geometry, in units of the drawing.

Systems stand in columns and rows. A wire to the next system of its row is straight. Every other one leaves its box
upwards or downwards and runs in a lane of the channel between two rows, so that no wire lies behind a box.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

Place = tuple[int, int]
Point = tuple[float, float]

WIDTH, HEIGHT = 1.66, 0.66
"""Of a box."""
DX = 3.6
"""From one column to the next."""
LANE, FIRST = 0.34, 0.36
"""From one lane to the next, and from a row to the first lane of a channel."""
BESIDE, APART = 0.14, 0.06
"""Between wires that change channels in one gap, and of ends at the bottom of boxes from those at the top."""
EMPTY = 0.5
"""Height of a channel without a wire."""
LETTER = 0.085
"""Width of a letter of a label."""


@dataclass(kw_only=True)
class Wire:
    """A way from system `source` to `target`: corners, and where its label is centred."""

    source: str
    target: str
    label: str
    points: list[Point] = field(default_factory=list)
    at: Point = (0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """Centres of boxes, and wires."""

    boxes: dict[str, Point]
    wires: list[Wire]


@dataclass(kw_only=True)
class _Run:
    """The part of a wire in one channel, from x to x."""

    wire: Wire
    channel: int
    left: float
    right: float
    lane: int = 0


def route(place: Mapping[str, Place], labels: Mapping[tuple[str, str], str]) -> Drawing:
    """Draws systems at columns and rows `place`, and between them wires with `labels`."""
    rows = 1 + max(row for _, row in place.values())
    plans = {(s, t): _plan(place[s], place[t]) for s, t in labels}
    ports, gaps = _ports(place, plans), _gaps(place, plans)
    runs: dict[tuple[str, str], list[_Run]] = {}
    wires = []
    for (source, target), label in labels.items():
        wire = Wire(source=source, target=target, label=label)
        wires.append(wire)
        plan = plans[source, target]
        runs[source, target] = []
        if not plan:
            continue
        stops = [ports[source, target, "out"], *gaps[source, target], ports[source, target, "in"]]
        runs[source, target] = [
            _Run(wire=wire, channel=channel, left=min(a, b), right=max(a, b))
            for channel, a, b in zip(plan, stops, stops[1:], strict=False)
        ]
    lanes = [
        _lanes([r for row in runs.values() for r in row if r.channel == k], last=k == rows) for k in range(rows + 1)
    ]
    y_row, y_channel = [], []
    y = 0.0
    for k in range(rows + 1):
        y_channel.append(y)
        y -= max(EMPTY, 2 * FIRST + LANE * (lanes[k] - 1)) if lanes[k] else EMPTY
        y_row.append(y - 0.5 * HEIGHT)
        y -= HEIGHT
    boxes = {name: (DX * column, y_row[row]) for name, (column, row) in place.items()}
    for wire in wires:
        own = runs[wire.source, wire.target]
        a, b = boxes[wire.source], boxes[wire.target]
        if not own:
            wire.points = [(a[0] + 0.5 * WIDTH, a[1]), (b[0] - 0.5 * WIDTH, b[1])]
            wire.at = (0.5 * (a[0] + b[0]), a[1])
            continue
        x_out, x_in = ports[wire.source, wire.target, "out"], ports[wire.source, wire.target, "in"]
        heights = [y_channel[run.channel] - FIRST - LANE * run.lane for run in own]
        up_out, up_in = own[0].channel == place[wire.source][1], own[-1].channel == place[wire.target][1]
        stops = [x_out, *gaps[wire.source, wire.target], x_in]
        points = [(x_out, a[1] + (0.5 if up_out else -0.5) * HEIGHT)]
        for height, left, right in zip(heights, stops, stops[1:], strict=False):
            points += [(left, height), (right, height)]
        wire.points = [*points, (x_in, b[1] + (0.5 if up_in else -0.5) * HEIGHT)]
        longest = max(range(len(own)), key=lambda i: own[i].right - own[i].left)
        wire.at = (0.5 * (own[longest].left + own[longest].right), heights[longest])
    return Drawing(boxes=boxes, wires=wires)


def _plan(source: Place, target: Place) -> list[int]:
    """Channels that a wire runs in, none for a straight one; channel k lies above row k."""
    (column, row), (to_column, to_row) = source, target
    if row == to_row:
        if to_column == column + 1:
            return []
        # ahead above the row, back below it
        return [row] if to_column > column else [row + 1]
    if row < to_row:
        return list(range(row + 1, to_row + 1))
    return list(range(row, to_row, -1))


def _gaps(
    place: Mapping[str, Place], plans: Mapping[tuple[str, str], Sequence[int]]
) -> dict[tuple[str, str], list[float]]:
    """Where wires of several channels change from one to the next: side by side, beside the column they lead to."""
    found, used = {}, Counter[float]()
    for (source, target), plan in plans.items():
        found[source, target] = []
        if len(plan) > 1:
            side = 0.5 if place[target][0] > place[source][0] else -0.5
            gap = DX * (place[target][0] - side)
            found[source, target] = [gap + BESIDE * used[gap]] * (len(plan) - 1)
            used[gap] += 1
    return found


def _ports(
    place: Mapping[str, Place], plans: Mapping[tuple[str, str], Sequence[int]]
) -> dict[tuple[str, str, str], float]:
    """Where along the top or bottom of its box a wire begins and ends: in the order in which they lead away."""
    sides: dict[tuple[str, bool], list[tuple[float, int, tuple[str, str, str]]]] = {}
    for number, ((source, target), plan) in enumerate(plans.items()):
        if not plan:
            continue
        far = DX * (place[target][0] - place[source][0])
        out, into = (source, plan[0] == place[source][1]), (target, plan[-1] == place[target][1])
        sides.setdefault(out, []).append((far, number, (source, target, "out")))
        sides.setdefault(into, []).append((-far, number, (source, target, "in")))
    found = {}
    for (name, above), ends in sides.items():
        # to the left first; of those to the right the nearest is outermost, so that short ways lie under long ones
        left = sorted((e for e in ends if e[0] <= 0), key=lambda e: (-e[0], e[1]))
        right = sorted((e for e in ends if e[0] > 0), key=lambda e: (-e[0], e[1]))
        order = [*left, *right]
        for i, (_, _, key) in enumerate(order):
            # wires from below one box and from above another of the same column are not to lie on each other
            x = DX * place[name][0] + (0.0 if above else APART)
            found[key] = x + WIDTH * ((i + 1) / (len(order) + 1) - 0.5)
    return found


def _lanes(runs: list[_Run], last: bool) -> int:
    """Gives each run a lane in which nothing else lies, and tells how many there are.

    The shortest is next to the row below; in the last channel, which has none, next to the row above.
    """
    taken: list[list[tuple[float, float]]] = []
    for run in sorted(runs, key=lambda r: r.right - r.left):
        # room for the label where the run is shorter
        middle, half = 0.5 * (run.left + run.right), 0.5 * max(run.right - run.left, LETTER * len(run.wire.label))
        span = middle - half - 0.1, middle + half + 0.1
        for lane, spans in enumerate(taken):
            if all(span[1] < low or high < span[0] for low, high in spans):
                run.lane = lane
                spans.append(span)
                break
        else:
            run.lane = len(taken)
            taken.append([span])
    for run in runs:
        run.lane = run.lane if last else len(taken) - 1 - run.lane
    return len(taken)
