"""Where odom lies by poses from outside, against truth and dead reckoning in complex numbers; and poses that are none."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import asdict
from itertools import pairwise

import pytest
from tests.support.driven import STEP, Driven, Errors, town

from echogrid.core.health import PoseHealth
from echogrid.core.messages import PoseFix, Speed, YawRate
from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.core.motion.map_frame import STATES, MapFrame
from echogrid.core.motion.odometry import Odometry
from echogrid.core.motion.se2 import IDENTITY, SE2

WORLD = SE2(4321.0, -765.0, 2.5)  # where the drive begins in the map frame
BIASED = Driven(*town(60.0), Errors(scale=0.01, bias=math.radians(0.5)))
Change = Callable[[int, PoseFix], list[PoseFix]]  # what is heard of the n-th pose


def true_pose(n: int, point: SE2 = IDENTITY) -> SE2:
    """Of a point of the car in the map frame, by complex numbers."""
    x, y, yaw = BIASED.way[n]
    place = complex(WORLD.x, WORLD.y) + cmath.rect(1, WORLD.yaw) * complex(x, y)
    yaw += WORLD.yaw
    place += cmath.rect(1, yaw) * complex(point.x, point.y)
    return SE2(place.real, place.imag, yaw + point.yaw)


def drive(
    frame: MapFrame,
    change: Change = lambda n, fix: [fix],
    *,
    point: SE2 = IDENTITY,
    every: int = 5,
    late: int = 0,
    until: int | None = None,
) -> tuple[Odometry, list[tuple[int, SE2, SE2 | None]]]:
    """The biased drive with a pose every so many samples, heard `late` samples after its time. After each cycle: the sample of the newest
    pose that was measured, dead reckoning at that sample, and map_from_odom."""
    odometry, found, way = Odometry(ErrorFilter((), "never")), list[tuple[int, SE2, SE2 | None]](), list[SE2]()
    for n, time in enumerate(BIASED.time[:until]):
        odometry.add(Speed(round(time * 1e9), float(BIASED.wheels[n])))
        odometry.add(YawRate(round(time * 1e9), float(BIASED.gyro[n])))
        way.append(odometry.states[-1].odom_from_base)
        measured = n - late
        if measured >= 0 and measured % every == 0:
            true, stamp_ns = true_pose(measured, point), round(BIASED.time[measured] * 1e9)
            for fix in change(measured, PoseFix(stamp_ns, true.x, true.y, stamp_ns, true.yaw)):
                frame.add(fix)
        if n % 2 == 0:
            frame.settle(odometry)
            heard = max(measured - measured % every, 0)
            found.append((heard, way[heard], frame.map_from_odom))
    return odometry, found


@pytest.mark.parametrize("late", [0, 3, 40])
@pytest.mark.parametrize("point", [IDENTITY, SE2(1.2, -0.4, math.radians(90.0))], ids=["base", "a lever and a turn"])
def test_it_is_truth_times_the_inverse_of_dead_reckoning(late: int, point: SE2) -> None:
    frame = MapFrame(point, PoseHealth())
    odometry, found = drive(frame, point=point, late=late)
    far = []
    for n, ours, told in found:
        if n < 5:
            continue
        true = true_pose(n)
        turn = cmath.rect(1, true.yaw - ours.yaw)
        origin = complex(true.x, true.y) - turn * complex(ours.x, ours.y)
        assert told is not None
        assert abs(complex(told.x, told.y) - origin) < 1e-6
        assert abs(cmath.phase(cmath.rect(1, told.yaw) / turn)) < 1e-9
        far.append(abs(origin - complex(WORLD.x, WORLD.y)))
    assert max(far) > 10.0  # dead reckoning alone would be off by more than any map can take
    assert frame.counts.taken == -(-(len(BIASED.time) - late) // 5)
    assert frame.state(odometry.states[-1].stamp_ns) == ("ok", "")


def test_place_and_heading_of_different_times_fit_together() -> None:
    """In a bend of 20°/s a heading that is 0.4 s older would be off by 8° if it were taken for that of the place's time."""

    def older(n: int, fix: PoseFix) -> list[PoseFix]:
        if n < 20:
            return []
        true = true_pose(n - 20)
        return [PoseFix(fix.stamp_ns, fix.x, fix.y, round(BIASED.time[n - 20] * 1e9), true.yaw)]

    together, apart = MapFrame(IDENTITY, PoseHealth()), MapFrame(IDENTITY, PoseHealth())
    pairs = zip(drive(together)[1], drive(apart, older)[1], strict=True)
    both = [(ours, one, other) for (_, ours, one), (*_, other) in pairs if one is not None and other is not None]
    assert len(both) > 1000
    for ours, one, other in both:  # at the car: odom's origin is up to 300 m away
        assert math.dist(*(((at @ ours).x, (at @ ours).y) for at in (one, other))) < 1e-6
        assert abs(one.yaw - other.yaw) < math.radians(1.0)  # what the bias makes of 0.4 s, and the turn of the gyro's own lag


