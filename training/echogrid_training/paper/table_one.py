"""The paper's Table I, ours beside it: the mean over seeds, its spread over them, and how much it hangs on which towns were tested."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid_training.learning.loss import CLASSES, Weighting
from echogrid_training.learning.recipe import Sensor
from echogrid_training.paper.autoencoders import PAPERS, Autoencoder
from echogrid_training.resampling import interval, resamples

SCHEMES = {"inverse": "inverse class ratio", "independent": "independent class MSE"}
KINDS = ("ternary", "soft")
HEAD = ["sensor", "class weights", "paper: free", "paper: occupied", *CLASSES, *(f"soft: {name}" for name in CLASSES)]
Cell = tuple[str, str]  # a kind of labels, a class


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One of the four, by kind of labels and class: the mean over seeds, their standard deviation, and the mean by draw of towns."""

    sensor: Sensor
    weighting: Weighting
    seeds: int
    mean: dict[Cell, float]
    spread: dict[Cell, float]  # NaN for a single seed
    drawn: dict[Cell, Floats]  # (RESAMPLED,), the same draws of towns for all four


def table(networks: Sequence[Autoencoder]) -> list[Line]:
    """In the order of the paper's."""
    draws = resamples(len(networks[0].towns["ternary"]))
    return [_line(kind, [network for network in networks if (network.sensor, network.weighting) == kind], draws) for kind in PAPERS]


def _line(kind: tuple[Sensor, Weighting], seeds: Sequence[Autoencoder], draws: NDArray[np.int64]) -> Line:
    mean, spread, drawn = {}, {}, {}
    for labels in KINDS:
        sums = np.stack([seed.towns[labels] for seed in seeds])  # (S, T, 2, 3)
        with np.errstate(invalid="ignore"):
            values = sums.sum(axis=1)[:, 0] / sums.sum(axis=1)[:, 1]  # (S, 3)
            picked = np.einsum("dt,stkc->sdkc", draws.astype(float), sums)
            anew = (picked[:, :, 0] / picked[:, :, 1]).mean(axis=0)  # (RESAMPLED, 3)
        for index, name in enumerate(CLASSES):
            mean[labels, name] = float(values[:, index].mean())
            spread[labels, name] = float(values[:, index].std(ddof=1)) if len(seeds) > 1 else math.nan
            drawn[labels, name] = anew[:, index]
    return Line(*kind, len(seeds), mean, spread, drawn)


def rows(lines: Sequence[Line]) -> list[list[str]]:
    """Below HEAD."""
    return [
        [
            line.sensor,
            SCHEMES[line.weighting],
            *(f"{value:.2f}" for value in PAPERS[line.sensor, line.weighting]),
            *(_cell(line, (labels, name)) for labels in KINDS for name in CLASSES),
        ]
        for line in lines
    ]


def _cell(line: Line, cell: Cell) -> str:
    if math.isnan(line.mean[cell]):
        return "–"
    spread = "" if math.isnan(line.spread[cell]) else f" ± {line.spread[cell]:.3f}"
    low, high = interval(line.drawn[cell])
    return f"{line.mean[cell]:.3f}{spread} [{low:.3f}, {high:.3f}]"


def observations(lines: Sequence[Line]) -> list[tuple[str, bool, float]]:
    """What the paper reads off its table, whether it can be read off ours, and in what share of the draws of towns."""
    of = {(line.sensor, line.weighting): line for line in lines}

    def below(one: Line, other: Line, name: str) -> tuple[bool, NDArray[np.bool_]]:
        cell = ("ternary", name)
        return one.mean[cell] < other.mean[cell], one.drawn[cell] < other.drawn[cell]

    claims: list[tuple[str, list[tuple[bool, NDArray[np.bool_]]]]] = [
        (
            f"{sensor}: the inverse class ratio errs less on free cells and more on occupied ones than the independent class MSE",
            [
                below(of[sensor, "inverse"], of[sensor, "independent"], "free"),
                below(of[sensor, "independent"], of[sensor, "inverse"], "occupied"),
            ],
        )
        for sensor in ("lidar", "radar")
    ]
    claims += [
        (
            f"{SCHEMES[weighting]}: the lidar errs less than the radar, on free and on occupied cells",
            [below(of["lidar", weighting], of["radar", weighting], name) for name in ("free", "occupied")],
        )
        for weighting in ("inverse", "independent")
    ]
    return [
        (claim, all(holds for holds, _ in parts), float(np.logical_and.reduce([drawn for _, drawn in parts]).mean()))
        for claim, parts in claims
    ]


def told(claims: Sequence[tuple[str, bool, float]]) -> list[tuple[str, str]]:
    """For people: the claim, and yes or no."""
    return [(claim, f"{'yes' if holds else 'no'} ({share:.0%} of the draws of towns: yes)") for claim, holds, share in claims]


def markdown(lines: Sequence[Line]) -> str:
    """Table I beside the paper's, and below it what can be read off it."""
    table = [HEAD, ["---"] * len(HEAD), *rows(lines)]
    claims = [("what the table shows in the paper", "here too"), ("---", "---"), *told(observations(lines))]
    return "\n\n".join("\n".join(f"| {' | '.join(row)} |" for row in part) for part in (table, claims))


def figures(lines: Sequence[Line]) -> list[dict[str, Any]]:
    """For programs: as JSON knows numbers, null where there is none."""
    out = []
    for line in lines:
        cells = {
            f"{labels}: {name}": {
                "mean": _number(line.mean[labels, name]),
                "spread": _number(line.spread[labels, name]),
                "interval": None if math.isnan(line.mean[labels, name]) else interval(line.drawn[labels, name]),
            }
            for labels in KINDS
            for name in CLASSES
        }
        out.append(
            {"sensor": line.sensor, "weighting": line.weighting, "seeds": line.seeds, "paper": PAPERS[line.sensor, line.weighting]} | cells
        )
    return out


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value
