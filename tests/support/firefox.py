"""A Firefox without a window, spoken to by WebDriver BiDi; nothing but Firefox itself and a WebSocket is needed."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.support.waiting import PATIENCE, until
from websockets.sync.client import ClientConnection, connect

FIREFOX = next(filter(None, map(shutil.which, ("firefox-esr", "firefox"))), None)


class Tab:
    """One page. `errors`: what its scripts threw, and what it wrote as an error."""

    def __init__(self, socket: ClientConnection) -> None:
        self.errors: list[str] = []
        self._socket = socket
        self._number = 0
        self._say("session.new", capabilities={})
        self._say("session.subscribe", events=["log.entryAdded"])
        self._context = self._say("browsingContext.getTree")["contexts"][0]["context"]

    def goto(self, address: str) -> None:
        self._say("browsingContext.navigate", context=self._context, url=address, wait="complete")

    def evaluate(self, expression: str) -> Any:
        """A value that JSON has; promises are waited for."""
        wrapped = f"Promise.resolve({expression}).then((value) => JSON.stringify(value ?? null))"
        told = self._say("script.evaluate", expression=wrapped, target={"context": self._context}, awaitPromise=True)
        assert told["type"] == "success", told["exceptionDetails"]["text"]
        return json.loads(told["result"]["value"])

    def wait(self, what: str) -> None:
        until(lambda: self.evaluate(f"!!({what})"))

    def press(self, key: str) -> None:
        actions = [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        self._say("input.performActions", context=self._context, actions=[{"type": "key", "id": "keys", "actions": actions}])

    def picture(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(base64.b64decode(self._say("browsingContext.captureScreenshot", context=self._context)["data"]))

    def _say(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            told = json.loads(self._socket.recv(timeout=PATIENCE))
            if told.get("method") == "log.entryAdded" and told["params"]["level"] == "error":
                self.errors.append(told["params"]["text"])
            elif told.get("id") == self._number:
                assert told["type"] == "success", told
                return dict(told["result"])


@contextmanager
def firefox(profile: Path) -> Iterator[Tab]:
    """`profile`: a folder for it, which is made."""
    profile.mkdir(parents=True)
    command = [
        str(FIREFOX),
        "--headless",
        "--no-remote",
        "--profile",
        str(profile),
        "--remote-debugging-port",
        "0",
        "--window-size",
        "1280,800",
    ]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as program:
        try:
            assert program.stderr is not None
            address = next(found[1] for line in program.stderr if (found := re.search(r"listening on (ws://\S+)", line)))
            with connect(f"{address}/session", max_size=None, open_timeout=PATIENCE) as socket:
                yield Tab(socket)
        finally:
            program.terminate()
            program.communicate(timeout=PATIENCE)