def test_what_is_old_late_of_another_clock_or_far_off_moves_nothing() -> None:
    def disturbed(n: int, fix: PoseFix) -> list[PoseFix]:
        match n // 5 % 6:
            case 1:
                return [fix, fix]  # twice
            case 2:
                return [PoseFix(fix.stamp_ns - 10, fix.x + 0.5, fix.y, fix.yaw_ns, fix.yaw), fix] if n < 1500 else []
            case 3:
                return [PoseFix(fix.stamp_ns - 5_000_000_000, fix.x, fix.y, fix.yaw_ns - 5_000_000_000, fix.yaw)]
            case 4:
                return [PoseFix(fix.stamp_ns + 3_600_000_000_000, fix.x, fix.y, fix.yaw_ns, fix.yaw)]
            case 5:
                return [PoseFix(fix.stamp_ns, fix.x + 30.0, fix.y, fix.yaw_ns, fix.yaw)] if n > 300 else []
        return [fix]

    frame = MapFrame(IDENTITY, PoseHealth())
    _, found = drive(frame, disturbed)
    off = []
    for n, ours, told in found[20:]:
        true, here = true_pose(n), (told or IDENTITY) @ ours
        off.append(math.hypot(here.x - true.x, here.y - true.y))
    assert max(off) < 1.2  # the one that is half a metre off is believed: how should it be known? And half a second of drift
    counts = frame.counts
    assert (counts.moved, counts.invalid) == (0, 0)
    assert counts.old >= 190
    assert counts.untimely >= 90
    assert counts.jumped >= 90


def test_a_heading_that_jumps_is_not_believed_either() -> None:
    frame = MapFrame(IDENTITY, PoseHealth())
    turned = lambda n, fix: [PoseFix(fix.stamp_ns, fix.x, fix.y, fix.yaw_ns, fix.yaw + (0.2 if n % 50 == 45 else 0.0))]  # noqa: E731
    _, found = drive(frame, turned)
    assert frame.counts.jumped == len(BIASED.time) / 50
    assert max(abs(one.yaw - other.yaw) for (*_, one), (*_, other) in pairwise(found) if one and other) < 0.05


