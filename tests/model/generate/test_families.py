import mujoco
import numpy as np
import pytest

from hotice.errors import HoticeError, InvalidScene, UnknownName
from hotice.fields import build_hod_pf
from hotice.model import Box, Scene, builder
from hotice.model.carry import CarryState, Posture, solve_carry
from hotice.model.generate import family_from_text, family_scenes
from hotice.model.generate.families import GRADED

KINDS = list(GRADED)


def only(scene: Scene, name: str):
    return next(o for o in scene.obstacles if o.name == name)


@pytest.mark.parametrize("name", [*GRADED, "mixed"])
def test_families_are_reproducible_and_survive_a_file(name):
    scenes = family_scenes(name, 12, seed=3)
    assert scenes == family_scenes(name, 12, seed=3) == family_from_text(f"{name}:12:3")
    assert scenes != family_scenes(name, 12, seed=4)
    assert len({s.name for s in scenes}) == 12
    assert [Scene.from_dict(s.to_dict()) for s in scenes] == scenes


def test_names_and_turns():
    assert [s.name for s in family_from_text("pipe:4")] == ["pipe_00", "pipe_01", "pipe_02", "pipe_03"]
    mixed = family_scenes("mixed", 2 * len(KINDS) + 1)
    assert [s.name.rsplit("_", 1)[0] for s in mixed] == [*KINDS, *KINDS, KINDS[0]]
    assert [s.name for s in family_from_text("pipe:2:3")] == ["pipe_s3_00", "pipe_s3_01"]
    assert mixed[1] == family_scenes("pipe", 2)[0] and mixed[-1].name == "open_02"


@pytest.mark.parametrize("name", KINDS)
def test_every_scene_has_a_way_through(name):
    for scene in [*family_scenes(name, 3), family_scenes(name, 2, seed=1)[-1]]:
        field = build_hod_pf(scene, resolution_m=0.08).sgf
        start = np.array([[*scene.start[:2], z] for z in (0.2, 0.75)])
        way = field.geodesic_distance(start)
        straight = np.linalg.norm(scene.goal_W - start, axis=1)
        assert np.isfinite(way).all() and (way > straight - 0.25).all() and (way < straight + 0.6).all()


def touched(model: mujoco.MjModel, state: CarryState, xy) -> set[str]:
    """Obstacle geoms that the robot or its load touches, standing at xy and facing +x."""
    data = mujoco.MjData(model)
    data.qpos[:] = state.qpos()
    data.qpos[[0, 1]] += xy
    data.qpos[[27, 28]] += xy
    mujoco.mj_fwdPosition(model, data)
    names = {model.geom(int(g)).name for g in data.contact.geom.flatten()}
    return {n for n in names if n.startswith(builder.OBSTACLE_PREFIX)}


@pytest.mark.parametrize("name", [k for k in KINDS if k != "open"])
def test_start_and_goal_are_clear_of_a_robot_with_the_largest_box(name):
    """The whole robot and a 40 cm box touch nothing where episodes start and end. Sliding straight ahead they hit
    something in the hardest scene, except that a doorway or a table may leave just enough room."""
    state = solve_carry(Box((0.4, 0.4, 0.4), 2.0), Posture(pelvis_height_m=0.76))
    for seed in (0, 5):
        scenes = family_scenes(name, 4, seed)
        for scene in scenes:
            spec = builder.robot_spec(wrist_pos=state.wrist_pos)
            builder.add_object(spec, state.carried)
            builder.add_obstacles(spec, scene)
            model = spec.compile()
            assert not touched(model, state, scene.start[:2]) and not touched(model, state, scene.goal), scene.name
        assert name in ("gap", "table_edge") or any(touched(model, state, (x, 0.0)) for x in np.linspace(0, 2, 41)), (
            scenes[-1].name
        )


