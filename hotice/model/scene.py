"""Scenes: bounds, start, goal and obstacles, and the file format hotice-scene/1.

World frame W: z up, floor at z = 0. The floor is not an obstacle. A scene that exists is valid: the constructor checks
everything that the file reader checks, each failure being one line of `InvalidScene`. An optional `source` says which
map the scene was cut from, and where that map lies in W; files without it stay as they are.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice import checks
from hotice.checks import shown
from hotice.documents import read_json
from hotice.errors import InvalidScene, OutputError
from hotice.files import check_folder, make_folder, output_file, write_bytes
from hotice.model.frames import quat_from_yaw, quat_mul, quat_to_mat, rotation_z
from hotice.model.geometry.lengths import COORDINATE
from hotice.model.geometry.shapes import MeshShape, Shape, shape_from_dict
from hotice.model.moving.motion import Motion
from hotice.model.source import MapSource

FORMAT = "hotice-scene/1"
CATEGORIES = ("ground", "side", "overhead")
GOAL_HEIGHT_M = 0.75
"""Pelvis height, at which the field's goal is taken."""
MAX_GRID_NODES = 50_000_000
MAX_FILE_BYTES = 16 * 2**20
MAX_OBSTACLES = 5000
MAX_MOVING = 32
"""Most obstacles with a motion."""
COLUMN_HEIGHTS_M = (*(0.1 * i for i in range(1, 13)), GOAL_HEIGHT_M)
"""Heights at which start and goal must be clear of obstacles."""

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]


@dataclass(frozen=True)
class Obstacle:
    """A shape at pose X_WB. `category`: ground, side or overhead.

    With a `motion` it moves, and the pose is the one at the first way point; a mesh cannot. Raises `InvalidScene`.
    """

    name: str
    category: str
    shape: Shape
    position_m: Vec3
    quaternion_wxyz: Quat = (1.0, 0.0, 0.0, 0.0)
    motion: Motion | None = None

    def __post_init__(self) -> None:
        _check_name("obstacle", self.name)
        where = f"obstacle {self.name!r}"
        checks.one_of(f"{where} category", self.category, CATEGORIES, InvalidScene)
        if not isinstance(self.shape, Shape):
            raise InvalidScene(
                f"{where} has shape {shown(self.shape)}: a shape of hotice.model.geometry.shapes is needed"
            )
        object.__setattr__(self, "position_m", _coordinates(f"{where} position_m", self.position_m, 3))
        quat = checks.unit_quaternion(f"{where} quaternion_wxyz", self.quaternion_wxyz, InvalidScene)
        object.__setattr__(self, "quaternion_wxyz", quat)
        if self.motion is not None and not isinstance(self.motion, Motion):
            raise InvalidScene(
                f"{where} has motion {shown(self.motion)}: a hotice.model.moving.motion.Motion is needed"
            )
        if self.motion is not None and isinstance(self.shape, MeshShape):
            raise InvalidScene(f"{where} is a mesh: only box, cylinder, capsule and sphere may have a motion")

    def at(self, time_s: float) -> Obstacle:
        """The obstacle where it is at `time_s` [s], without its motion; itself where it has none."""
        if self.motion is None:
            return self
        start, first = self.motion.way_points[0], np.array(self.motion.way_points[0].position_m)
        origin, yaw = self.motion.at(time_s)
        arm, turn = np.array(self.position_m) - first, float(yaw) - start.yaw_rad
        position = self.position_m + (origin - first) + (rotation_z(turn) @ arm - arm)
        quat = quat_mul(quat_from_yaw(turn), self.quaternion_wxyz)
        return replace(self, position_m=tuple(position.tolist()), quaternion_wxyz=tuple(quat.tolist()), motion=None)

    def velocity_at(self, time_s: float) -> Velocity:
        """How the obstacle moves at `time_s` [s]; zero where it has no motion."""
        if self.motion is None:
            return Velocity(name=self.name, v_W=(0.0, 0.0, 0.0), yaw_rate_rad_s=0.0)
        v_W, rate = self.motion.rate_at(time_s)
        arm = np.array(self.at(time_s).position_m) - self.motion.at(time_s)[0]
        v_W = v_W + float(rate) * np.array([-arm[1], arm[0], 0.0])
        return Velocity(name=self.name, v_W=cast(Vec3, tuple(v_W.tolist())), yaw_rate_rad_s=float(rate))

    def signed_distance(self, p_W: ArrayLike) -> NDArray[np.float64]:
        """Exact, (..., 3) in W [m] -> (...) [m], negative inside."""
        R_WB = quat_to_mat(self.quaternion_wxyz)
        return self.shape.signed_distance((np.asarray(p_W, dtype=np.float64) - self.position_m) @ R_WB)

    def bounding_ball(self) -> tuple[NDArray[np.float64], float]:
        """Centre (3,) in W and radius [m] of a ball that holds the obstacle."""
        centre, radius = self.shape.bounding_ball()
        return self.position_m + quat_to_mat(self.quaternion_wxyz) @ centre, radius

    def to_dict(self) -> dict[str, Any]:
        """The obstacle's entry in a scene file."""
        return {
            "name": self.name,
            "category": self.category,
            "shape": self.shape.to_dict(),
            "position_m": list(self.position_m),
            "quaternion_wxyz": list(self.quaternion_wxyz),
        } | ({"motion": self.motion.to_dict()} if self.motion else {})


