"""Scenes: import them from maps, look at them, check them, list and generate them."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hotice.errors import HoticeError, InvalidConfig
from hotice.files import check_writable, is_folder
from hotice.model.importers.options import Front3dConfig
from hotice.progress import counted, doing

if TYPE_CHECKING:
    from hotice.commands.line.scene_config import CheckConfig, GenerateConfig, ImportConfig, ScanConfig, ShowConfig
    from hotice.model import Scene


def import_map(config: ImportConfig) -> int:
    """Make a scene of a point cloud or mesh."""
    from hotice.console import PlainConsole
    from hotice.model.importers.scene_import import import_scene
    from hotice.replay.import_picture import write_import_picture

    picture = config.out.with_suffix(".png")
    check_writable(config.out)
    check_writable(picture)
    console = PlainConsole()
    with doing(f"importing {config.map}"):
        imported = import_scene(config.map, config)
        imported.scene.save(config.out)
        write_import_picture(imported, picture)
    for name, text in imported.notes.items():
        console.print(f"{name:>10}: {text}", soft_wrap=True)
    for name, path in (("scene", config.out), ("picture", picture)):
        console.print(f"{name:>10}: {path}", soft_wrap=True)
    return 0


def import_front3d(config: Front3dConfig) -> int:
    """Crop scenes from a house of the 3D-FRONT data set."""
    from hotice.model.importers import house_scenes

    return house_scenes.import_front3d(config)


def scan_scene(config: ScanConfig) -> int:
    """Map a scene as a robot's upside-down lidar would: a point cloud to import, as FAST-LIO saves it."""
    from hotice.deploy.simulated.lidar_map import pcd_of, scan
    from hotice.files import write_bytes
    from hotice.model.moving.still import only_still
    from hotice.model.shipped import load_scene

    check_writable(config.out)
    with doing(f"mapping {config.scene}"):
        points = scan(only_still(load_scene(config.scene), "a map"), config)
    write_bytes(config.out, pcd_of(points))
    print(f"{len(points):,} points in {config.out}")
    return 0


def show(config: ShowConfig) -> int:
    """Open scenes in meshcat."""
    from hotice.files import write_text
    from hotice.replay.scene_view import page_server, scene_page

    if config.html is not None:
        check_writable(config.html)
    page = scene_page(_resolve(config.scenes), robot=config.robot, arrows=config.arrows)
    if config.html is not None:
        print(write_text(config.html, page))
        return 0
    with page_server(page, config.port) as server, contextlib.suppress(KeyboardInterrupt):
        print(f"http://127.0.0.1:{server.server_port}/ (Ctrl-C ends)", flush=True)
        server.serve_forever()
    return 0


def check(config: CheckConfig) -> int:
    """Say which scenes are valid, reachable and traversable; status 1 when one is not."""
    from rich.table import Table

    from hotice.console import PlainConsole

    if not config.scenes:
        raise InvalidConfig("no scene is given: see `hotice scene list`")
    table = Table(
        "scene",
        "obstacles",
        "path [m]",
        "clearance [m]",
        "verdict",
        title="g ground, s side, o overhead; m of them move",
    )
    console, bad = PlainConsole(), 0
    for item, scene in counted(found := list(_each(config.scenes)), "scenes", len(found)):
        row, ok = _verdict(scene) if not isinstance(scene, HoticeError) else (["", "", "", str(scene)], False)
        table.add_row(item if isinstance(scene, HoticeError) else scene.name, *row, style=None if ok else "red")
        bad += not ok
    console.print(table)
    return 1 if bad else 0


def list_scenes() -> int:
    """List the scenes, sets and families that hotice brings along."""
    from rich.text import Text

    from hotice.console import PlainConsole
    from hotice.model.generate.families import FAMILIES
    from hotice.model.shipped import FAMILY_PREFIX, shipped_scenes, shipped_sets

    console = PlainConsole()

    def line(kind: str, names: str) -> None:
        console.print(Text(kind, style="bold") + Text(f"  {names}"))

    line("scenes", ", ".join(shipped_scenes()))
    sets = [f"{name} ({len(scenes)}: {scenes[0]} .. {scenes[-1]})" for name, scenes in shipped_sets().items()]
    line("sets", ", ".join(sets))
    meaning = f"{FAMILY_PREFIX}NAME:COUNT or {FAMILY_PREFIX}NAME:COUNT:SEED, NAME being one of "
    line("families", meaning + ", ".join(FAMILIES))
    return 0


