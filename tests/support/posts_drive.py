"""The drive past posts (`posts`) as a drive folder, recorded without noise: where everything stands is known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tests.support import posts
from tests.support.recordings import scan_of

from echogrid.config.tables import Body
from echogrid_training.drives.drive import write_drive
from echogrid_training.recording import Motion, RadarMount, Recording, truth_from


def posts_drive(made: Path, turned: float = 0.0, beside: Sequence[tuple[float, float, float, float]] = ()) -> Path:
    """15 m between two rows of posts; with radars that are turned by so much more (rad) than the configuration says.

    `beside`: range, azimuth, range rate and RCS of what every scan shows besides.
    """
    scans = [scan_of(sensor, stamp, np.vstack((found - (0.0, turned, 0.0, 0.0), *beside))) for sensor, stamp, found in posts.scans()]
    where = posts.SPEED * (posts.MOTION_NS - posts.MOTION_NS[0]) * 1e-9
    still = np.zeros(len(where))
    recording = Recording(
        "street",
        Body(),
        tuple(RadarMount(name, mount, 2 * posts.HALF_FOV) for name, mount in posts.MOUNTS.items()),
        scans,
        Motion(posts.MOTION_NS, np.full((len(where), 4), posts.SPEED), posts.MOTION_NS, still),
        truth_from(posts.MOTION_NS, where, still, still),
    )
    write_drive(recording, made)
    return made
