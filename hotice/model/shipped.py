"""Scenes by what a user writes: shipped names and sets, files, folders and generated families."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from hotice.errors import InvalidScene, UnknownName
from hotice.files import is_file, is_folder
from hotice.model.scene import Scene

SHIPPED = Path(__file__).resolve().parent.parent / "scenes"
"""Folder of the scenes that come with hotice: single ones, and a folder for each set."""
FAMILY_PREFIX = "family:"


def shipped_scenes() -> tuple[str, ...]:
    """Names of the single scenes that come with hotice; for those of a set see `shipped_sets`."""
    return tuple(sorted(p.stem for p in SHIPPED.glob("*.json")))


def shipped_sets() -> dict[str, tuple[str, ...]]:
    """The benchmark sets that come with hotice: names of their scenes, `<set>/<scene>`, by name of the set."""
    folders = sorted(p for p in SHIPPED.iterdir() if p.is_dir())
    sets = {f.name: tuple(f"{f.name}/{p.stem}" for p in sorted(f.glob("*.json"))) for f in folders}
    return {name: scenes for name, scenes in sets.items() if scenes}


def load_scene(name_or_path: str | Path) -> Scene:
    """A shipped scene by name, or a scene file by path. Raises `UnknownName` (listing the names) or `InvalidScene`."""
    text = str(name_or_path)
    folder, _, rest = text.rpartition("/")
    if text in shipped_scenes() or text in shipped_sets().get(folder, ()):
        return Scene.load(SHIPPED / folder / f"{rest}.json")
    path = Path(text)
    if path.suffix == ".json" or len(path.parts) > 1 or is_file(path):
        return Scene.load(path)
    raise UnknownName("scene", text, (*shipped_scenes(), *shipped_sets()), "the path of a .json file")


def check_names(items: Iterable[str]) -> None:
    """Raises `UnknownName` for what is neither a shipped scene or set, nor a path or a family; reads no scene."""
    for item in items:
        path = Path(item)
        at_path = path.suffix == ".json" or len(path.parts) > 1 or is_file(path) or is_folder(path)
        if not at_path and not item.startswith(FAMILY_PREFIX) and item not in {*shipped_scenes(), *shipped_sets()}:
            raise UnknownName("scene", item, (*shipped_scenes(), *shipped_sets()), "the path of a .json file")


def load_scenes(items: Iterable[str | Path]) -> list[Scene]:
    """Scenes by name, set, file or folder (its .json files, sorted). Raises as `load_scene`, also for empty folders."""
    scenes: list[Scene] = []
    for item in items:
        names = shipped_sets().get(str(item))
        if names is not None:
            scenes += [load_scene(name) for name in names]
        elif str(item) not in shipped_scenes() and is_folder(item):
            files = sorted(Path(item).glob("*.json"))
            if not files:
                raise InvalidScene(f"{item}: the folder holds no .json scene file")
            scenes += [Scene.load(file) for file in files]
        else:
            scenes.append(load_scene(item))
    return scenes


def resolve_scenes(items: Sequence[str]) -> list[Scene]:
    """Scenes of names, files, folders, or `family:NAME:COUNT[:SEED]`. Raises `InvalidScene` or `UnknownName`."""
    return [scene for item in items for scene in resolve_item(item)]


def resolve_item(item: str) -> list[Scene]:
    """Scenes of one name, file, folder or family. Raises as `resolve_scenes`."""
    if not str(item).startswith(FAMILY_PREFIX):
        return load_scenes([item])
    from hotice.model.generate.families import family_from_text

    return family_from_text(str(item).removeprefix(FAMILY_PREFIX))
