"""Patches: the same images and truths as the training samples, and strata against a slow walk along rays."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from echogrid.core.evidence.history_raster import CHANNELS
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid_training.drives.samples import samples
from echogrid_training.evaluation.simulated.patches import BEHIND, RINGS, STRATA, in_sight, patches, spread, strata
from echogrid_training.evaluation.simulated.tape import Marks, Tape

SPEC = GridSpec(32, 0.5)
MOUNT = Mount(SE2(1.0, 0.5, math.radians(30)), math.radians(75), 25.0)


def test_patches_are_the_training_samples(room_drive: Path, room_tape: Tape) -> None:
    found, expected = list(patches(room_tape, 100)), list(samples(room_drive))
    assert len(found) == len(expected) > 10
    for patch, sample in zip(found, expected, strict=True):
        np.testing.assert_array_equal(patch.image, sample.image)
        told = sample.truth != 0  # of what no radar can have earned a sample says nothing; here it is judged as well
        np.testing.assert_array_equal(patch.place.truth[told], sample.truth[told])
        assert told.mean() > 0.1


def test_the_car_itself_is_not_judged(room_tape: Tape) -> None:
    (patch,) = patches(room_tape, 1)
    body = room_tape.config.body
    covered = (~patch.place.outside).sum() * (30 / 128) ** 2
    assert abs(covered - body.length * body.width) < 1.0
    assert not patch.place.counted[64, 64]


def test_a_few_are_evenly_spread() -> None:
    assert spread(100, 3) == [0, 49, 99]
    assert spread(2, 60) == [0, 1]
    assert spread(0, 5) == []


def test_marks_are_as_far_apart_as_asked() -> None:
    marks = Marks(5.0)
    assert [x for x in range(20) if marks.reached(SE2(float(x), 0.0, 0.0))] == [0, 5, 10, 15]


def test_sight_ends_at_the_first_surface() -> None:
    """Along the straight line from the radar to a cell's centre, in small steps: something occupied well before it, or nothing."""
    rng = np.random.default_rng(0)
    occupied = rng.uniform(size=(32, 32)) < 0.03
    found = in_sight(occupied, MOUNT, SPEC)
    origin, centres = np.array((MOUNT.base_from_sensor.x, MOUNT.base_from_sensor.y)), SPEC.centres()
    for row in range(32):
        for column in range(32):
            way = centres[row, column] - origin
            distance = float(np.hypot(*way))
            along = np.arange(0.05, distance, 0.05)
            cells = SPEC.locate(origin + along[:, None] * way / distance)
            met = along[(cells >= 0) & occupied.reshape(-1)[cells]]
            before = met[met < distance - (BEHIND + 1.0) * SPEC.cell]  # in doubt, where a ray grazes a cell
            if found[row, column]:
                assert MOUNT.sees(centres[row, column])
                assert len(before) * 0.05 < SPEC.cell
            elif MOUNT.sees(centres[row, column]):
                assert len(met)


def test_a_wall_hides_what_is_behind_it() -> None:
    wall = np.zeros((32, 32), dtype=bool)
    wall[:, 24] = True  # x from 4.0 to 4.5 m
    found = in_sight(wall, MOUNT, SPEC)
    assert found[16, 24]
    assert not found[16:20, 26:].any()
    assert found[16:20, 19:24].all()


def test_every_cell_is_in_one_stratum_of_visibility() -> None:
    image = np.zeros((len(CHANNELS), 32, 32), dtype=np.uint8)
    image[CHANNELS.index("view"), :, 16:] = 200
    image[CHANNELS.index("looks_15m"), :, 8:] = 32
    wall = np.zeros((32, 32), dtype=bool)
    wall[:, 24] = True
    found = dict(zip(STRATA, strata(wall, image, [MOUNT], SPEC), strict=True))
    seen = list(found.values())[len(RINGS) :]
    np.testing.assert_array_equal(sum(one.astype(int) for one in seen), 1)
    assert found["out of view, looked at"][:, 8:16].all()
    assert found["never looked at"][:, :8].all()
    assert found["in view, behind a surface"][16, 28]
    assert found["in view, first surface"][16, 24]
    rings = np.stack([found[name] for name in STRATA[: len(RINGS)]])
    distance = np.hypot(*SPEC.centres().transpose(2, 0, 1))
    np.testing.assert_array_equal(rings, [(distance >= near) & (distance < far) for near, far in ((0, 5), (5, 10), (10, 15))])
