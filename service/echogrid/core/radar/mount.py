"""Where a radar sits on the car, and what it can see from there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2


@dataclass(frozen=True, slots=True)
class Mount:
    """`base_from_sensor`, the half-width of the field of view (rad) and the range (m) up to which detections are used."""

    base_from_sensor: SE2
    half_fov: float
    max_range: float

    def sees(self, points: Floats) -> NDArray[np.bool_]:
        """Which of the points (…, 2) in base are in the field of view."""
        dx, dy = points[..., 0] - self.base_from_sensor.x, points[..., 1] - self.base_from_sensor.y
        off_boresight = np.angle(np.exp(1j * (np.arctan2(dy, dx) - self.base_from_sensor.yaw)))
        inside: NDArray[np.bool_] = (np.abs(off_boresight) <= self.half_fov) & (np.hypot(dx, dy) <= self.max_range)
        return inside
