"""Whether one radar is trusted: by what it said before, by what the others see, and by how the car moves."""

from __future__ import annotations

import math
from operator import attrgetter

import numpy as np

from echogrid.core.health import SensorHealth
from echogrid.core.kernels.dispatch import loops
from echogrid.core.messages import RadarScan
from echogrid.core.radar.mount import Mount

NS = 1e-9
SILENT_NS = 500_000_000
WINDOW_NS = 2_000_000_000  # over which scans are counted
SCARCE = 0.7  # of its usual scans in a window: fewer are spoken of
REPEATED = 4  # detections that equal those of the scan before, while the car moves: the radar is frozen
MOVING, FAST = 0.5, 2.0  # m/s: from where on a scan must differ from the last; from where on a wrong mount shows
BLIND = 0.5  # blockage as the sensor reports it
USUAL, SHORT, AGREEING = 60.0, 0.8, 1.0  # s that the means remember: what is usual, detections now, agreement with ego motion
SETTLED = 5.0  # s after which something is usual
FORGIVEN = 30.0  # s after which a lag is taken for usual
LONGEST_STEP = 0.2  # s between two scans that a mean is moved by
WILD = 0.1  # share of its detections that cannot be true
BEYOND_VIEW, FASTEST_RATE = 0.1, 75.0  # rad outside its field of view, m/s: what is beyond no radar sees, and no road
AGE_SHIFT = 0.06  # s off the usual age of its scans: they are not from when they say
EVIDENCE = 50.0  # detections, fading, before a share of them is judged
OF_A_SCAN = ("frozen", "blocked", "shifted", "lags")  # doubts that a scan alone begins and ends
LOSSES = {
    "incomplete": "incomplete scans",
    "late": "late scans",
    "bad_crc": "wrong checksums",
    "repeated": "repeated frames",
    "wrong_cycle": "frames of a wrong cycle",
}
_counters = attrgetter("complete", *LOSSES)  # of a sensor's health
SCANS = 4  # the first of them: complete scans, and those that were lost
Counts = tuple[int, ...]


