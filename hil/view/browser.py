"""Chromium without a window, led over its DevTools protocol: what a page shows and how fast."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import threading
import urllib.request
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

from websockets.sync.client import ClientConnection, connect

from highfive.model.errors import HighFiveError

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_START_S, _ANSWER_S = 30.0, 60.0


def browser_here() -> str | None:
    """Path of a Chromium on this computer; None where there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Browser:
    """One tab of a Chromium of its own; use it in ``with``."""

    def __init__(
        self, size: tuple[int, int] = (1280, 720), more: Sequence[str] = (), *, camera: Path | None = None
    ) -> None:
        """Starts it.

        Args:
            size: of the window, pixels.
            more: options of its command line.
            camera: a video, .mjpeg or .y4m, that it takes for its camera, over and over; None for no camera.

        Raises:
            HighFiveError: there is none here, or it does not start.
        """
        path = browser_here()
        if path is None:
            raise HighFiveError(f"no browser here that can be led: install {NAMES[0]}")
        self._folder = tempfile.TemporaryDirectory(prefix="highfive-browser-", ignore_cleanup_errors=True)
        options = [
            "--headless=new", "--no-sandbox", "--remote-debugging-port=0", f"--user-data-dir={self._folder.name}",
            f"--window-size={size[0]},{size[1]}", "--use-angle=gl-egl", "--ignore-gpu-blocklist", "--hide-scrollbars",
            "--no-first-run", "--disable-background-networking", *more, "about:blank",
        ]  # fmt: skip
        if camera is not None:
            options[:0] = [
                "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream",
                f"--use-file-for-fake-video-capture={camera.resolve()}",
            ]  # fmt: skip
        self._process = subprocess.Popen([path, *options], stderr=subprocess.PIPE, text=True)
        self._number, self._stack = 0, ExitStack()
        self.console: list[str] = []
        """What the page said, errors and all."""
        try:
            self._tab = self._opened(size)
        except BaseException:
            self.close()
            raise

    def go(self, address: str) -> None:
        """Opens a page."""
        self.call("Page.navigate", url=address)

    def evaluate(self, script: str) -> Any:
        """Value of a JavaScript expression, a promise awaited.

        Raises:
            HighFiveError: it threw.
        """
        answer = self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True, userGesture=True
        )
        if "exceptionDetails" in answer:
            raise HighFiveError(f"in the page: {json.dumps(answer['exceptionDetails'])[:500]}")
        return answer["result"].get("value")

    def picture(self, path: Path) -> None:
        """What it shows, as PNG."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command of the DevTools protocol, and its answer."""
        self._number += 1
        self._tab.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._tab.recv(_ANSWER_S))
            if message.get("id") == self._number:
                if "error" in message:
                    raise HighFiveError(f"{method}: {message['error'].get('message')}")
                return message["result"]
            if message.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled"):
                self.console.append(json.dumps(message["params"])[:400])

    def close(self) -> None:
        """Ends it."""
        self._process.kill()
        self._stack.close()
        self._process.wait()
        self._folder.cleanup()

    def __enter__(self) -> Browser:
        """Self."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends it."""
        self.close()

    def _opened(self, size: tuple[int, int]) -> ClientConnection:
        found: list[str] = []
        heard = threading.Event()
        threading.Thread(target=self._listen, args=(found, heard), daemon=True).start()
        if not heard.wait(_START_S) or not found:
            raise HighFiveError("the browser does not start")
        base = found[0].split("/devtools")[0].replace("ws://", "http://")
        request = urllib.request.Request(f"{base}/json/new?about:blank", method="PUT")
        with urllib.request.urlopen(request, timeout=_START_S) as answer:
            address = json.load(answer)["webSocketDebuggerUrl"]
        tab = self._stack.enter_context(connect(address, max_size=None, ping_interval=None))
        self._tab = tab
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        width, height = size
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < height
        )
        return tab

    def _listen(self, found: list[str], heard: threading.Event) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if "DevTools listening on" in line:
                found.append(line.split()[-1])
                heard.set()
        heard.set()