def test_poses_that_stay_elsewhere_are_believed_after_a_second() -> None:
    """A receiver that comes back from a tunnel and was wrong before: the frame may jump, REP-105 says so."""
    frame = MapFrame(IDENTITY, PoseHealth())
    moved = lambda n, fix: [PoseFix(fix.stamp_ns, fix.x + (12.0 if n >= 1000 else 0.0), fix.y, fix.yaw_ns, fix.yaw)]  # noqa: E731
    seen: list[tuple[str, str]] = []

    def watched(n: int, fix: PoseFix) -> list[PoseFix]:
        if n == 1030:
            seen.append(frame.state(fix.stamp_ns))
        return moved(n, fix)

    _, found = drive(frame, watched)
    assert frame.counts.moved == 1
    assert frame.counts.jumped == 10
    ((name, why),) = seen
    assert name == "jumping"
    assert float(why.removesuffix(" m off dead reckoning")) == pytest.approx(12.0, abs=1.0)
    at = {n: (told @ ours, true_pose(n)) for n, ours, told in found if told is not None}
    off = {n: (here.x - true.x, here.y - true.y) for n, (here, true) in at.items()}
    assert off[995] == pytest.approx((0.0, 0.0), abs=1e-6)
    assert off[1045] == pytest.approx((0.0, 0.0), abs=0.5)  # not yet, but dead reckoning has drifted
    assert off[1055] == pytest.approx((12.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("every", [1, 5, 50])
def test_a_receiver_that_stands_while_the_car_drives_is_not_believed(every: int) -> None:
    """However often it says so: each pose differs from the last by less than any noise."""
    begin, end = 1000, 1300

    def stands(n: int, fix: PoseFix) -> list[PoseFix]:
        true = true_pose(min(n, begin))
        return [PoseFix(fix.stamp_ns, true.x, true.y, fix.yaw_ns, true.yaw)]

    frame = MapFrame(IDENTITY, PoseHealth())
    odometry, found = drive(frame, stands, every=every, until=end)
    off = []
    for n, ours, told in found:
        if told is not None:
            here, true = told @ ours, true_pose(n)
            off.append(math.hypot(here.x - true.x, here.y - true.y))
    assert max(off) < 4.5  # what it takes to notice, and the drift of six seconds
    assert frame.counts.moved == 0
    assert frame.counts.jumped > 250 / every - 2
    assert frame.state(odometry.states[-1].stamp_ns)[0] == "jumping"


@pytest.mark.parametrize("silent", [1.5, 20.0])
def test_silence_is_said_and_the_last_frame_stays(silent: float) -> None:
    """And the first pose after it is believed, as far as dead reckoning may have drifted meanwhile."""
    begin, end = 1000, 1000 + round(silent / STEP)
    frame = MapFrame(IDENTITY, PoseHealth())
    drive(frame, lambda n, fix: [fix] if n < begin else [], until=end)
    stamp_ns = round(BIASED.time[end - 1] * 1e9)
    name, why = frame.state(stamp_ns)
    assert (name, why) == ("silent", f"none for {(stamp_ns - BIASED.time[995] * 1e9) * 1e-9:.1f} s")
    assert frame.map_from_odom is not None
    whole = MapFrame(IDENTITY, PoseHealth())
    drive(whole, lambda n, fix: [] if begin <= n < end else [fix], until=end + 20)
    assert (whole.counts.jumped, whole.counts.moved) == (0, 0)


def test_a_clock_that_is_off_is_named() -> None:
    for off, says in ((-7.2, "behind"), (7.2, "ahead of")):
        frame = MapFrame(IDENTITY, PoseHealth())
        off_ns = round(off * 1e9)
        shifted = lambda n, fix, ns=off_ns: [PoseFix(fix.stamp_ns + ns, fix.x, fix.y, fix.yaw_ns + ns, fix.yaw)]  # noqa: E731
        odometry, _ = drive(frame, shifted, until=500)
        name, why = frame.state(odometry.states[-1].stamp_ns)
        assert name == "waiting"
        assert why == f"none in this map so far: its times are 7.2 s {says} the car's"
        assert asdict(frame.counts) == asdict(PoseHealth(untimely=100))


def test_another_map_begins_without_a_frame() -> None:
    frame = MapFrame(IDENTITY, PoseHealth())
    odometry, _ = drive(frame, until=500)
    assert frame.map_from_odom is not None
    odometry.restart()
    frame.restart()
    assert frame.map_from_odom is None
    assert frame.state(10**10)[0] == "waiting"
    assert {"ok", "waiting", "jumping", "silent"} == set(STATES)
    frame.settle(odometry)  # with no pose of the car there is nothing to place
    frame.add(PoseFix(10**10, 1.0, 2.0, 10**10, 0.0))
    frame.settle(odometry)
    assert frame.map_from_odom is None


def test_of_a_car_that_stood_for_minutes_a_jump_is_still_one() -> None:
    """Dead reckoning does not drift while the wheels stand; a pose 3 m off, or turned by 10°, is no more likely than before."""
    for x, yaw in ((3.0, 0.0), (0.0, math.radians(10.0))):
        frame, odometry = MapFrame(IDENTITY, PoseHealth()), Odometry(ErrorFilter((), "never"))
        for n in range(2000):
            stamp_ns, speed = n * 100_000_000, 5.0 if n < 100 else 0.0
            odometry.add(Speed(stamp_ns, speed))
            odometry.add(YawRate(stamp_ns, 0.0))
            place = odometry.states[-1].odom_from_base
            frame.add(PoseFix(stamp_ns, place.x, place.y, stamp_ns, place.yaw))
            frame.settle(odometry)
        assert frame.counts.jumped == 0
        stamp_ns += 50_000_000
        odometry.add(Speed(stamp_ns, 0.0))
        frame.add(PoseFix(stamp_ns - 1, place.x + x, place.y, stamp_ns - 1, place.yaw + yaw))
        frame.settle(odometry)
        assert frame.counts.jumped == 1


@pytest.mark.parametrize(("off", "believed"), [(5.0, True), (7.0, False)])
def test_after_a_silence_a_pose_may_be_as_far_off_as_dead_reckoning_drifts(off: float, believed: bool) -> None:
    """45 m and 4.5 s after the pose that it is compared with: 2 m, 5 % of the way, and 1°/s meanwhile, half of it sideways: 6.0 m."""
    frame, odometry = MapFrame(IDENTITY, PoseHealth()), Odometry(ErrorFilter((), "never"))
    for n in range(141):
        stamp_ns = n * 50_000_000
        odometry.add(Speed(stamp_ns, 10.0))
        odometry.add(YawRate(stamp_ns, 0.0))
        if n <= 60 or n == 140:  # 3 s, silence for 4 s, one more
            frame.add(PoseFix(stamp_ns, 0.5 * n, off * (n == 140), stamp_ns, 0.0))
        frame.settle(odometry)
    assert (frame.counts.taken, frame.counts.jumped) == ((62, 0) if believed else (61, 1))
