import pytest

from hotice.errors import UnreachableGoal
from hotice.fields import FieldBank, build_hod_pf
from hotice.fields.hod_pf import UnreachableGoalWarning
from hotice.fields.reachability import check_reachable
from hotice.model import Obstacle, Scene, load_scene
from hotice.model.geometry.shapes import BoxShape

H = 0.05


def gate(width_m):
    """Two walls from floor to ceiling that leave a gap of this width."""
    sides = [
        Obstacle(f"wall{i}", "side", BoxShape((0.2, 2.0, 4.0)), (1.0, s * (1.0 + width_m / 2), 0.0))
        for i, s in enumerate((-1, 1))
    ]
    return Scene("gate", obstacles=tuple(sides))


def test_open_scenes_pass():
    for name in ("open_floor", "gap", "table_edge"):
        check_reachable(load_scene(name), H)
    check_reachable(gate(0.5), H)


def test_a_wall_between_names_the_nearest_point():
    with pytest.raises(
        UnreachableGoal, match=r"margin 0 m: walls between.*nearest reachable point is \(0\.8.*no margin"
    ):
        check_reachable(gate(0.0), H)


def test_inflation_that_closes_the_way_says_when_it_opens():
    with pytest.raises(UnreachableGoal, match=r"margin 0\.2 m.*opens at a margin of 0\.1[2-5] m"):
        check_reachable(gate(0.3), H, margin_m=0.2)


def test_a_goal_in_a_closed_cell():
    rooms = [
        Obstacle(f"side{i}", "side", BoxShape((0.1, 1.1, 4.0) if i < 2 else (1.1, 0.1, 4.0)), place)
        for i, place in enumerate([(1.5, 0.0, 0.0), (2.49, 0.0, 0.0), (2.0, 0.5, 0.0), (2.0, -0.5, 0.0)])
    ]
    near = Obstacle("post", "side", BoxShape((0.1, 0.1, 4.0)), (2.0, 0.12, 0.0))
    with pytest.raises(UnreachableGoal, match="margin 0 m: walls between"):
        check_reachable(Scene("cell", obstacles=(*rooms, near)), H)


def test_bank_raises_and_single_fields_warn():
    with pytest.raises(UnreachableGoal, match="gate"):
        FieldBank.build([gate(0.0)], H)
    with pytest.warns(UnreachableGoalWarning, match="gate"):
        build_hod_pf(gate(0.0), H)
