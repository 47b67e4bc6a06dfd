"""How fast and how true are scenes made of point clouds?

    python -m benchmarks.importers [--points 1000000] [--repeats 3]

A room of known shape is scanned with noise, tilted, and written in every file format; each is imported from disk on one
core. Then surfaces of the scene are held against the room's. Exit status 1 when 1 M points take more than 5 s.
"""

from __future__ import annotations

import argparse
import os
import struct
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.progress import track
from rich.table import Table

from benchmarks.arguments import a_count
from hotice.console import PlainConsole
from hotice.model.frames import quat_from_axis_angle, quat_to_mat
from hotice.model.importers import ImportOptions, from_points, import_scene

BAR_S = 5.0
ROOM_LOW, ROOM_HIGH = np.array([-3.0, -3.0, 0.0]), np.array([5.0, 3.0, 2.5])
BLOCKS = [
    ((0.80, 0.50, 0.00), (1.20, 0.90, 0.80)),  # cabinet
    ((0.60, -0.95, 0.70), (1.40, -0.45, 0.74)),  # table top
    ((0.62, -0.93, 0.00), (0.66, -0.89, 0.70)),  # table leg
    ((1.00, -1.00, 1.20), (1.20, 1.00, 1.60)),  # beam
    ((1.50, -1.00, 0.00), (1.56, 1.00, 0.06)),  # sill
]
R_MW, SENSOR_M = quat_to_mat(quat_from_axis_angle((1.0, 0.5, 0.0), 0.05)), np.array([0.0, 0.0, -1.2])
OPTIONS = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), frame="map")


def faces(low, high, ends=((0, 1), (0, 1), (0, 1))):
    """Corner and edges of a block's faces."""
    low, high = np.array(low), np.array(high)
    for axis in range(3):
        for end in ends[axis]:
            corner, u, v = low.copy(), np.zeros(3), np.zeros(3)
            corner[axis] = (low, high)[end][axis]
            for edge, other in ((u, (axis + 1) % 3), (v, (axis + 2) % 3)):
                edge[other] = high[other] - low[other]
            yield corner, u, v


def sampled(rng: np.random.Generator, count: int, rectangles) -> np.ndarray:
    rectangles = list(rectangles)
    area = np.array([np.linalg.norm(np.cross(u, v)) for _, u, v in rectangles])
    parts = []
    for n, (corner, u, v) in zip(rng.multinomial(count, area / area.sum()), rectangles, strict=True):
        a = rng.random((n, 2))
        parts.append(corner + a[:, :1] * u + a[:, 1:] * v)
    return np.concatenate(parts)


def scan(count: int, noise_m: float, seed: int = 0) -> np.ndarray:
    """Points of the room in the map's frame: three quarters on walls, floor and ceiling, 0.5 % astray."""
    rng = np.random.default_rng(seed)
    stray = count // 200
    shell = sampled(rng, 3 * count // 4, faces(ROOM_LOW, ROOM_HIGH))
    things = sampled(rng, count - len(shell) - stray, [f for block in BLOCKS for f in faces(*block)])
    points = np.concatenate([shell, things]) + rng.normal(0.0, noise_m, (count - stray, 3))
    points = np.concatenate([points, rng.uniform(ROOM_LOW, ROOM_HIGH, (stray, 3))])
    return rng.permutation(points) @ R_MW.T + SENSOR_M


def lzf_literals(data: bytes) -> bytes:
    """LZF without repeats: as slow to read as it gets."""
    whole = np.frombuffer(data[: len(data) // 32 * 32], dtype=np.uint8).reshape(-1, 32)
    packed = np.column_stack([np.full(len(whole), 31, dtype=np.uint8), whole]).tobytes()
    rest = data[len(whole) * 32 :]
    return packed + (bytes([len(rest) - 1]) + rest if rest else b"")


def write_files(folder: Path, points: np.ndarray) -> list[Path]:
    count, rows = len(points), points.astype("<f4")
    fields = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    header = f"{fields}WIDTH {count}\nHEIGHT 1\nPOINTS {count}\nDATA "
    columns = np.ascontiguousarray(rows.T).tobytes()
    packed = lzf_literals(columns)
    text = "\n".join(f"{x:.5f} {y:.5f} {z:.5f}" for x, y, z in points.tolist()).encode() + b"\n"
    ply = "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{}end_header\n".format(
        count, "".join(f"property float {axis}\n" for axis in "xyz")
    )
    contents = {
        "binary.pcd": f"{header}binary\n".encode() + rows.tobytes(),
        "compressed.pcd": f"{header}binary_compressed\n".encode()
        + struct.pack("<II", len(packed), len(columns))
        + packed,
        "ascii.pcd": f"{header}ascii\n".encode() + text,
        "binary.ply": ply.encode() + rows.tobytes(),
    }
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    return [folder / name for name in contents]


def time_formats(count: int, repeats: int) -> tuple[Table, bool]:
    table = Table("file", "size [MB]", "best of [s]", "boxes", title=f"{count:,} points to a scene, one core")
    slow = False
    with tempfile.TemporaryDirectory() as name:
        files = write_files(Path(name), scan(count, 0.01))
        import_scene(files[0], OPTIONS)  # compiles
        seconds = {file: [] for file in files}
        for file in track(files * repeats, "importing", transient=True):
            begin = time.perf_counter()
            imported = import_scene(file, OPTIONS)
            seconds[file].append(time.perf_counter() - begin)
        for file, times in seconds.items():
            slow |= min(times) * 1e6 / count > BAR_S
            size, boxes = f"{file.stat().st_size / 1e6:.0f}", str(len(imported.scene.obstacles))
            table.add_row(file.name, size, f"{min(times):.2f}", boxes)
    return table, slow


def measure_surfaces() -> Table:
    """Signed distance of the scene on the room's true surfaces: 0 is perfect, negative is caution."""
    heads = ("points", "noise [mm]", "boxes", "mean [mm]", "5 % [mm]", "95 % [mm]", "farthest out [mm]")
    table = Table(*heads, title="scene's distance on true surfaces, 40 mm voxels (negative: obstacles are too large)")
    rng = np.random.default_rng(1)
    truth = sampled(rng, 20_000, [f for block in BLOCKS for f in faces(*block)])
    truth = truth[(truth[:, 2] > 0.05) & (truth[:, 2] < 1.45) & (np.abs(truth[:, 1]) < 0.9)]
    for count in (100_000, 1_000_000):
        for noise_m in (0.003, 0.01, 0.02):
            imported = from_points(scan(count, noise_m), OPTIONS, "room")
            d = 1000.0 * imported.scene.signed_distance(imported.floor.to_world(truth @ R_MW.T + SENSOR_M))
            low, high = np.quantile(d, [0.05, 0.95])
            figures = [
                f"{v:.0f}" for v in (1000 * noise_m, len(imported.scene.obstacles), d.mean(), low, high, d.max())
            ]
            table.add_row(f"{count:,}", *figures)
    return table


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=a_count, default=1_000_000)
    parser.add_argument("--repeats", type=a_count, default=3)
    arguments = parser.parse_args()
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])
    console = PlainConsole()
    table, slow = time_formats(arguments.points, arguments.repeats)
    console.print(table)
    console.print(measure_surfaces())
    console.print(f"{'too slow' if slow else 'within the bar'}: {BAR_S:g} s for 1,000,000 points", style="bold")
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