@dataclass(frozen=True, kw_only=True)
class Velocity:
    """How a named obstacle moves: velocity of its position in W [m/s], and turning rate about z [rad/s]."""

    name: str
    v_W: Vec3
    yaw_rate_rad_s: float

    @property
    def fastest(self) -> float:
        """The larger of speed [m/s] and turning rate [rad/s]."""
        return max(float(np.linalg.norm(self.v_W)), abs(self.yaw_rate_rad_s))


@dataclass(frozen=True)
class Scene:
    """A place to carry an object through.

    Obstacles may move: distances are those of the first moment, `at` gives another, `still` what never moves.
    `bounds_m`: lowest and highest corner in W; `start`: x, y [m], yaw [rad] of the pelvis; `goal`: x, y [m];
    `source`: the map it was cut from, if any.
    Raises `InvalidScene`, see the module.
    """

    name: str
    bounds_m: tuple[Vec3, Vec3] = ((-0.5, -1.0, 0.0), (2.5, 1.0, 1.5))
    start: Vec3 = (0.0, 0.0, 0.0)
    goal: tuple[float, float] = (2.0, 0.0)
    obstacles: tuple[Obstacle, ...] = ()
    source: MapSource | None = None

    ENDS_CLEAR: ClassVar[bool] = True
    """Whether obstacles over start or goal are an error."""

    def __post_init__(self) -> None:
        _check_name("scene", self.name)
        if not isinstance(self.bounds_m, list | tuple | np.ndarray) or len(self.bounds_m) != 2:
            raise InvalidScene(
                f"bounds_m is {shown(self.bounds_m)}: lowest and highest corner, each x, y, z, are needed"
            )
        low, high = (_coordinates(f"bounds_m[{i}]", b, 3) for i, b in enumerate(self.bounds_m))
        object.__setattr__(self, "bounds_m", (low, high))
        object.__setattr__(self, "start", _coordinates("start", self.start, 3))
        object.__setattr__(self, "goal", _coordinates("goal", self.goal, 2))
        if not isinstance(self.obstacles, Iterable):
            raise InvalidScene(f"obstacles is {shown(self.obstacles)}: a list of obstacles is needed")
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        if self.source is not None and not isinstance(self.source, MapSource):
            raise InvalidScene(f"source is {shown(self.source)}: a hotice.model.source.MapSource is needed")
        _check_bounds(low, high)
        _check_names(self.obstacles)
        _check_inside(self)
        if self.ENDS_CLEAR:
            _check_clear(self)

    @property
    def goal_W(self) -> NDArray[np.float64]:
        """The field's goal, (3,) in W [m], at pelvis height."""
        return np.array([*self.goal, GOAL_HEIGHT_M])

    @property
    def moving(self) -> tuple[Obstacle, ...]:
        """Obstacles with a motion."""
        return tuple(o for o in self.obstacles if o.motion is not None)

    def still(self) -> Scene:
        """The scene without what moves; itself where nothing does."""
        if not self.moving:
            return self
        return replace(self, obstacles=tuple(o for o in self.obstacles if o.motion is None))

    def at(self, time_s: float) -> MomentaryScene:
        """The scene at `time_s` [s] since the start of an episode, with velocities of what moves then."""
        checks.number("time_s", time_s, error=InvalidScene)
        velocities = tuple(o.velocity_at(time_s) for o in self.moving)
        return MomentaryScene.of(self, (o.at(time_s) for o in self.obstacles), velocities)

    def signed_distance(self, p_W: ArrayLike) -> NDArray[np.float64]:
        """Exact distance to the nearest obstacle, (..., 3) in W [m] -> (...) [m]; inf without obstacles."""
        p_W = np.asarray(p_W, dtype=np.float64)
        flat = p_W.reshape(-1, 3)
        result = np.full(len(flat), np.inf)
        for obstacle in self.obstacles:
            centre, radius = obstacle.bounding_ball()
            near = np.flatnonzero(((flat - centre) ** 2).sum(axis=-1) < (result.clip(0.0) + radius) ** 2)
            if len(near):
                result[near] = np.minimum(result[near], obstacle.signed_distance(flat[near]))
        return result.reshape(p_W.shape[:-1])

    def to_dict(self) -> dict[str, Any]:
        """The content of a scene file."""
        return {
            "format": FORMAT,
            "name": self.name,
            "bounds_m": [list(b) for b in self.bounds_m],
            "start": {"position_m": list(self.start[:2]), "yaw_rad": self.start[2]},
            "goal": {"position_m": list(self.goal)},
            "obstacles": [o.to_dict() for o in self.obstacles],
        } | ({"source": self.source.to_dict()} if self.source else {})

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], folder: str | Path | None = None) -> Scene:
        """Inverse of `to_dict`; mesh files are looked up in `folder`. Raises `InvalidScene`."""
        if isinstance(data, Mapping) and data.get("format") != FORMAT:
            raise InvalidScene(f"scene format is {shown(data.get('format'))}: known is {FORMAT!r}")
        required = ("format", "name", "bounds_m", "start", "goal", "obstacles")
        checks.mapping("scene", data, required, ("source",), InvalidScene)
        checks.mapping("start", data["start"], ("position_m",), ("yaw_rad",), InvalidScene)
        checks.mapping("goal", data["goal"], ("position_m",), error=InvalidScene)
        if not isinstance(data["obstacles"], list | tuple):
            raise InvalidScene(f"obstacles is {shown(data['obstacles'])}: a list is needed")
        yaw = checks.number("start yaw_rad", data["start"].get("yaw_rad", 0.0), COORDINATE, InvalidScene)
        start = (*_coordinates("start position_m", data["start"]["position_m"], 2), yaw)
        goal = _coordinates("goal position_m", data["goal"]["position_m"], 2)
        base = None if folder is None else Path(folder)
        obstacles = tuple(_obstacle_from_dict(i, entry, base) for i, entry in enumerate(data["obstacles"]))
        source = MapSource.from_dict(data["source"]) if "source" in data else None
        return cls(
            data["name"], data["bounds_m"], cast(Vec3, start), cast(tuple[float, float], goal), obstacles, source
        )

    @classmethod
    def load(cls, path: str | Path) -> Scene:
        """Reads a scene file. Raises `InvalidScene` naming the file and what is wrong with it."""
        path = Path(path)
        data = read_json(path, MAX_FILE_BYTES, InvalidScene, finite=True)
        try:
            return cls.from_dict(data, folder=path.parent)
        except InvalidScene as error:
            raise InvalidScene(f"{path}: {error}") from None

    def save(self, path: str | Path) -> None:
        """Writes a scene file, whole or not at all; mesh files are copied beside it when the folder is another.

        Raises `InvalidScene` when the folder is missing or not writable, or would hold another mesh of that name.
        """
        path = Path(path)
        text = json.dumps(self.to_dict(), indent=1) + "\n"
        written: list[Path] = []
        try:
            try:
                for shape in sorted({o.shape for o in self.obstacles if isinstance(o.shape, MeshShape)}, key=str):
                    written += _copy_mesh(shape, path.parent)
                write_bytes(path, text.encode())
            except BaseException:
                for mesh in written:
                    mesh.unlink(missing_ok=True)
                raise
        except OutputError as error:
            raise InvalidScene(str(error)) from None
        except OSError as error:
            raise InvalidScene(f"cannot write {path}: {error.strerror or error}") from None

    def renamed(self, name: str) -> Scene:
        """The same scene under another name."""
        return replace(self, name=name)


