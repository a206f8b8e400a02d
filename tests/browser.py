"""A headless Chromium that tests drive by its own protocol, and what it asked of the network."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import urlsplit

from websockets.sync.client import ClientConnection, connect

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
WHY_NOT = "no Chromium on this machine: install Debian's package chromium"
# As root, Chromium goes before everything else on the machine, also before the vehicles that it shows.
_BEHIND = ("setpriv", "--bounding-set", "-sys_nice") if os.geteuid() == 0 and shutil.which("setpriv") else ()
_START_S, _STEP_S = 60.0, 0.05
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--remote-debugging-port=0",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-component-update",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
)


class Browser:
    """One window on one address. `asked` has every address that the page asked for, `said` what went wrong in it."""

    def __init__(self, width: int = 1400, height: int = 900, *, dark: bool = False) -> None:
        assert CHROMIUM is not None, WHY_NOT
        self.asked: list[str] = []
        self.said: list[str] = []
        self._count = 0
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        more = (f"--user-data-dir={self._profile.name}", f"--window-size={width},{height}", "about:blank")
        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen([*_BEHIND, CHROMIUM, *_FLAGS, *more], stdout=quiet, stderr=quiet)
        self._links = ExitStack()
        self._link = self._opened()
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(Exception):
            self._links.close()
        self._process.kill()
        self._process.wait()
        self._profile.cleanup()

    def call(self, method: str, **given: Any) -> dict[str, Any]:
        """Call one method of the protocol, and take in what is reported meanwhile."""
        self._count += 1
        self._link.send(json.dumps({"id": self._count, "method": method, "params": given}))
        while True:
            message = json.loads(self._link.recv(timeout=_START_S))
            if message.get("id") == self._count:
                assert "error" not in message, message["error"]
                result: dict[str, Any] = message["result"]
                return result
            self._note(message.get("method", ""), message.get("params", {}))

    def go(self, url: str) -> None:
        """Open an address."""
        self.call("Page.navigate", url=url)

    def value(self, expression: str) -> Any:
        """The value of a JavaScript expression."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, expression: str, within_s: float = 60.0) -> Any:
        """Wait until an expression is true, and return its value."""
        end_s = time.monotonic() + within_s
        while not (found := self.value(f"(() => {{ try {{ return {expression}; }} catch {{ return null; }} }})()")):
            assert time.monotonic() < end_s, f"not within {within_s:g} s: {expression}; the page said {self.said}"
            time.sleep(_STEP_S)
        return found

    def press(self, key: str) -> None:
        """Press and release a key."""
        text = "\r" if key == "Enter" else key if len(key) == 1 else ""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, text=text)

    def picture(self, path: Path) -> None:
        """Save what the window shows as PNG."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def elsewhere(self) -> list[str]:
        """The addresses outside this machine that the page asked for."""
        here = {"127.0.0.1", None}
        return [url for url in self.asked if urlsplit(url).scheme != "data" and urlsplit(url).hostname not in here]

    def _opened(self) -> ClientConnection:
        port_file = Path(self._profile.name) / "DevToolsActivePort"
        _wait(port_file.exists)
        _wait(lambda: len(port_file.read_text().split()) > 1)
        port = port_file.read_text().split()[0]
        import urllib.request

        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
            page = next(one for one in json.load(answer) if one["type"] == "page")
        link = connect(page["webSocketDebuggerUrl"], max_size=None, ping_interval=None)
        return self._links.enter_context(link)

    def _note(self, method: str, given: dict[str, Any]) -> None:
        if method == "Network.requestWillBeSent":
            self.asked.append(given["request"]["url"])
        elif method == "Network.webSocketCreated":
            self.asked.append(given["url"])
        elif method == "Runtime.exceptionThrown":
            self.said.append(str(given["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and given["type"] in ("error", "assert"):
            self.said.append(str([one.get("value", one.get("description")) for one in given["args"]]))
        elif method == "Log.entryAdded" and given["entry"]["level"] == "error":
            self.said.append(f"{given['entry']['text']} {given['entry'].get('url', '')}")


def _wait(is_true: Callable[[], bool]) -> None:
    end_s = time.monotonic() + _START_S
    while not is_true():
        assert time.monotonic() < end_s, "Chromium did not start"
        time.sleep(_STEP_S)
