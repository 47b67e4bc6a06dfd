"""Meshcat drawings that become a page without a server: meshcat's own would listen on all interfaces meanwhile."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

from hotice.errors import MissingExtra

PAGE = """<!DOCTYPE html>
<html>
<head><meta charset="utf-8"><title>MeshCat</title>
<style>body {{margin: 0}} #meshcat-pane {{width: 100vw; height: 100vh; overflow: hidden}}</style></head>
<body><div id="meshcat-pane"></div>
<script>{script}</script>
<script>
var viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
for (const text of {commands})
  viewer.handle_command_bytearray(Uint8Array.from(atob(text), c => c.charCodeAt(0)));
</script>
<script id="embedded-json"></script>
</body></html>
"""


class PageWindow:
    """What `meshcat.Visualizer` draws to: keeps its commands in order."""

    def __init__(self) -> None:
        self.commands: list[str] = []

    def send(self, command: Any) -> None:
        """Keeps a command of `meshcat.commands`."""
        import umsgpack

        self.commands.append(base64.b64encode(umsgpack.packb(command.lower())).decode())

    def get_scene(self) -> str:
        """The page; `meshcat.Visualizer.static_html` asks for it."""
        from meshcat.servers.zmqserver import VIEWER_ROOT

        script = (Path(VIEWER_ROOT) / "main.min.js").read_text(encoding="utf-8")
        return PAGE.format(script=script, commands=self.commands)


def page_viewer() -> Any:
    """A `meshcat.Visualizer` that draws to a page. Raises `MissingExtra`."""
    try:
        import meshcat
    except ImportError:
        raise MissingExtra("the scene viewer", "meshcat", "drake") from None
    return meshcat.Visualizer(window=PageWindow())
