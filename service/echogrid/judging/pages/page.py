"""A check as one HTML page with plots: everything in the file, SVG drawn by hand, no script."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2, arc
from echogrid.judging.finding import Finding
from echogrid.judging.judge import Judgement
from echogrid.judging.pages.plot import Curve, bars, plot
from echogrid.judging.recorded import RadarTrack, Recorded
from echogrid.judging.sectors import by_sector
from echogrid.judging.sensor_velocity import SensorVelocity

MOST_POINTS = 6000  # of the map
RESIDUAL_BIN = np.radians(10.0)
STYLE = """
:root { --ink: #1b1f24; --faint: #8a929c; --paper: #fff; --bad: #b3261e; --good: #1d7a46 }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e9ec; --paper: #16191d; --bad: #ff8a80; --good: #7bd6a4 } }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper) }
body { max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
svg { width: 100%; height: auto; display: block; margin: .3rem 0 1.4rem }
h1, h2 { line-height: 1.2 } h2 { margin-top: 2.2rem; font-size: 1.15rem }
.finding { border-left: 4px solid var(--bad); padding: .2rem .8rem; margin: .8rem 0 } .none { color: var(--good) }
code { overflow-wrap: anywhere }
.rests { color: var(--faint); font-size: .9em } figcaption { font-weight: 600 } figure { margin: 0 }
"""


def page_of(recorded: Recorded, judgement: Judgement, said: Sequence[tuple[Finding, list[str]]], title: str) -> str:
    """`said`: findings with the lines that mend them."""
    body = [f"<h1>{html.escape(title)}</h1>", *_findings(said, judgement), "<h2>Speed against Doppler</h2>", _speeds(recorded, judgement)]
    body.append("<h2>Residual range rate by azimuth</h2>")
    for radar, one in zip(judgement.mended, judgement.velocities, strict=True):
        body.append(_figure(radar.name, _residuals(radar, one)))
    body.append("<h2>Time between scans</h2>")
    body.append(plot([Curve(radar.name, radar.time[1:], np.diff(radar.time) * 1e3) for radar in recorded.radars], "s", "ms"))
    body.append("<h2>Detections in a scan</h2>")
    counts = [Curve(radar.name, radar.time, radar.counts.astype(float)) for radar in recorded.radars]
    body.append(plot(counts, "s", "detections"))
    body.append("<h2>Detections by azimuth</h2>")
    for radar in judgement.mended:
        edges, found = by_sector(radar)
        body.append(_figure(radar.name, bars(np.degrees(edges), found, "azimuth, °", "detections")))
    body += ["<h2>Standing detections along dead reckoning</h2>", _map(recorded, judgement)]
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title><style>{STYLE}</style>'
    return head + "\n".join(body) + "</html>\n"


def _figure(caption: str, svg: str) -> str:
    return f"<figure><figcaption>{html.escape(caption)}</figcaption>{svg}</figure>"


def _findings(said: Sequence[tuple[Finding, list[str]]], judgement: Judgement) -> list[str]:
    lines = [] if said else ['<p class="none">Nothing wrong was found.</p>']
    for finding, fixes in said:
        mends = "".join(f"<br><code>{html.escape(line)}</code>" for line in fixes)
        lines.append(
            f'<div class="finding"><code>{finding.code}</code> {html.escape(finding.sentence)} ({finding.confidence:.0%} sure){mends}'
            f'<div class="rests">{html.escape(finding.rests_on)}</div></div>'
        )
    lines += [f"<p>Not judged, <code>{one.code}</code>: {html.escape(one.sentence)}</p>" for one in judgement.undecided]
    return lines


def _speeds(recorded: Recorded, judgement: Judgement) -> str:
    """The wheels' speed, and what each radar measures along the car's axis with its own mount."""
    curves = []
    for radar, one in zip(recorded.radars, judgement.velocities, strict=True):
        place = radar.mount.base_from_sensor
        turned = recorded.yaw_rate.at(one.time) if len(recorded.yaw_rate) else np.zeros(len(one))
        curves.append(Curve(radar.name, one.time, (one.velocity * np.exp(1j * place.yaw)).real + turned * place.y))
    curves.append(Curve("wheels", recorded.speed.time, recorded.speed.value, line=True))
    return plot(curves, "s", "m/s")


def _residuals(radar: RadarTrack, one: SensorVelocity) -> str:
    """Median of what each scan's own velocity leaves of the range rates, by azimuth."""
    if not len(one):
        return plot([], "azimuth, °", "m/s")
    of_scan = np.searchsorted(one.time, radar.time)
    known = np.isin(radar.time, one.time)[radar.scan] & one.agrees
    velocity = one.velocity[np.minimum(of_scan, len(one) - 1)][radar.scan]
    left = radar.range_rate + velocity.real * np.cos(radar.azimuth) + velocity.imag * np.sin(radar.azimuth)
    bins = np.round(radar.azimuth / RESIDUAL_BIN).astype(int)
    places = [n for n in np.unique(bins[known]) if np.count_nonzero(bins[known] == n) > 20]
    median = np.array([np.median(left[known & (bins == n)]) for n in places])
    return plot([Curve("", np.degrees(np.array(places) * RESIDUAL_BIN), median, line=True)], "azimuth, °", "m/s")


def _map(recorded: Recorded, judgement: Judgement) -> str:
    """Detections that stand, placed by speed and yaw rate alone, with the mounts as configured."""
    if not len(recorded.speed) or not len(recorded.yaw_rate):
        return plot([], "m", "m")
    time, poses = _poses(recorded)
    curves = []
    for radar, one in zip(recorded.radars, judgement.velocities, strict=True):
        chosen = np.flatnonzero(one.agrees & (radar.range < radar.mount.max_range))
        chosen = chosen[:: max(1, len(chosen) * len(recorded.radars) // MOST_POINTS)]
        curves.append(Curve(radar.name, *_placed(radar, chosen, time, poses)))
    curves.append(Curve("way", poses[:, 0], poses[:, 1], line=True))
    return plot(curves, "m", "m", equal=True)


def _poses(recorded: Recorded) -> tuple[Floats, Floats]:
    """Times (N,), and poses (N, 3) by exact arcs between them."""
    time = np.arange(recorded.speed.time[0], recorded.speed.time[-1], 0.05)
    speed, yaw_rate = recorded.speed.at(time), recorded.yaw_rate.at(time)
    pose, poses = SE2(0.0, 0.0, 0.0), []
    for v, w in zip(speed, yaw_rate, strict=True):
        poses.append((pose.x, pose.y, pose.yaw))
        pose = pose @ arc(float(v) * 0.05, float(w) * 0.05)
    return time, np.array(poses).reshape(-1, 3)


def _placed(radar: RadarTrack, chosen: np.ndarray, time: Floats, poses: Floats) -> tuple[Floats, Floats]:
    """Where detections lie in odom, x and y (m)."""
    place = radar.mount.base_from_sensor
    x, y, yaw = (np.interp(radar.time[radar.scan[chosen]], time, poses[:, axis]) for axis in range(3))
    bearing = radar.azimuth[chosen] + place.yaw
    ahead, left = place.x + radar.range[chosen] * np.cos(bearing), place.y + radar.range[chosen] * np.sin(bearing)
    return x + ahead * np.cos(yaw) - left * np.sin(yaw), y + ahead * np.sin(yaw) + left * np.cos(yaw)