def test_grades():
    """What decides the difficulty, from the easiest to the hardest scene."""
    for seed in range(3):
        scenes = {name: family_scenes(name, 6, seed) for name in KINDS}
        radius = [only(s, "pipe").shape.radius_m for s in scenes["pipe"]]
        np.testing.assert_allclose(radius, np.linspace(0.01, 0.05, 6))
        assert all(0.7 <= only(s, "pipe").position_m[0] <= 1.4 for s in scenes["pipe"])
        steps = [only(s, "step").shape.size_m for s in scenes["step"]]
        np.testing.assert_allclose([s[2] for s in steps], np.linspace(0.01, 0.10, 6))
        assert all(0.04 <= s[0] <= 0.08 for s in steps)
        height = np.linspace(0, 1.3, 27)
        line = np.linspace(-0.99, 0.99, 199)
        for scene, width in zip(scenes["gap"], np.linspace(1.05, 0.70, 6), strict=True):
            x = only(scene, "left_wall").position_m[0]
            free = line[scene.signed_distance(np.array([[x, y, 0.75] for y in line])) > 0]
            assert np.ptp(free) == pytest.approx(width, abs=0.03) and abs(free.mean()) < 0.17
        for scene, under in zip(scenes["beam"], np.linspace(1.36, 1.05, 6), strict=True):
            x = only(scene, "beam").position_m[0]
            assert scene.signed_distance([x, 0.5, under - 0.001]) > 0 > scene.signed_distance([x, 0.5, under + 0.001])
        for scene, low in zip(scenes["hanging"], np.linspace(1.35, 1.0, 6), strict=True):
            x, y, _ = only(scene, "lamp").position_m
            assert scene.signed_distance([x, y, low - 0.001]) > 0 > scene.signed_distance([x, y, low + 0.001])
            assert (
                abs(y) <= 0.3 and (scene.signed_distance(np.array([[x, y, z] for z in height if z < 0.95])) > 0).all()
            )
        for scene, edge in zip(scenes["table_edge"], np.linspace(0.45, 0.20, 6), strict=True):
            x, y, z = only(scene, "table_top").position_m
            assert scene.signed_distance([x, 0, z]) == pytest.approx(edge) and 0.70 <= z + 0.02 <= 0.95
            assert abs(only(scene, "table_leg_1").position_m[1]) > 0.9
        for scene, free in zip(scenes["pillars"], np.linspace(0.75, 0.65, 6), strict=True):
            at = np.array([o.position_m[:2] for o in scene.obstacles])
            radii = np.array([o.shape.radius_m for o in scene.obstacles])
            between = np.linalg.norm(np.diff(at, axis=0), axis=1) - radii[1:] - radii[:-1]
            np.testing.assert_allclose(between, free)
            assert len(at) in (2, 3) and (np.diff(np.sign(at[:, 1])) != 0).all()
            assert (np.abs(at[:, 1]) - radii < 0.33).all() and (1 + np.abs(at[:, 1]) - radii > 0.65).all()
        for scene, distance in zip(scenes["open"], np.linspace(1.0, 2.2, 6), strict=True):
            assert np.hypot(*scene.goal) == pytest.approx(distance) and not scene.obstacles
            assert abs(np.arctan2(scene.goal[1], scene.goal[0])) <= np.radians(35)
        for scene in scenes["combo"]:
            assert len(scene.obstacles) >= 2


@pytest.mark.parametrize(
    "text",
    ["pipe", "pipe:", "pipe:x", "pipe:-1", "pipe:1:2:3", "pipe:0", "pipe:1:-2", "pipe:99999999", "pipe:²", "pipe:\n"],
)
def test_bad_text(text):
    with pytest.raises(InvalidScene, match="scene family") as caught:
        family_from_text(text)
    assert "\n" not in str(caught.value)


def test_unknown_family():
    for text in ("", "tunnel:3", "tun\nnel"):
        with pytest.raises(UnknownName, match="known are all, beam, beam_across, closing_gap") as caught:
            family_from_text(text)
        assert "\n" not in str(caught.value) and isinstance(caught.value, HoticeError)
