"""`hotice play` with controllers of a station: what it writes, what it says of hand-overs, what it refuses."""

import subprocess
import sys

import pytest

pytest.importorskip("pydrake")
pytest.importorskip("pinocchio")

from hotice.commands.program import main
from hotice.model import Obstacle, Scene
from hotice.model.geometry.shapes import BoxShape
from hotice.replay import RolloutRecord


def played(capsys, *options):
    """Exit status and what was printed."""
    status = main(["play", *map(str, options)])
    return status, capsys.readouterr()


def test_a_walk_to_look_at(tmp_path, capsys):
    page = tmp_path / "walk.html"
    status, text = played(
        capsys, "--controller", "walk", "--scene", "open_floor", "--rollouts", 1, "--seconds", 1, "--out", page
    )
    assert status == 0 and page.stat().st_size > 10_000 and page.with_suffix(".png").is_file()
    assert "open_floor: timeout" in text.out and "hand-over" not in text.out


@pytest.fixture
def short_run(monkeypatch):
    """Runs end at once, told to have fallen back; the record is that of a robot standing with its box."""
    import hotice.systems.record.play as play
    from hotice.model import builder
    from hotice.systems.record.hand_over import HandOverReport

    configs = []

    def run(station, seconds):
        configs.append(station.config)
        carry = station.carry
        model = builder.build_model(carry.carried, floor=False)
        record = RolloutRecord.from_states(
            model,
            carry.qpos(),
            scene=station.world,
            carried=carry.carried,
            time_s=[0.0],
            outcome="timeout",
            policy="walk",
        )
        report = HandOverReport(who="walk", time_s=17.7, verdict="fall", failure="")
        return play.Run(record=record, hand_over=report)

    monkeypatch.setattr(play, "play_station", run)
    return configs


def test_fallbacks_are_told_and_counted(short_run, tmp_path, capsys):
    options = ("--controller", "pickup_then_policy", "--rollouts", 2, "--seed", 3, "--out", tmp_path / "p.html")
    status, text = played(capsys, *options)
    assert status == 0
    assert text.out.count("17.7 s: handed over to the walk (policy rehearsal: fall), kept the object") == 2
    assert "hand-overs: 2 of 2; fallbacks to walk: 2; kept holding: 0" in text.out
    first, second = short_run
    assert first.carried != second.carried and first.policy == "student"
    assert not first.sensing.exact  # perturbed by default, as other rollouts
    short_run.clear()
    assert played(capsys, *options, "--no-perturbed")[0] == 0
    assert short_run[0].carried == first.carried and short_run[0].sensing.exact


@pytest.mark.parametrize(
    "options, message",
    [
        (["--seconds", 0], "seconds is 0.0"),
        (["--seconds", "nan"], "seconds is nan"),
        (["--policy", "nobody"], "unknown policy 'nobody'"),
        (["--policy", "."], "hotice export"),
        (["--scene", "nowhere"], "unknown scene 'nowhere'"),
        (["--out", "no/such/\0/p.html"], "hotice:"),
    ],
)
def test_refusals(options, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    status, text = played(capsys, "--controller", "pickup_then_policy", "--rollouts", 1, *options)
    assert status == 2 and message in text.err and len(text.err.strip().splitlines()) == 1
    assert "Traceback" not in text.err and not list(tmp_path.glob("*.html"))


def test_an_unknown_controller(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["play", "--controller", "fly"])
    assert stop.value.code == 2 and "pickup_then_policy" in "".join(capsys.readouterr())


def test_a_scene_without_room_for_a_table(tmp_path, capsys):
    walls = tuple(
        Obstacle(f"w{i}", "side", BoxShape((0.3, 0.3, 1.4)), (x, y, 0.7))
        for i, (x, y) in enumerate(
            [(0.0, 0.65), (0.0, -0.65), (-0.65, 0.0), (-0.5, 0.5), (-0.5, -0.5), (0.4, 0.55), (0.4, -0.55)]
        )
    )
    Scene("cell", bounds_m=((-1.0, -1.0, 0.0), (2.5, 1.0, 1.5)), obstacles=walls).save(tmp_path / "cell.json")
    status, text = played(
        capsys, "--controller", "pickup", "--scene", tmp_path / "cell.json", "--out", tmp_path / "p.html"
    )
    assert status == 2 and "'cell' leaves no room for a table" in text.err


def test_without_drake(tmp_path):
    code = (
        "import sys; sys.modules['pydrake'] = None; from hotice.commands.program import main; "
        "sys.exit(main(['play', '--controller', 'walk']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2 and "pip install 'hotice[drake]'" in done.stderr and "Traceback" not in done.stderr
