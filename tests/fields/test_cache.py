import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from hotice.fields import FieldBank, cache
from hotice.fields import bank as bank_module
from hotice.model import Obstacle, Scene
from hotice.model.geometry.shapes import BoxShape

H = 0.1


def scenes(count=4):
    return [
        Scene(f"s{i}", obstacles=(Obstacle("b", "side", BoxShape((0.2, 0.4, 3.0)), (1.0, 0.5 + 0.05 * i, 0.0)),))
        for i in range(count)
    ]


def same(a, b):
    np.testing.assert_array_equal(a.volumes.sdf, b.volumes.sdf)
    for x, y in zip((*a.volumes.geo, a.volumes.step), (*b.volumes.geo, b.volumes.step), strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.fixture
def solved(monkeypatch):
    names = []
    plain = bank_module.solve_scene

    def count(scene, *args):
        names.append(scene.name)
        return plain(scene, *args)

    monkeypatch.setattr(bank_module, "solve_scene", count)
    return names


def test_cached_bank_equals_a_fresh_one_and_is_solved_once(tmp_path, solved):
    fresh = FieldBank.build(scenes(), H)
    first = FieldBank.build(scenes(), H, cache=tmp_path)
    assert len(solved) == 8
    second = FieldBank.build(scenes(), H, cache=tmp_path)
    assert len(solved) == 8
    assert isinstance(second.volumes.sdf, np.memmap)
    same(fresh, first)
    same(fresh, second)
    FieldBank.build([*scenes(), *scenes(6)[4:]], H, cache=tmp_path)
    assert sorted(solved[8:]) == ["s4", "s5"]
    assert not [p for p in tmp_path.iterdir() if p.suffix == ".tmp"]


def test_damaged_files_are_made_again(tmp_path, solved):
    fresh = FieldBank.build(scenes(2), H)
    FieldBank.build(scenes(2), H, cache=tmp_path)
    fields, banks = sorted(tmp_path.glob("*.field")), list(tmp_path.glob("*.bank"))
    whole = fields[0].read_bytes()
    for damaged in (whole[:-1], b"", b"junk\n" * 10, whole[:5000] + bytes([whole[5000] ^ 1]) + whole[5001:]):
        fields[0].write_bytes(damaged)
        banks[0].write_bytes(banks[0].read_bytes()[:-100])
        before = len(solved)
        with pytest.warns(cache.BrokenCacheFile, match="damaged"):
            same(fresh, FieldBank.build(scenes(2), H, cache=tmp_path))
        assert len(solved) == before + 1


def test_keys_follow_content(tmp_path):
    one = scenes(1)[0]
    key = cache.scene_key(one, H, (0.0, 0.08))
    assert key == cache.scene_key(one.renamed("other"), H, (0.0, 0.08))
    others = [cache.scene_key(scenes(2)[1], H, (0.0, 0.08)), cache.scene_key(one, 0.05, (0.0, 0.08))]
    assert len({key, *others, cache.scene_key(one, H, (0.0, 0.1))}) == 4


@pytest.mark.slow
def test_a_killed_build_resumes(tmp_path):
    code = f"""
from pathlib import Path
import sys
sys.path.insert(0, {os.path.dirname(__file__)!r})
from test_cache import scenes
from hotice.fields import FieldBank
FieldBank.build(scenes(60), 0.04, workers=1, cache=Path({str(tmp_path)!r}))
"""
    process = subprocess.Popen([sys.executable, "-c", code])
    while len(list(tmp_path.glob("*.field"))) < 3 and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = {p: p.stat().st_mtime_ns for p in tmp_path.glob("*.field")}
    assert 3 <= len(kept) < 60
    resumed = FieldBank.build(scenes(60), 0.04, cache=tmp_path)
    assert all(p.stat().st_mtime_ns == t for p, t in kept.items())
    same(resumed, FieldBank.build(scenes(60), 0.04))


@pytest.mark.parametrize("ending", ["field", "bank"])
def test_no_flipped_byte_gives_other_forces(tmp_path, ending):
    """In the header's numbers as in the values: each is found, and the file made anew."""
    FieldBank.build(scenes(2), H, cache=tmp_path)
    path = sorted(tmp_path.glob(f"*.{ending}"))[0]
    whole = path.read_bytes()
    header = whole[: whole.index(b"\n")]
    origin = header.index(b'"origins": [[-') + len(b'"origins": [[-')
    spots = [origin, len(header) + 1, *np.random.default_rng(0).integers(4096, len(whole), 6).tolist(), len(whole) - 1]
    for spot in spots:
        path.write_bytes(whole[:spot] + bytes([whole[spot] ^ 1]) + whole[spot + 1 :])
        for other in set(tmp_path.glob("*.bank")) - {path}:
            other.unlink()
        with pytest.warns(cache.BrokenCacheFile, match="damaged"):
            built = FieldBank.build(scenes(2), H, cache=tmp_path)
        assert path.read_bytes() == whole, spot
    same(FieldBank.build(scenes(2), H), built)
