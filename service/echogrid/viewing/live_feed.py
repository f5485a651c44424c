"""What a running service publishes, as a scene."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from echogrid.client import Client, Credentials, MapName
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.viewing.scene import Frames, Scene

LOOK = 0.02  # s between two looks
SILENT = 2.5  # s without a status: two of them did not come
AROUND = 200.0  # m of the map before and beside the car that are asked for when a map is seen for the first time
ASK = 2.0  # s to wait for them


class LiveFeed:
    """Remembers the scene. One thread runs `run`, and hands frames on; any may ask for `whole`, under `lock`."""

    def __init__(self, endpoint: str, vehicle: str, credentials: Credentials | None) -> None:
        """Raises EchogridError for an endpoint, a vehicle or credentials that cannot be."""
        self.client = Client(endpoint, vehicle, credentials)
        self.lock = threading.Lock()
        self.scene = Scene(
            {"shown": "live", "name": f"{vehicle} at {endpoint}", "vehicle": vehicle, "planes": ["OCCUPANCY"], "timeline": False}
        )
        self._map: MapName | None = None
        self._heard = time.monotonic()
        self._told_silence = 0.0

    def run(self, stop: threading.Event, send: Callable[[Frames], None]) -> None:
        """Until `stop`. A service that is not there is waited for; one that goes is told of."""
        with self.client:
            while not stop.wait(LOOK):
                with self.lock:
                    frames = self._look()
                    if frames:  # under the lock, so that a newcomer gets each frame either with the whole or behind it
                        send(frames)

    def _look(self) -> Frames:
        client, scene, frames = self.client, self.scene, list[bytes]()
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
                frames += self._before(window.map)
        if (status := client.status(0)) is not None:
            self._heard = time.monotonic()
            frames += scene.status(status, time.time_ns())
        return frames + self._silence()

    def _before(self, name: MapName) -> Frames:
        """What the service knows of a map that began before we listened; nothing where it does not answer."""
        x, y = self.scene.place or (0.0, 0.0)
        try:
            part = self.client.region((x - AROUND, y - AROUND, x + AROUND, y + AROUND), timeout=ASK)
        except EchogridError:
            return []
        return [] if part is None or part.map != name else self.scene.window(part, name)

    def _silence(self) -> Frames:
        now = time.monotonic()
        if now - self._heard < SILENT or now - self._told_silence < 1.0:
            return []
        self._told_silence = now
        reason = f"service: no status for {now - self._heard:.0f} s, waiting for vehicle '{self.client.vehicle}' at {self.client.endpoint}"
        silent: dict[str, Any] = {"state": "silent", "reasons": (reason,)}
        return self.scene.status(silent, time.time_ns())
