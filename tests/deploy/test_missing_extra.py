import sys

import pytest

from hotice.deploy.dds.node import LOOPBACK, DdsNode
from hotice.deploy.tags import BoxPoser, TagDetector, box_bundle, write_sheets
from hotice.deploy.tags.markers import black_cells, dictionary
from hotice.errors import MissingExtra
from hotice.model.objects import Box


def test_what_to_install(monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "cyclonedds"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    with pytest.raises(MissingExtra, match=r"pip install 'hotice\[deploy\]'"):
        DdsNode(domain=1, interface=LOOPBACK)


def test_tags_need_opencv(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "cv2", None)
    dictionary.cache_clear()
    black_cells.cache_clear()
    box = Box((0.3, 0.3, 0.25), 1.5)
    bundle = box_bundle(box)
    for use in (
        lambda: TagDetector(bundle.ids),
        lambda: BoxPoser(bundle),
        lambda: write_sheets(box, tmp_path / "tags.pdf"),
    ):
        with pytest.raises(MissingExtra, match=r"needs OpenCV.*pip install 'hotice\[deploy\]'"):
            use()
    assert not list(tmp_path.iterdir())