def save_all(scenes: Sequence[Scene], folder: Path) -> None:
    """Writes scenes as files `NAME.json` of a folder, which is made where it is missing; no scenes make none.

    Raises `OutputError` before the first is written where one of the files cannot be.
    """
    if not scenes:
        return
    check_folder(folder)
    files = [folder / f"{scene.name}.json" for scene in scenes]
    for file in files:
        output_file(file)
    make_folder(folder)
    for scene, file in zip(scenes, files, strict=True):
        scene.save(file)


def _check_name(kind: str, name: object) -> None:
    if not isinstance(name, str) or not name.strip() or len(name) > 200 or not name.isprintable():
        raise InvalidScene(f"{kind} name is {shown(name)}: 1 to 200 printable characters are needed")


def _check_bounds(low: tuple[float, ...], high: tuple[float, ...]) -> None:
    extent = np.subtract(high, low)
    if (extent < 0.2).any():
        raise InvalidScene(f"bounds_m {low} .. {high}: each of x, y, z must grow by at least 0.2 m")
    if extent.prod() / 0.04**3 > MAX_GRID_NODES:
        raise InvalidScene(
            f"bounds_m {low} .. {high} need more than {MAX_GRID_NODES:,} grid nodes of 0.04 m: make them smaller"
        )
    if not low[2] < GOAL_HEIGHT_M < high[2]:
        raise InvalidScene(f"bounds_m z {low[2]:g} .. {high[2]:g} must hold the pelvis height {GOAL_HEIGHT_M} m")


