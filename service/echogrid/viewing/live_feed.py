"""What a running service publishes, as a scene."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from echogrid.client import Client, Credentials, MapName, vehicles
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.viewing.scene import Frames, Scene

LOOK = 0.02  # s between two looks
SILENT = 2.5  # s without a status: two of them did not come
AROUND = 200.0  # m of the map before and beside the car that are asked for when a map is seen for the first time
ASK = 2.0  # s to wait for them


class LiveFeed:
    """Remembers the scene. One thread runs `run`, and hands frames on; any may ask for `whole`, under `lock`."""

    def __init__(self, endpoint: str, vehicle: str | None, credentials: Credentials | None) -> None:
        """`vehicle`: None for the only one that is there. Raises EchogridError for an endpoint, a vehicle or credentials that cannot be."""
        self.endpoint, self.credentials = endpoint, credentials
        self.lock = threading.Lock()
        self.scene = Scene(_source(endpoint, vehicle))
        if vehicle is None:
            vehicles(endpoint, credentials, 0.0)  # for what it raises
        self._client = None if vehicle is None else Client(endpoint, vehicle, credentials)
        self._map: MapName | None = None
        self._heard = time.monotonic()
        self._told_silence = 0.0

    def run(self, stop: threading.Event, send: Callable[[Frames], None]) -> None:
        """Until `stop`. A service that is not there is waited for; one that goes is told of. Raises EchogridError where there are several
        vehicles, and none was named."""
        client = self._client or self._found(stop, send)
        if client is None:
            return
        with client:
            while not stop.wait(LOOK):
                with self.lock:
                    frames = self._look(client)
                    if frames:  # under the lock, so that a newcomer gets each frame either with the whole or behind it
                        send(frames)

    def _found(self, stop: threading.Event, send: Callable[[Frames], None]) -> Client | None:
        """A client of the only vehicle, once it is there; None where `stop` came first."""
        while not stop.is_set():
            found = vehicles(self.endpoint, self.credentials, ASK)
            if len(found) > 1:
                raise EchogridError(f"{self.endpoint}: the vehicles {', '.join(found)} are there, expected one: say which with --vehicle")
            with self.lock:
                if found:
                    self.scene.source |= _source(self.endpoint, found[0])
                    self._heard = time.monotonic()
                    return Client(self.endpoint, found[0], self.credentials)
                send(self._silence())
        return None

    def _look(self, client: Client) -> Frames:
        scene, frames = self.scene, list[bytes]()
        if (meta := client.meta(0)) is not None:
            frames += scene.meta(meta)
        if (pose := client.odometry(0)) is not None:
            place = SE2(pose.x, pose.y, pose.yaw)
            frames += scene.pose(pose.stamp_ns, place, pose.speed, pose.yaw_rate)
        if (judged := client.judged(0)) is not None:
            frames += scene.detections(judged.stamp_ns, judged.points, judged.radars, judged.verdicts)
        if (window := client.follow(0)) is not None:
            frames += scene.window(window, window.map)
            if window.map != self._map:
                self._map = window.map
                frames += self._before(client, window.map)
        if (status := client.status(0)) is not None:
            self._heard = time.monotonic()
            frames += scene.status(status, time.time_ns())
        return frames + self._silence()

    def _before(self, client: Client, name: MapName) -> Frames:
        """What the service knows of a map that began before we listened; nothing where it does not answer."""
        x, y = self.scene.place or (0.0, 0.0)
        try:
            part = client.region((x - AROUND, y - AROUND, x + AROUND, y + AROUND), timeout=ASK)
        except EchogridError:
            return []
        return [] if part is None or part.map != name else self.scene.window(part, name)

    def _silence(self) -> Frames:
        now = time.monotonic()
        if now - self._heard < SILENT or now - self._told_silence < 1.0:
            return []
        self._told_silence = now
        reason = f"service: no status for {now - self._heard:.0f} s, waiting for {self.scene.source['name']}"
        silent: dict[str, Any] = {"state": "silent", "reasons": (reason,)}
        return self.scene.status(silent, time.time_ns())


def _source(endpoint: str, vehicle: str | None) -> dict[str, Any]:
    name = f"{'a vehicle' if vehicle is None else vehicle} at {endpoint}"
    return {"shown": "live", "name": name, "vehicle": vehicle, "planes": ["OCCUPANCY"], "timeline": False}
