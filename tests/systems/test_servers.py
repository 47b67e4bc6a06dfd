"""Servers that a user starts without a word about it are for this machine alone."""

import json
import socket
from pathlib import Path

import pytest

import hotice
from hotice.errors import HoticeError, InvalidConfig
from hotice.replay.meshcat_page import page_viewer
from hotice.replay.scene_view import page_server
from hotice.systems import open_meshcat

EVERYWHERE = ("00000000", "0" * 32)
"""Local addresses of sockets that listen on all interfaces, as /proc has them."""


def listens_everywhere(port: int) -> bool:
    rows = [
        line.split()
        for name in ("tcp", "tcp6")
        if Path(f"/proc/net/{name}").exists()
        for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]
    ]
    found = [row[1].split(":")[0] for row in rows if row[3] == "0A" and int(row[1].split(":")[1], 16) == port]
    assert found, f"nothing listens on port {port}"
    return any(address in EVERYWHERE for address in found)


def test_the_probe_tells_them_apart():
    for host, everywhere in (("127.0.0.1", False), ("0.0.0.0", True)):
        with socket.socket() as listening:
            listening.bind((host, 0))
            listening.listen()
            assert listens_everywhere(listening.getsockname()[1]) == everywhere


def test_meshcat_of_a_station():
    own = open_meshcat()
    assert not listens_everywhere(own.port())
    with pytest.raises(InvalidConfig, match="no server there"):
        open_meshcat(port=own.port())
    with pytest.raises(InvalidConfig, match="port is 1: .* from 1,024 to 65,535"):
        open_meshcat(port=1)
    del own
    assert listens_everywhere(open_meshcat(host="*").port())


def test_pages_of_scenes():
    with page_server("<html>", 0) as server:
        assert not listens_everywhere(server.server_port)
        with pytest.raises(HoticeError, match="cannot be used"):
            page_server("", server.server_port)


def test_a_page_is_drawn_without_a_server(monkeypatch):
    monkeypatch.setattr("subprocess.Popen", lambda *_, **__: pytest.fail("a process was started"))
    viewer = page_viewer()
    viewer["/Grid"].set_property("visible", False)
    page = viewer.static_html()
    assert page.count("<script") == 3 and len(viewer.window.commands) == 1 and viewer.window.commands[0] in page


def test_notebooks_open_no_other():
    """drake's own Meshcat() listens on all interfaces."""
    folder = Path(hotice.__file__).parents[1] / "notebooks"
    for file in folder.glob("*.ipynb"):
        source = "".join(line for cell in json.loads(file.read_text())["cells"] for line in cell["source"])
        assert "Meshcat(" not in source and "StartMeshcat" not in source, file.name
