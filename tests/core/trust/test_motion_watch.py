"""What disputes ego motion, and when that ends."""

from __future__ import annotations

import re

import pytest

from echogrid.core.messages import Speed, YawRate
from echogrid.core.radar.doppler_motion import DopplerMotion
from echogrid.core.trust.motion_watch import FASTEST, NOTED_NS, TURNING, MotionWatch, Verdict

STEP_NS = 50_000_000


def drive(watch: MotionWatch, begin: int, steps: int, wheels: float, radars: float) -> list[str | None]:
    """What is disputed after each of so many comparisons, 50 ms apart."""
    said = []
    for n in range(begin, begin + steps):
        watch.judge(Speed(n * STEP_NS, wheels))
        watch.judge(YawRate(n * STEP_NS, 0.0))
        watch.compare(n * STEP_NS, wheels, 0.0, 0.2, DopplerMotion(radars, 0.0, 0.9))
        said.append(watch.disputed)
    return said


def test_a_dispute_ends_where_both_say_that_the_car_stands() -> None:
    watch = MotionWatch()
    assert drive(watch, 0, 40, 3.0, 6.0)[-1] == "wheel speed: is stuck at 3.00 m/s, the radars measure 6.00 m/s"
    assert drive(watch, 40, 1, 0.0, 0.02) == [None]
    assert drive(watch, 41, 40, 0.0, 0.0) == [None] * 40


def test_the_reason_tells_values_that_differ() -> None:
    """On average they still do, for a while, when they agree again: never is it said that 6.00 is not 6.00."""
    watch = MotionWatch()
    said = [*drive(watch, 0, 40, 6.0, 3.0), *drive(watch, 40, 60, 6.0, 6.05)]
    assert said[40] is not None
    assert said[-1] is None
    for sentence in filter(None, said):
        one, other = map(float, re.findall(r"(-?[0-9.]+) m/s", sentence))
        assert abs(one - other) > 0.5, sentence


def test_wheels_that_read_0_while_the_car_moves_stay_disputed() -> None:
    watch = MotionWatch()
    assert drive(watch, 0, 60, 0.0, 3.0)[-1] == "wheel speed: is stuck at 0.00 m/s, the radars measure 3.00 m/s"


def test_a_second_sample_of_the_same_time_is_old() -> None:
    watch = MotionWatch()
    verdicts = [watch.judge(Speed(time_ns, 5.0)) for time_ns in (STEP_NS, STEP_NS, STEP_NS - 1, STEP_NS + 1)]
    assert verdicts == [Verdict.GOOD, Verdict.OLD, Verdict.OLD, Verdict.GOOD]


def test_what_differs_by_more_than_is_too_much_is_disputed_whether_stuck_or_not() -> None:
    """Of wheels at 10 m/s 0.5 m/s and 5 % are too much: 1.0 m/s. They go up and down by a hair, as wheels that work do."""
    for off, is_disputed in ((0.9, False), (1.15, True)):
        watch = MotionWatch()
        for n in range(120):
            wheels = 10.0 + 0.001 * (n % 2)
            watch.judge(Speed(n * STEP_NS, wheels))
            watch.judge(YawRate(n * STEP_NS, 0.001 * (n % 2)))
            watch.compare(n * STEP_NS, wheels, 0.0, 0.2, DopplerMotion(wheels + off, 0.0, 0.9))
        assert (watch.disputed is not None) is is_disputed, off


def test_an_implausible_sample_is_noted_for_a_second() -> None:
    watch = MotionWatch()
    for n in range(3):
        watch.judge(Speed(n * STEP_NS, 5.0))
    assert watch.noted(2 * STEP_NS) == []
    assert watch.judge(Speed(3 * STEP_NS, 60.0)) is Verdict.IMPLAUSIBLE
    assert watch.noted(3 * STEP_NS + NOTED_NS) == ["wheel speed: jumps to 60.0 m/s"]
    assert watch.noted(3 * STEP_NS + NOTED_NS + 1) == []


def test_five_samples_in_a_row_that_are_not_newer_are_a_clock_set_back() -> None:
    watch = MotionWatch()
    times = (1.0, 0.9, 0.95, 0.9, 0.8, 1.01, 0.5, 0.51, 0.52, 0.53, 0.54)
    verdicts = [watch.judge(Speed(round(seconds * 1e9), 5.0)) for seconds in times]
    assert verdicts == [Verdict.GOOD, *[Verdict.OLD] * 4, Verdict.GOOD, *[Verdict.OLD] * 4, Verdict.BACK]


def test_the_greatest_plausible_values_are_plausible() -> None:
    for value, verdict in ((FASTEST, Verdict.GOOD), (-FASTEST - 0.01, Verdict.IMPLAUSIBLE)):
        assert MotionWatch().judge(Speed(STEP_NS, value)) is verdict
    for value, verdict in ((-TURNING, Verdict.GOOD), (TURNING + 0.01, Verdict.IMPLAUSIBLE)):
        assert MotionWatch().judge(YawRate(STEP_NS, value)) is verdict


@pytest.mark.parametrize(
    ("wheels", "gyro", "seen", "differ"),
    [
        (10.0, 0.0, None, False),
        (10.0, 0.0, DopplerMotion(15.0, 0.0, 0.4), False),  # few support it
        (10.0, 0.0, DopplerMotion(15.0, 0.0, 0.9, 0.05), False),  # all ahead
        (10.0, 0.0, DopplerMotion(15.0, 0.0, 0.6), False),  # by five times as much as is too much, and half as many again do not say so
        (10.0, 0.0, DopplerMotion(15.0, 0.0, 0.9), True),
        (10.0, 0.0, DopplerMotion(10.9, 0.0, 0.9), False),  # 0.5 m/s and 5 % are too much
        (10.0, 0.0, DopplerMotion(8.9, 0.0, 0.9), True),
        (10.0, 0.1, DopplerMotion(10.0, 0.29, 0.9), False),  # 0.2 rad/s is
        (10.0, 0.1, DopplerMotion(10.0, -0.11, 0.9), True),
        (0.0, 0.0, DopplerMotion(0.1, 0.0, 0.9), False),  # both stand
        (0.0, 0.0, DopplerMotion(1.1, 0.0, 0.9), False),  # wheels may read 0 up to 1.2 m/s
        (0.0, 0.0, DopplerMotion(1.3, 0.0, 0.9), True),
    ],
)
def test_a_comparison_tells_whether_the_two_differ_too_much_now(
    wheels: float, gyro: float, seen: DopplerMotion | None, differ: bool
) -> None:
    """Of 0.5 of the detections that fit the wheels."""
    assert MotionWatch().compare(STEP_NS, wheels, gyro, 0.5, seen) is differ
