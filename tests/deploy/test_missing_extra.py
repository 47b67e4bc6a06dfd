import sys

import pytest

from hotice.deploy.dds.node import LOOPBACK, DdsNode
from hotice.errors import MissingExtra


def test_what_to_install(monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "cyclonedds"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    with pytest.raises(MissingExtra, match=r"pip install 'hotice\[deploy\]'"):
        DdsNode(domain=1, interface=LOOPBACK)