def generate(config: GenerateConfig) -> int:
    """Write generated scenes as files and report the rejected draws."""
    from hotice.console import PlainConsole
    from hotice.model.generate.families import generate_from_text
    from hotice.model.scene import save_all
    from hotice.model.shipped import FAMILY_PREFIX

    if not config.families:
        raise InvalidConfig(f"no family is given: {FAMILY_PREFIX}NAME:COUNT or ...:SEED, see `hotice scene list`")
    wrong = [item for item in config.families if not item.startswith(FAMILY_PREFIX)]
    if wrong:
        raise InvalidConfig(f"{wrong[0]!r} is no family: {FAMILY_PREFIX}NAME:COUNT or ...:SEED is needed")
    console = PlainConsole()
    with doing("generating"):
        made = [generate_from_text(item.removeprefix(FAMILY_PREFIX)) for item in config.families]
    scenes = [scene for part in made for scene in part.scenes]
    twice = [name for name, count in Counter(s.name for s in scenes).items() if count > 1]
    if twice:
        raise InvalidConfig(f"two scenes are named {twice[0]!r}: write them to different folders")
    save_all(scenes, config.out)
    rejected = [r for part in made for r in part.rejected]
    for r in rejected:
        console.print(f"rejected {r.scene}, draw {r.draw}: {r.reason}", soft_wrap=True)
    console.print(f"{len(scenes)} scenes in {config.out}, {len(rejected)} draws rejected", soft_wrap=True)
    return 0


COMMANDS = {
    "import": import_map,
    "import-front3d": import_front3d,
    "scan": scan_scene,
    "show": show,
    "check": check,
    "list": list_scenes,
    "generate": generate,
}


def _resolve(items: Sequence[str]) -> list[Scene]:
    from hotice.model.shipped import resolve_scenes

    if not items:
        raise InvalidConfig("no scene is given: see `hotice scene list`")
    return resolve_scenes(items)


def _each(items: Sequence[str]):
    """(item, scene) of all items, or (item, error) where one cannot be had; files of a folder one by one."""
    for item in items:
        files = sorted(Path(item).glob("*.json")) if is_folder(item) else []
        for part in map(str, files) if files else [item]:
            try:
                yield from ((part, scene) for scene in _resolve([part]))
            except HoticeError as error:
                yield part, error


def _verdict(scene: Scene) -> tuple[list[str], bool]:
    """Columns after the name, and whether all is well; way and clearance are those among what stands still."""
    import numpy as np

    from hotice.errors import UnreachableGoal
    from hotice.fields import build_hod_pf
    from hotice.fields.reachability import check_reachable
    from hotice.model.generate.passing import check_passing
    from hotice.model.generate.traversable import check_traversable
    from hotice.model.scene import GOAL_HEIGHT_M

    counts = Counter(o.category[0] for o in scene.obstacles)
    counts["m"] = len(scene.moving)
    obstacles = " ".join(f"{counts[kind]}{kind}" for kind in "gsom" if counts[kind]) or "none"
    whole, scene = scene, scene.still()
    try:
        check_reachable(scene)
    except UnreachableGoal as error:
        return [obstacles, "", "", str(error)], False
    pelvis = np.array([*scene.start[:2], GOAL_HEIGHT_M])
    length = float(build_hod_pf(scene).sgf.extended_geodesic_distance(pelvis))
    traversal = check_traversable(scene)
    ok, verdict = traversal.ok, "ok" if traversal.ok else traversal.reason
    if ok and whole.moving:
        passing = check_passing(whole)
        ok, verdict = passing.ok, f"ok, there in {passing.arrival_s:.1f} s" if passing.ok else passing.reason
    return [obstacles, f"{length:.2f}", f"{traversal.clearance_m:.2f}", verdict], ok