class RadarWatch:
    """Remembers a radar's last scan and the means of what it says.

    `doubts` has a sentence for each fault that makes its scans worthless; while there is one, they are left out of the map.
    """

    def __init__(self, mount: Mount, health: SensorHealth) -> None:
        self.mount = mount
        self.health = health
        self.doubts: dict[str, str] = {}
        self.heard_ns: int | None = None  # receipt of the newest complete scan
        self.scarce: str | None = None  # a sentence where scans are missing of late
        self.missed = 0.0  # detections that it could have had while it saw next to nothing
        self.sees = 1.0  # its detections of the last second, as a share of the usual
        self._heard: Counts = _counters(health)  # counters at `heard_ns`
        self._window = self._heard  # and when the running window began
        self._window_ns: int | None = None
        self._longest_ns = 0  # silence in the running window, which is spoken of while it lasts
        self._lost = self._lost_then = 0  # scans lost in the running window but for that silence, and in it
        self._usual_rate = 0.0  # complete scans in a second
        self._last: RadarScan | None = None
        self._repeated = 0
        self._watched = 0.0  # s
        self._usual_age: float | None = None
        self._usual_lag: float | None = None
        self._usual_count = self._count = 0.0
        self._wild = 0.0  # share of its detections of late that cannot be true
        self._asked_of: RadarScan | None = None
        self._answer = 0
        self._agreeing = self._asked = 0.0  # detections, fading

    def hear(self, scan: RadarScan) -> None:
        """A complete scan has come: counts what was lost around it, and what in it cannot be true."""
        now_ns = scan.received_ns
        away_ns = 0 if self.heard_ns is None else now_ns - self.heard_ns
        step = LONGEST_STEP if self.heard_ns is None else min((now_ns - self.heard_ns) * NS, LONGEST_STEP)
        count = len(scan)
        wild = 1.0 - self._possible(scan) / count if count else 0.0
        self._wild += (wild - self._wild) * (1.0 - math.exp(-step / SHORT))
        if not WILD / 2 < self._wild < WILD:
            self.doubt("wild", f"broken: {self._wild:.0%} of its values are out of range" if self._wild >= WILD else None)
        before, self.heard_ns, self._heard = self._heard, now_ns, _counters(self.health)
        if self._window_ns is None:
            self._begin_window(now_ns)
            return
        lost = max(sum(self._heard[1:SCANS]) - sum(before[1:SCANS]), scan.missed)
        if away_ns > max(self._longest_ns, SILENT_NS):
            self._longest_ns, self._lost_then, lost = away_ns, lost, self._lost_then
        self._lost += lost
        seconds = (now_ns - self._window_ns - self._longest_ns) * NS
        if seconds >= WINDOW_NS * NS:
            complete = self._heard[0] - self._window[0]
            share = complete / max(self._usual_rate * seconds, complete + self._lost)
            self.scarce = f"only {share:.0%} of its scans come whole{self._losses(self._window)}" if share < SCARCE else None
            if self.scarce is None:
                self._usual_rate = max(complete / seconds, 0.9 * self._usual_rate)
            self._begin_window(now_ns)

    def _begin_window(self, now_ns: int) -> None:
        self._window_ns, self._window = now_ns, self._heard
        self._longest_ns = self._lost = self._lost_then = 0

    def look(self, scan: RadarScan, speed: float) -> None:
        """A scan that was placed, with its detections at any distance, and the car's speed."""
        step = 0.0 if self._last is None else min((scan.stamp_ns - self._last.stamp_ns) * NS, LONGEST_STEP)
        found = dict[str, str]()
        if self._is_frozen(scan, speed):
            found["frozen"] = "frozen: it repeats one scan while the car moves"
        if scan.blockage >= BLIND:
            found["blocked"] = f"blocked: it says so itself ({scan.blockage:.0%})"
        age = (scan.received_ns - scan.stamp_ns) * NS
        off = 0.0 if self._usual_age is None else age - self._usual_age
        if not -AGE_SHIFT <= off <= AGE_SHIFT:
            found["shifted"] = f"shifted in time: its scans are {abs(off) * 1e3:.0f} ms {'older' if off > 0 else 'younger'} than usual"
        self._usual_lag = scan.lag if self._usual_lag is None else self._usual_lag
        lag = scan.lag - self._usual_lag
        self._usual_lag += lag * step / FORGIVEN  # a sender that restarted is trusted again after a while
        if not -AGE_SHIFT <= lag <= AGE_SHIFT:
            late = f"{abs(lag) * 1e3:.0f} ms {'later' if lag > 0 else 'earlier'}"
            found["lags"] = f"shifted in time: its scans come {late} than their counter says"
        if found or self.doubts:
            for fault in OF_A_SCAN:
                self.doubt(fault, found.get(fault))
        self._last = scan
        self._watched += step
        usual = step / min(max(self._watched, 1e-3), USUAL)  # a plain mean at first
        if "shifted" not in found:
            self._usual_age = age if self._usual_age is None else self._usual_age + off * usual
        possible = self._possible(scan)
        self._count += (possible - self._count) * (1.0 - math.exp(-step / SHORT))
        if "blind" not in self.doubts:
            self._usual_count += (possible - self._usual_count) * usual
        self.sees = self._count / self._usual_count if self._watched > SETTLED and self._usual_count > 1.0 else 1.0

    def agree(self, agreeing: int, asked: int, fading: float) -> float | None:
        """So many of the detections fit ego motion, at a speed at which a wrong mount shows; those before count `fading` times.

        Returns the share of the last seconds' that do; None before there were enough."""
        self._agreeing = self._agreeing * fading + agreeing
        self._asked = self._asked * fading + asked
        return self._agreeing / self._asked if self._asked > EVIDENCE else None

    @property
    def usual(self) -> float:
        """Detections of a scan."""
        return self._usual_count

    def reasons(self, now_ns: int) -> list[str]:
        """Sentences on what is wrong with it; empty where all is well."""
        heard_ns, scarce = self.heard_ns, self.scarce  # read once: another thread may be asking while `restart` takes them away
        if heard_ns is None:
            return [f"nothing so far{self._losses(self._heard)}"]
        if now_ns - heard_ns > SILENT_NS:
            return [f"silent for {(now_ns - heard_ns) * NS:.1f} s{self._losses(self._heard)}"]
        return [*self.doubts.values(), *([] if scarce is None else [scarce])]

    def restart(self) -> None:
        """Forgets all that has a time; what is usual stays."""
        self.heard_ns = self._window_ns = self._last = self.scarce = self._usual_lag = None
        self._repeated = 0

    def doubt(self, fault: str, sentence: str | None) -> None:
        """Begins a doubt, or ends it where there is no sentence."""
        if sentence is not None:
            self.doubts = {**self.doubts, fault: sentence}  # a new dictionary: another thread may be reading the old one
        elif fault in self.doubts:
            self.doubts = {key: value for key, value in self.doubts.items() if key != fault}

    def _possible(self, scan: RadarScan) -> int:
        """How many detections can be true at all; asked twice of each scan."""
        if scan is not self._asked_of:
            found = np.empty(1, np.int64)
            loops.possible(scan.azimuth, scan.range_rate, self.mount.half_fov + BEYOND_VIEW, FASTEST_RATE, found)
            self._asked_of, self._answer = scan, int(found[0])
        return self._answer

    def _is_frozen(self, scan: RadarScan, speed: float) -> bool:
        last = self._last
        if (
            last is None
            or scan.range.tobytes() != last.range.tobytes()
            or scan.azimuth.tobytes() != last.azimuth.tobytes()
            or scan.range_rate.tobytes() != last.range_rate.tobytes()
        ):
            self._repeated = 0
        elif abs(speed) > MOVING:
            self._repeated += len(scan)
        return self._repeated >= REPEATED

    def _losses(self, before: Counts) -> str:
        """What was counted since, in words."""
        counts = (now - then for now, then in zip(_counters(self.health)[1:], before[1:], strict=True))
        said = ", ".join(f"{count} {word}" for count, word in zip(counts, LOSSES.values(), strict=True) if count)
        return f" ({said})" if said else ""
