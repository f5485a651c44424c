"""Standing things seen again: what errors make of their places, planted errors, what chance teaches, and what is not averaged away."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from tests.support.driven import MOUNTS, STEP, Driven, Errors, follow

from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.core.motion.error_model import BIAS, POSE, SCALE
from echogrid.core.radar.seen_again import BATCH, DISTORTED, MOVES, PERIOD_NS, SeenAgain, _of_bias_alone, _whitened, compared
from echogrid.core.radar.sightings import LATEST_NS, Pairs, pairs

DEGREE = math.radians(1.0)


@dataclass
class Street(Driven):
    """Things stand at `things` (M, 2) m, and radars see those within 40 m, off by `blur` m and `bent` rad (one sigma)."""

    things: Floats = None  # type: ignore[assignment]
    blur: float = 0.1
    bent: float = 0.015

    def scan(self, radar: int, n: int) -> RadarScan:
        name, mount = list(MOUNTS.items())[radar]
        sensor, rng, (x, y, yaw) = mount.base_from_sensor, self._rng, self.way[n]
        yaw_of_it = sensor.yaw + self.errors.yaws[radar]
        at = complex(x, y) + complex(sensor.x, sensor.y) * np.exp(1j * yaw)
        seen = (self.things.view(np.complex128)[:, 0] - at) * np.exp(-1j * (yaw + yaw_of_it))
        seen = seen[(np.abs(seen) < 40.0) & (np.abs(np.angle(seen)) < 1.2)]
        azimuth = np.angle(seen)
        vx, vy = self.speed[n] - self.yaw_rate[n] * sensor.y, self.yaw_rate[n] * sensor.x
        rate = -(vx * np.cos(azimuth + yaw_of_it) + vy * np.sin(azimuth + yaw_of_it))
        rate += np.where(rng.uniform(size=len(seen)) < self.moving, rng.uniform(-15.0, 15.0, len(seen)), 0.0)
        distance, shown = np.abs(seen) + rng.normal(0.0, self.blur, len(seen)), azimuth + rng.normal(0.0, self.bent, len(seen))
        stamp_ns = round(self.time[n] * 1e9)
        return RadarScan(name, stamp_ns, stamp_ns, distance, shown, rate, np.zeros(len(seen)))


def street(
    seconds: float, errors: Errors, sides: tuple[int, ...] = (-1, 1), turn: float = 0.0, speed: float = 12.0, **more: float
) -> Street:
    """At one speed, with nothing that tells wheels from gyro; a thing every two metres of each side, 4 to 14 m beside the way."""
    count, rng = round(seconds / STEP), np.random.default_rng(5)
    still = {"things": np.zeros((0, 2)), "one_signal": True}
    drive = Street(np.full(count, speed), np.full(count, turn), errors, 9, **still, **more)
    ahead = np.concatenate(
        (drive.way, drive.way[-1] + np.outer(np.arange(50), (math.cos(drive.way[-1, 2]), math.sin(drive.way[-1, 2]), 0.0)))
    )
    places = ahead[:: round(2.0 / speed / STEP)]
    beside = [rng.uniform(4.0, 14.0, len(places)) * side for side in sides]
    drive.things = np.concatenate(
        [places[:, :2] + off[:, None] * np.stack((-np.sin(places[:, 2]), np.cos(places[:, 2])), axis=1) for off in beside]
    )
    return drive


def told(drive: Street) -> ErrorFilter:
    return follow(drive, again=SeenAgain()).errors


def bias_of(errors: ErrorFilter) -> tuple[float, float]:
    """Value and sigma, rad/s."""
    return float(errors.mean[BIAS]), math.sqrt(errors.covariance[BIAS, BIAS])


def test_what_sightings_are_apart_is_what_the_errors_make_of_it() -> None:
    """Without noise, of a thing alone: what is left of a pair when the planted errors are taken off is of second order."""
    planted = Errors(0.004, 0.2 * DEGREE, 0.003, yaws=(0.3 * DEGREE, -0.4 * DEGREE, 0.2 * DEGREE, 0.5 * DEGREE))
    drive = street(12.0, planted, turn=0.1, speed=5.0, blur=0.0, bent=0.0)
    drive.things = np.array(((30.0, 14.0),))
    drive.wheels, drive.gyro = drive.speed / (1.0 + planted.scale), (drive.yaw_rate + planted.bias) / (1.0 + planted.turn_scale)
    again, errors = SeenAgain(), ErrorFilter(tuple(MOUNTS), "driving")
    errors.covariance[POSE:, POSE:] = 1e-12 * np.eye(len(errors.mean) - POSE)  # nothing is learned
    follow(drive, errors=errors, again=again)
    looks = list(again._looks)
    found = pairs(looks, len(looks))
    assert len(found.apart) > 50
    yaws = np.array(planted.yaws)[found.radars]
    left = (
        found.apart + planted.bias * found.by_bias + planted.turn_scale * found.by_turn + planted.scale * found.by_way + yaws * found.by_yaw
    )
    assert np.abs(found.apart).max() > 0.15
    assert np.abs(left).max() < 0.05 * np.abs(found.apart).max()


@pytest.mark.parametrize(("bias", "sides"), [(0.6, (-1, 1)), (-0.6, (-1, 1)), (0.6, (1,)), (-0.6, (-1,))])
def test_a_planted_bias_is_found_beside_a_planted_scale(bias: float, sides: tuple[int, ...]) -> None:
    """On a straight way at one speed, where wheels and Doppler tell nothing of it; mirrored, and with things on one side alone."""
    errors = told(street(20.0, Errors(0.01, bias * DEGREE, yaws=(0.01, 0.01, -0.01, 0.02)), sides))
    value, sigma = bias_of(errors)
    assert abs(value - bias * DEGREE) < 2.5 * sigma
    assert sigma < 0.2 * DEGREE
    assert errors.bias != 0.0


def test_movers_do_not_count() -> None:
    value, sigma = bias_of(told(street(15.0, Errors(bias=0.5 * DEGREE), moving=0.3)))
    assert abs(value - 0.5 * DEGREE) < 2.5 * sigma


def test_what_is_never_seen_again_teaches_nothing() -> None:
    """Detections anywhere, others in each scan: many pairs, all by chance."""
    count, told = round(6.0 / STEP), 0
    for seed in range(3):
        again, errors = SeenAgain(), ErrorFilter(tuple(MOUNTS))
        follow(
            Driven(np.full(count, 3.0), np.zeros(count), Errors(bias=0.5 * DEGREE), seed=seed, one_signal=True), errors=errors, again=again
        )
        found = pairs(list(again._looks), 10)
        assert len(found.apart) > 1000
        told += compared(found, errors) is not None
    assert told == 0


def test_it_averages_no_farther_than_to_what_is_off_in_all_batches_alike() -> None:
    found, errors = one_batch()
    while (told := compared(found, errors)) is not None:
        before = bias_of(errors)[1]
        errors.see(*told, (BIAS,))
        assert bias_of(errors)[1] < before
        if before - bias_of(errors)[1] < 1e-4 * before:
            break
    assert 0.9 * DISTORTED < bias_of(errors)[1] < 1.2 * DISTORTED


def test_wheel_scale_and_mounts_are_considered_and_not_moved() -> None:
    """A bias that is known as well as a wheel scale lets it be."""
    found, errors = one_batch()
    before = errors.mean.copy()
    told = compared(found, errors)
    assert told is not None
    assert told[0][SCALE, BIAS] != 0.0
    errors.see(*told, MOVES)
    moved = np.flatnonzero(errors.mean != before)
    assert BIAS in moved
    assert set(moved) <= set(MOVES)


def test_what_was_taken_off_is_put_back() -> None:
    """The same pairs are as far apart whatever was taken off the gyro on the way."""
    apart = []
    for known in (0.0, 0.2 * DEGREE):
        again, errors = SeenAgain(), ErrorFilter(tuple(MOUNTS))
        errors.mean[BIAS] = known
        errors.covariance[POSE:, POSE:] = 1e-12 * np.eye(len(errors.mean) - POSE)
        errors.recall(errors.keep(), same_drive=True)
        assert errors.bias == known
        drive = street(4.0, Errors(bias=0.2 * DEGREE), blur=0.0, bent=0.0)
        drive.things = np.array(((60.0, 8.0),))
        follow(drive, errors=errors, again=again)
        looks = list(again._looks)
        apart.append(pairs(looks, len(looks)).apart)
    assert np.abs(apart[0]).max() > 0.2
    np.testing.assert_allclose(np.abs(apart[0]), np.abs(apart[1]), atol=0.01)


def test_a_wheel_scale_that_the_places_have_is_not_expected_of_them_again() -> None:
    found, unknowing = one_batch()
    knowing = ErrorFilter(tuple(MOUNTS), "driving")
    knowing.mean[SCALE] = 0.01
    knowing.covariance[SCALE, SCALE] = 1e-8
    knowing.recall(knowing.keep(), same_drive=True)
    assert knowing.scale == pytest.approx(0.01)
    knowing.covariance[:] = unknowing.covariance
    one, other = compared(found, unknowing), compared(found, knowing)
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(one[0], other[0], rtol=1e-6)
    np.testing.assert_allclose(one[1], other[1], rtol=1e-6)


def test_pairs_in_sigmas_are_what_the_roots_of_their_covariances_make_of_them() -> None:
    found, _ = one_batch()
    slope, left, density = _whitened(found, 7)
    count = len(found.apart)
    for n in range(0, count, 50):
        xx, xy, yy = found.covariances[:, n]
        covariance = np.array(((xx, xy), (xy, yy)))
        root = np.linalg.cholesky(covariance)
        assert density[n] == pytest.approx(1.0 / (2.0 * math.pi * math.sqrt(np.linalg.det(covariance))))
        yaws = [found.by_yaw[n] * (radar == found.radars[n]) for radar in range(4)]
        for column, value in enumerate((found.by_bias[n], found.by_turn[n], found.by_way[n], *yaws)):
            np.testing.assert_allclose(root @ slope[[n, n + count], column], (value.real, value.imag), atol=1e-9)
        np.testing.assert_allclose(root @ left[[n, n + count]], (found.apart[n].real, found.apart[n].imag), atol=1e-9)


@pytest.mark.parametrize("known", [1e3, 1e6, 1e9])
def test_what_is_off_in_all_batches_alike_adds_to_the_variance(known: float) -> None:
    """With it a batch can say no more than that one share: 1 / sigma² grows to 1 / DISTORTED² and no farther."""
    sigma = 0.3 * DEGREE
    told = _of_bias_alone(np.diag((known, 0.0)), np.array((known * 0.002, 0.0)), np.array((sigma, 1.0)), np.array((1, 2)), 4)
    assert told is not None
    differs = 1.0 / DISTORTED**2 - 1.0 / sigma**2
    expected = 1.0 / (1.0 / known + 1.0 / differs)
    assert told[0][1, 1] == pytest.approx(expected, rel=1e-6)
    assert told[1][1] == pytest.approx(expected * 0.002, rel=1e-6)
    assert np.count_nonzero(told[0]) == 1
    assert _of_bias_alone(np.eye(2), np.ones(2), np.array((DISTORTED, 1.0)), np.array((1, 2)), 4) is None


def test_looks_that_are_too_old_to_be_compared_are_forgotten() -> None:
    again = SeenAgain()
    follow(street(13.0, Errors(), (1,)), again=again)
    assert len(again._looks) > BATCH
    assert again._looks[-1].stamp_ns - again._looks[0].stamp_ns <= LATEST_NS + BATCH * PERIOD_NS


def one_batch() -> tuple[Pairs, ErrorFilter]:
    """Pairs of a street, and a filter that knows nothing of the car."""
    again, errors = SeenAgain(), ErrorFilter(tuple(MOUNTS), "driving")
    quiet = ErrorFilter(tuple(MOUNTS), "driving")
    quiet.covariance[POSE:, POSE:] = 1e-12 * np.eye(len(quiet.mean) - POSE)
    follow(street(6.0, Errors(bias=0.4 * DEGREE)), errors=quiet, again=again)
    looks = list(again._looks)
    return pairs(looks, 10), errors
