"""Figures of all test towns together: by level and method, seeds as mean and deviation, towns resampled for intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from echogrid.core.messages import Floats
from echogrid_training.evaluation.simulated.baselines import MEAN_PATCH
from echogrid_training.evaluation.simulated.calibrating import Plan
from echogrid_training.evaluation.simulated.judging import Judged
from echogrid_training.evaluation.simulated.learned import Key
from echogrid_training.evaluation.simulated.maps import ELFES, TUNED
from echogrid_training.evaluation.simulated.patches import STRATA
from echogrid_training.evaluation.simulated.tally import Tally, by_stratum, figures, resampled, summed
from echogrid_training.resampling import interval, resamples

REFERENCE = {"patch": "Elfes, 15 m", "around": ELFES, "finished": ELFES}  # what others are compared with, town by town

Figures = dict[str, Any]


def results(of: Sequence[Judged], plan: Plan, calibrating: int) -> Figures:
    """Everything by name; NaN where a figure has no meaning."""
    levels = sorted({level for one in of for level in one.tallies})
    return {
        "drives": len(of),
        "towns": len({one.town for one in of}),
        "calibration_drives": calibrating,
        "patches": sum(one.patches for one in of),
        "models": {name: [str(file.path) for file in plan.files if file.name == name] for name in {file.name: 0 for file in plan.files}},
        "tuned": {name: repr(method) for (name, _), method in plan.methods.items() if name != MEAN_PATCH}
        | dict.fromkeys([TUNED] * len(plan.elfes), repr(plan.elfes)),
        "levels": {level: _level(level, of) for level in levels},
        "standstill": _worst([one.standstill for one in of]),
        "revisit": _revisit(of),
    }


def by_town(of: Sequence[Judged], level: str) -> dict[Key, list[Tally]]:
    """One sum a town, in the same order for every method."""
    towns: dict[str, list[dict[Key, Tally]]] = {}
    for one in of:
        if level in one.tallies:
            towns.setdefault(one.town, []).append(one.tallies[level])
    keys = next(iter(towns.values()))[0] if towns else {}
    return {key: [summed([drive[key] for drive in drives]) for drives in towns.values()] for key in keys}


def _level(level: str, of: Sequence[Judged]) -> Figures:
    towns = by_town(of, level)
    drawn = _drawn(towns) if level in REFERENCE else {}
    out: Figures = {}
    for name in _names(towns):
        sums = [summed(towns[key]) for key in _seeds(towns, name)]
        seeds = [figures(one) for one in sums]
        out[name] = {figure: _mean_of([seed[figure] for seed in seeds]) for figure in seeds[0]}
        if len(seeds) > 1:
            out[name]["sd"] = {figure: float(np.std([seed[figure] for seed in seeds], ddof=1)) for figure in seeds[0]}
        if drawn:
            reference = drawn[REFERENCE[level]]
            out[name]["interval"] = {figure: interval(values) for figure, values in drawn[name].items()}
            out[name]["over_reference"] = {figure: interval(values - reference[figure]) for figure, values in drawn[name].items()}
        if len(sums[0].histogram) > 1:
            strata = [by_stratum(one, STRATA) for one in sums]
            out[name]["strata"] = {
                stratum: {figure: _mean_of([one[stratum][figure] for one in strata]) for figure in strata[0][stratum]} for stratum in STRATA
            }
        out[name]["reliability"] = sums[0].reliability.tolist()
    return out


def _drawn(towns: dict[Key, list[Tally]]) -> dict[str, dict[str, Floats]]:
    """Headline figures of resampled towns, the mean over seeds, by method."""
    draws = resamples(len(next(iter(towns.values()))))
    return {name: _mean([resampled(towns[key], draws) for key in _seeds(towns, name)]) for name in _names(towns)}


def _revisit(of: Sequence[Judged]) -> Figures:
    """Overlap of the finished maps of those drives that were driven twice, after the first and the second time."""
    twice = [one for one in of if "revisited" in one.tallies]
    if not twice:
        return {}
    first, second = (by_town(twice, level) for level in ("finished", "revisited"))
    return {
        name: {
            when: _mean_of([figures(summed(towns[key]))["iou"] for key in _seeds(towns, name)])
            for when, towns in (("first", first), ("second", second))
        }
        for name in _names(first)
    }


def _worst(of: Sequence[dict[Key, float]]) -> dict[str, float]:
    names = {name: 0 for one in of for name, _ in one}
    return {name: max(change for one in of for key, change in one.items() if key[0] == name) for name in names}


def _names(towns: dict[Key, list[Tally]]) -> list[str]:
    return list(dict.fromkeys(name for name, _ in towns))


def _seeds(towns: dict[Key, list[Tally]], name: str) -> list[Key]:
    return [key for key in towns if key[0] == name]


def _mean(of: Sequence[dict[str, Floats]]) -> dict[str, Floats]:
    return {figure: np.mean([one[figure] for one in of], axis=0) for figure in of[0]}


def _mean_of(values: Sequence[float]) -> float:
    return float(np.mean(values))


def cleaned(what: Any) -> Any:
    """Without numbers that JSON does not know."""
    if isinstance(what, dict):
        return {key: cleaned(value) for key, value in what.items()}
    if isinstance(what, list | tuple):
        return [cleaned(value) for value in what]
    return None if isinstance(what, float) and not math.isfinite(what) else what
