"""A page in headless Chromium, driven by remote debugging: scripts, keys, pictures, and what it complained of."""

from __future__ import annotations

import base64
import contextlib
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
)
PATIENCE_S = 120.0


def found() -> str | None:
    """Path of a Chromium, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Page:
    """One page; `complaints`: errors of scripts, and lines on its console that are errors or warnings."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._count = socket, 0
        self.complaints: list[str] = []
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Result of a method of the protocol; what is told meanwhile is listened to."""
        self._count += 1
        self._socket.send(json.dumps({"id": self._count, "method": method, "params": params}))
        while True:
            message = json.loads(self._socket.recv(timeout=PATIENCE_S))
            if message.get("id") == self._count:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']['message']}")
                return message["result"]
            self._hear(message)

    def _hear(self, message: dict[str, Any]) -> None:
        match message.get("method"), message.get("params"):
            case "Runtime.exceptionThrown", {"exceptionDetails": details}:
                self.complaints.append(details.get("exception", {}).get("description", details["text"]))
            case "Runtime.consoleAPICalled", {"type": "error" | "warning", "args": args}:
                self.complaints.append(" ".join(str(a.get("value", a.get("description"))) for a in args))
            case "Log.entryAdded", {"entry": {"level": "error", "text": text}}:
                self.complaints.append(text)

    def run(self, script: str) -> Any:
        """Value of a JavaScript expression; a promise is waited for."""
        done = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in done:
            raise RuntimeError(done["exceptionDetails"].get("exception", {}).get("description", "script failed"))
        return done["result"].get("value")

    def drawn(self) -> None:
        """Waits until the page has drawn twice."""
        self.run("new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(() => go(1))))")

    def key(self, key: str, code: str | None = None) -> None:
        """Presses and lets go of a key, as `KeyboardEvent.key` names it."""
        text = {"text": key} if len(key) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, code=code or key, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, code=code or key)

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 10) -> None:
        """Presses the mouse at a place [px], moves it to another and lets go."""
        self._mouse("mouseMoved", start, pressed=False)
        self._mouse("mousePressed", start)
        for i in range(1, steps + 1):
            self._mouse("mouseMoved", tuple(a + (b - a) * i / steps for a, b in zip(start, end, strict=True)))
        self._mouse("mouseReleased", end)

    def _mouse(self, kind: str, at: tuple[float, ...], *, pressed: bool = True) -> None:
        buttons = {"button": "left", "buttons": 1, "clickCount": 1} if pressed else {}
        self.call("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], **buttons)

    def size(self, width: int, height: int, *, scale: float = 1.0, phone: bool = False) -> None:
        """Size of the window [px]."""
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=phone
        )

    def picture(self) -> bytes:
        """What is seen, as a PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])


@contextlib.contextmanager
def opened(url: str, width: int = 1280, height: int = 800) -> Iterator[Page]:
    """A page in a Chromium of its own, which ends with the block. `RuntimeError` where there is none."""
    program = found()
    if program is None:
        raise RuntimeError(f"no browser: one of {', '.join(NAMES)} is needed")
    with tempfile.TemporaryDirectory(prefix="hotice-browser-", ignore_cleanup_errors=True) as profile:
        command = [program, *FLAGS, f"--user-data-dir={profile}", f"--window-size={width},{height}", "about:blank"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            with connect(_address(Path(profile), process), max_size=None, open_timeout=PATIENCE_S) as socket:
                page = Page(socket)
                page.size(width, height)
                page.call("Page.navigate", url=url)
                while page.run("document.readyState") != "complete":
                    time.sleep(0.1)
                yield page
        finally:
            process.terminate()
            process.wait(30)


def _address(profile: Path, process: subprocess.Popen) -> str:
    """Where the first page listens."""
    port_file, end = profile / "DevToolsActivePort", time.monotonic() + PATIENCE_S
    while time.monotonic() < end and process.poll() is None:
        if port_file.is_file() and "\n" in port_file.read_text():
            port = port_file.read_text().split("\n")[0]
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=PATIENCE_S) as answer:
                pages = [each for each in json.load(answer) if each["type"] == "page"]
            if pages:
                return pages[0]["webSocketDebuggerUrl"]
        time.sleep(0.1)
    raise RuntimeError("the browser did not start")
