from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread

from hotice.errors import HoticeError, OutputError
from hotice.replay import film_strip, write_overview


def ink(path) -> float:
    """Share of pixels that differ from the picture's most frequent colour."""
    pixels = (imread(path)[..., :3] * 255).astype(int) @ np.array([65536, 256, 1])
    return 1.0 - np.unique(pixels, return_counts=True)[1].max() / pixels.size


def test_overview_shows_every_rollout(record, tmp_path):
    one = write_overview([record], tmp_path / "one.png")
    three = write_overview([record, replace(record, outcome="fall"), record], tmp_path / "three.png")
    assert ink(one) > 0.15 and ink(three) > 0.15
    assert imread(three).shape[0] > 2 * imread(one).shape[0]


def test_overview_shows_the_robot_where_it_went(record, tmp_path):
    still = replace(record, geom_pos_W=np.repeat(record.geom_pos_W[:1], len(record.time_s), axis=0))
    moving, standing = write_overview([record], tmp_path / "m.png"), write_overview([still], tmp_path / "s.png")
    assert np.abs(imread(moving) - imread(standing)).max() > 0.2


def test_film_strip_shows_motion(record, tmp_path):
    path = film_strip(record, tmp_path / "film.png", frames=4, columns=4)
    picture = imread(path)[40:, :, :3]
    quarters = [picture[:, i * 360 : (i + 1) * 360] for i in range(4)]
    assert ink(path) > 0.1
    assert all(np.abs(a - b).max() > 0.2 for a, b in zip(quarters, quarters[1:], strict=False))


def test_works_without_arrows_and_with_one_frame(record, tmp_path):
    single = replace(
        record._at(np.array([0])), arrow_pos_W=np.zeros((1, 0, 3)), arrow_force_W=np.zeros((1, 0, 3)), arrow_is_ogf=[]
    )
    assert ink(write_overview([single], tmp_path / "o.png")) > 0.05
    assert ink(film_strip(single, tmp_path / "f.png")) > 0.05


def test_bad_requests(record, tmp_path):
    with pytest.raises(HoticeError, match="at least one"):
        write_overview([], tmp_path / "o.png")
    with pytest.raises(HoticeError, match="none can be drawn"):
        film_strip(record, tmp_path / "f.png", start_s=10.0)
    for draw in (lambda p: write_overview([record], p), lambda p: film_strip(record, p, frames=1)):
        with pytest.raises(OutputError, match="cannot write"):
            draw(tmp_path / "missing" / "picture.png")
    assert list(tmp_path.iterdir()) == []
