"""The state of the map: whether it can be trusted now, and why not. Judged by what passes through the chain, never by a clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from statistics import median
from typing import Literal

import numpy as np

from echogrid.core.health import SensorHealth
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import IDENTITY
from echogrid.core.radar.doppler_motion import doppler_motion
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.radar.sweep import Sweep
from echogrid.core.trust.motion_watch import MotionWatch
from echogrid.core.trust.mount_check import other_mount
from echogrid.core.trust.radar_watch import AGREEING, FAST, LONGEST_STEP, NS, RadarWatch

STALE_NS = 1_000_000_000  # without a map update
QUIET_NS = 500_000_000  # without anything at all
FEW, ENOUGH, OTHERS = 0.15, 0.3, 0.5  # of the usual detections: below FEW a radar is blind if the others have OTHERS, until ENOUGH
ODD, FINE = 0.3, 0.5  # share of detections that fit ego motion: below ODD a radar is at odds with it, from FINE on no longer
COULD_SEE = 30.0  # detections that a radar missed where others, or itself before, had measured something: then it is blind
KNOWN_NS = 3_000_000_000  # over which such places are remembered
EXPLAINS = 0.5  # share that another mount must explain: what sees nothing but traffic is not mounted wrong
WIDE = 0.25  # rad of spread that azimuths must have: traffic ahead, as fast as the car, looks like things abeam


@dataclass(frozen=True, slots=True)
class State:
    """`ok`: the map is right. `degraded`: right, but made from fewer data. `no_motion`: not updated, since the car's motion is not known.
    `stale`: there is no map, or it was not updated recently. `stopped`: the service has ended.

    `reasons`: short sentences; none where the state is ok.
    """

    name: Literal["ok", "degraded", "no_motion", "stale", "stopped"]
    reasons: tuple[str, ...] = ()


class Watch:
    """Remembers what is needed to judge each radar and ego motion, and when the map was updated last.

    `state` may be called from another thread.
    """

    def __init__(self, mounts: Mapping[str, Mount], sensors: Mapping[str, SensorHealth], noise: GateNoise) -> None:
        """The radars' mounts and counters by name, and the gate that tells what is static."""
        self.radars = {name: RadarWatch(mount, sensors[name]) for name, mount in mounts.items()}
        self.motion = MotionWatch()
        self.noise = noise
        self.mapped_ns: int | None = None  # receipt of the newest scan in the map
        self.why_empty: str | None = None  # why a new map was started
        self._judged_ns: int | None = None
        self._known: deque[Sweep] = deque()  # of the last seconds

    def judge(self, sweep: Sweep) -> None:
        """One cycle's scans: `motion.disputed` and the radars' `doubts` follow."""
        newest = sweep.newest
        for one in sweep.placed:
            self.radars[one.scan.sensor].look(one.scan, one.ego.speed)
        step = 0.0 if self._judged_ns is None else min(max((newest.stamp_ns - self._judged_ns) * NS, 0.0), LONGEST_STEP)
        self._judged_ns = newest.stamp_ns
        asked, standing = sweep.agreeing
        are_trusted = [not self.radars[one.scan.sensor].doubts for one in sweep.placed]
        are_trusted = are_trusted if any(are_trusted) else [True] * len(are_trusted)
        support = sum(compress(standing, are_trusted)) / max(sum(compress(asked, are_trusted)), 1)
        seen = doppler_motion(sweep.only(are_trusted, self.noise))
        if not self.motion.compare(newest.stamp_ns, newest.speed, newest.yaw_rate, support, seen):
            self._compare_with_motion(sweep, standing, asked, step)
        self._compare_with_each_other(sweep)
        self._remember(sweep)

    def _compare_with_motion(self, sweep: Sweep, standing: Sequence[int], asked: Sequence[int], step: float) -> None:
        """`standing` of the `asked` detections of each scan fit ego motion, `step` s after the last."""
        fading = math.exp(-step / AGREEING)
        for one, fitting, count in zip(sweep.placed, standing, asked, strict=True):
            if -FAST < one.ego.speed < FAST:
                continue
            radar = self.radars[one.scan.sensor]
            share = radar.agree(fitting, count, fading)
            if share is not None and share >= FINE:
                if radar.doubts:
                    radar.doubt("odd", None)
            elif share is not None and share < ODD:
                self._ask_for_another_mount(radar, one, share)

    def _ask_for_another_mount(self, radar: RadarWatch, one: PlacedScan, share: float) -> None:
        near = one.scan.chosen(one.scan.range <= one.mount.max_range)
        if not len(near) or float(np.std(near.azimuth)) <= WIDE:
            return
        other = other_mount(near, one.mount, one.ego, self.noise)
        would = [f"swapped, or mounted at yaw {other.yaw_deg:.0f}° ({other.share:.0%})"] if other.share >= EXPLAINS else []
        would += [f"azimuths reversed ({other.reversed_share:.0%})"] if other.reversed_share >= EXPLAINS else []
        if would:
            radar.doubt("odd", f"at odds with ego motion ({share:.0%} of its detections fit): {', or '.join(would)}")

    def _compare_with_each_other(self, sweep: Sweep) -> None:
        """A radar is blind if it misses what it could have seen: few detections beside an open field are no fault."""
        for one in sweep.placed:
            radar = self.radars[one.scan.sensor]
            if radar.sees > ENOUGH:
                radar.missed = 0.0
                if radar.doubts:
                    radar.doubt("blind", None)
                continue
            others = [other.sees for name, other in self.radars.items() if name != one.scan.sensor]
            if radar.sees < FEW and others and median(others) > OTHERS:
                radar.missed += min(radar.usual, self._in_view(one))
                if radar.missed > COULD_SEE:
                    seen = f"it sees {radar.sees:.0%} of its usual detections"
                    radar.doubt("blind", f"blocked: {seen}, the other radars see theirs")

    def _in_view(self, one: PlacedScan) -> float:
        """How many detections a scan from here might have, by what lay in its field of view in the scans of the last seconds."""
        if not self._known:
            return 0.0
        points = np.concatenate([self._static(sweep) for sweep in self._known])
        in_view = np.count_nonzero(one.mount.sees(one.ego.odom_from_base.inverse().apply(points)))
        return in_view * len(self.radars) / sum(len(sweep.placed) for sweep in self._known)

    def _static(self, sweep: Sweep) -> Floats:
        """(N, 2) m in odom, where static detections lie."""
        points, *_ = sweep.placed_at(IDENTITY)
        return points[sweep.stands(self.noise.sigmas)]

    def _remember(self, sweep: Sweep) -> None:
        self._known.append(sweep)
        while sweep.newest.stamp_ns - self._known[0].newest.stamp_ns > KNOWN_NS:
            self._known.popleft()

    def restart(self, why: str) -> None:
        """A new map is started."""
        self.mapped_ns = None
        self.why_empty = why
        self._judged_ns = None
        self._known.clear()
        self.motion.restart()
        for radar in self.radars.values():
            radar.restart()

    def state(self, now_ns: int) -> State:
        """At a time of the traffic: the newest frame's stamp and what has passed since."""
        heard = [radar.heard_ns for radar in self.radars.values()] + [self.motion.speed.last_ns, self.motion.yaw_rate.last_ns]
        newest_ns = max((ns for ns in heard if ns is not None), default=None)
        lost, noted = self.motion.lost(now_ns), self.motion.noted(now_ns)
        radars = [f"radar {name}: {reason}" for name, radar in self.radars.items() for reason in radar.reasons(now_ns)]
        mapped_ns = self.mapped_ns
        if mapped_ns is None:
            why = "no map yet" if self.why_empty is None else f"no map yet: a new map was started, {self.why_empty}"
            return State("stale", (why, *lost, *radars))
        if newest_ns is None or now_ns - newest_ns > QUIET_NS:
            return State("stale", (f"nothing received for {(now_ns - (newest_ns or mapped_ns)) * NS:.1f} s",))
        if lost:
            return State("no_motion", (*lost, *radars))
        if now_ns - mapped_ns > STALE_NS:
            return State("stale", (f"no map update for {(now_ns - mapped_ns) * NS:.1f} s", *noted, *radars))
        reasons = (*noted, *radars)
        return State("degraded" if reasons else "ok", reasons)