def _check_names(obstacles: tuple[Obstacle, ...]) -> None:
    if len(obstacles) > MAX_OBSTACLES:
        raise InvalidScene(f"{len(obstacles):,} obstacles, at most {MAX_OBSTACLES:,} are allowed: join some or crop")
    seen: set[str] = set()
    for obstacle in obstacles:
        if not isinstance(obstacle, Obstacle):
            raise InvalidScene(f"obstacles holds {shown(obstacle)}: an Obstacle is needed")
        if obstacle.name in seen:
            raise InvalidScene(f"obstacle name {obstacle.name!r} occurs twice: names must differ")
        seen.add(obstacle.name)
    if (moving := sum(o.motion is not None for o in obstacles)) > MAX_MOVING:
        raise InvalidScene(f"{moving} obstacles have a motion: at most {MAX_MOVING} may move")


@dataclass(frozen=True)
class MomentaryScene(Scene):
    """A scene at one instant of a world that moves: obstacles may be over start or goal. Raises `InvalidScene`.

    `velocities`: of what moves, where that is known; scene files do not hold them.
    """

    velocities: tuple[Velocity, ...] = ()
    ENDS_CLEAR: ClassVar[bool] = False

    @classmethod
    def of(cls, scene: Scene, obstacles: Iterable[Obstacle], velocities: tuple[Velocity, ...] = ()) -> MomentaryScene:
        """The place of `scene` with other obstacles in it, as they stand just now. Raises `InvalidScene`."""
        return cls(
            scene.name,
            scene.bounds_m,
            scene.start,
            scene.goal,
            tuple(obstacles),
            scene.source,
            velocities=velocities,
        )


def _check_inside(scene: Scene) -> None:
    low, high = scene.bounds_m
    for what, xy in _ends(scene):
        if any(not low[i] <= xy[i] <= high[i] for i in range(2)):
            box = f"x {low[0]:g} .. {high[0]:g}, y {low[1]:g} .. {high[1]:g}"
            raise InvalidScene(f"{what} {xy} is outside bounds_m {box}")


def _check_clear(scene: Scene) -> None:
    low, high = scene.bounds_m
    for what, xy in _ends(scene):
        heights = [z for z in COLUMN_HEIGHTS_M if low[2] <= z <= high[2]]
        column = np.array([[*xy, z] for z in heights])
        for obstacle in scene.obstacles:
            # what moves may pass over the goal, but must not begin at the start
            if obstacle.motion is not None and what == "goal":
                continue
            if (obstacle.at(0.0).signed_distance(column) <= 0).any():
                raise InvalidScene(f"{what} {xy} is inside obstacle {obstacle.name!r} at a height of 0.1 to 1.2 m")


def _ends(scene: Scene) -> tuple[tuple[str, tuple[float, ...]], ...]:
    return ("start", scene.start[:2]), ("goal", scene.goal)


def _coordinates(where: str, value: object, length: int) -> tuple[float, ...]:
    return checks.vector(where, value, length, COORDINATE, InvalidScene)


def _obstacle_from_dict(index: int, entry: Any, folder: Path | None) -> Obstacle:
    required = ("name", "category", "shape", "position_m")
    checks.mapping(f"obstacles[{index}]", entry, required, ("quaternion_wxyz", "motion"), InvalidScene)
    _check_name(f"obstacles[{index}]", entry["name"])
    try:
        shape = shape_from_dict(entry["shape"], folder)
        motion = Motion.from_dict(entry["motion"]) if "motion" in entry else None
    except InvalidScene as error:
        raise InvalidScene(f"obstacle {entry['name']!r}: {error}") from None
    quat = entry.get("quaternion_wxyz", (1.0, 0.0, 0.0, 0.0))
    return Obstacle(entry["name"], entry["category"], shape, entry["position_m"], quat, motion)


def _copy_mesh(shape: MeshShape, folder: Path) -> list[Path]:
    """Copies a mesh file beside a scene file; the file if it is new."""
    target = folder / shape.file
    if target.resolve() == shape.path:
        return []
    content = shape.path.read_bytes()
    if not target.resolve().is_relative_to(folder.resolve()):
        raise InvalidScene(f"mesh file {shape.file!r} would be written outside {folder}")
    if output_file(target).exists():
        if target.read_bytes() != content:
            raise InvalidScene(f"{target} exists and is another mesh: save the scene to another folder")
        return []
    target.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(target, content)
    return [target]
