"""`echogrid-train evaluate motion`: dead reckoning without corrections, with what stops tell, with all that is learned on the way, and with
what the whole drive has taught from its start on, as a table."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from echogrid.core.motion.error_filter import Kept, Learns
from echogrid_training.evaluation.recorded.reckoning import Score, hear, reckon, score
from echogrid_training.evaluation.tables.markdown import markdown
from echogrid_training.recording import Track, untracked

WAYS: tuple[Learns, ...] = ("never", "standing", "driving")
HEADS = (
    "drive",
    "driven",
    "raw",
    "stops",
    "learned",
    "learned / raw",
    "learned first",
    "/ raw",
    "second half: raw",
    "learned",
    "yaw-rate bias",
    "wheel scale",
    "NEES place",
    "heading",
)
HALF, MOST = (1.386, 0.455), (5.991, 3.841)  # of chi-squared with 2 and 1 degrees of freedom: where 50 % and 95 % lie below


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("drives", type=Path, nargs="+", metavar="DRIVE", help="folders of drives with true poses")
    parser.add_argument("--one-car", action="store_true", help="each drive begins with what the one before has taught of the car")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """The table in Markdown, and what it comes to. Raises EchogridError."""
    rows, scores = [], list[tuple[Score, ...]]()
    kept: Kept | None = None
    for folder in track(options.drives, "drives"):
        heard = hear(folder)
        reckoned = [reckon(heard, learns, kept if learns == "driving" else None) for learns in WAYS]
        taught, known = reckoned[-1].kept, reckoned[-1].learned
        kept = taught if options.one_car else None
        reckoned.append(reckon(heard, "never", taught, same_drive=True))
        each = tuple(score(one, heard.truth) for one in reckoned)
        scores.append(each)
        raw, _, learned, first = each
        rows.append(
            (
                heard.name,
                f"{raw.way:.0f} m",
                *(f"{one.off:.2f} m" for one in each[:3]),
                f"{_ratio(learned.off, raw.off):.2f}",
                f"{first.off:.2f} m",
                f"{_ratio(first.off, raw.off):.2f}",
                f"{raw.later_off:.2f} m",
                f"{learned.later_off:.2f} m",
                *(f"{known[key]:+.2f} ± {known[f'{key}_sigma']:.2f}" for key in ("yaw_rate_bias_deg_s", "wheel_scale_percent")),
                f"{learned.place:.2f}",
                f"{learned.heading:.2f}",
            )
        )
    return f"{markdown(HEADS, rows)}\n\n{summary(scores)}\n"


def summary(scores: Sequence[tuple[Score, ...]]) -> str:
    """Of drives, each scored as in WAYS and then with what was learned first: medians, the worst ratio, and how many of the claims hold."""
    raw, stops, learned, first = (np.array([one[n].off / one[n].way * 100 for one in scores]) for n in range(len(WAYS) + 1))
    said = [
        f"RMSE per 100 m, median: raw {np.median(raw):.2f} m, stops {np.median(stops):.2f} m, learned {np.median(learned):.2f} m, "
        f"learned first {np.median(first):.2f} m."
    ]
    for name, n in (("Learned", 2), ("Learned first", 3)):
        ratios = [_ratio(one[n].off, one[0].off) for one in scores]
        later = [_ratio(one[n].later_off, one[0].later_off) for one in scores]
        places, headings = (np.array([getattr(one[n], key) for one in scores]) for key in ("place", "heading"))
        within = ", ".join(
            f"{what} {np.mean(values < HALF[k]):.0%} and {np.mean(values < MOST[k]):.0%}"
            for k, (what, values) in enumerate((("place", places), ("heading", headings)))
        )
        said.append(
            f"{name} / raw: median {np.median(ratios):.2f}, worst {max(ratios):.2f}; "
            f"in the second half {np.median(later):.2f}, {max(later):.2f}. Within the 50 % and the 95 % band: {within}."
        )
    return "\n".join(said)


def _ratio(learned: float, raw: float) -> float:
    """Errors below 5 cm are all alike."""
    return max(learned, 0.05) / max(raw, 0.05)
