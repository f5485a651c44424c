"""The command: a page that needs no other file, figures that add up, and one sentence for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from echogrid_training import cli
from echogrid_training.own.half import Answers
from echogrid_training.own.worth import AGES, by_age, by_radar, by_range, diagram, live, share


def test_a_page_for_people_and_figures_for_programs(street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, figures = tmp_path / "page.html", tmp_path / "figures.json"
    assert cli.main(["evaluate", "own", str(street), "--model", "default", "--report", str(page), "--json", str(figures)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("Of 100 reflections that the map was not shown, ")
    text = page.read_text("utf-8")
    assert all(part in text for part in ("front_left", "rear_right", "in view just before", "10 to 15 m", "<svg", "swept ground"))
    assert "<script" not in text
    assert "http" not in text
    held = json.loads(figures.read_text("utf-8"))
    for model in ("model", "analytic"):
        pooled = held["pooled"][model]
        assert pooled["detections"] > 50
        for group in ("radar", "range"):
            assert sum(part["detections"] for part in pooled[group].values()) == pooled["detections"]
        assert pooled["found"]["value"] > 0.5  # posts that all scans see
        assert held["drives"][0][model]["swept"] == 0.0
    assert held["drives"][0]["maps"] == 1


def test_mistakes_are_one_sentence(street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, expected in (
        ([str(tmp_path / "none")], "none: there is no such file or folder"),
        ([str(street), "--report", str(tmp_path / "no" / "page.html")], "page.html: there is no folder"),
        ([str(street), "--model", str(tmp_path / "no.onnx")], "no.onnx"),
    ):
        assert cli.main(["evaluate", "own", *arguments]) == 1
        printed = capsys.readouterr()
        assert expected in printed.err
        assert printed.err.count("\n") == 1


def answered(count: int, rng: np.random.Generator) -> Answers:
    log_odds = rng.normal(0.0, 3.0, count)
    log_odds[rng.uniform(size=count) < 0.2] = 0.0
    return Answers(
        rng.integers(0, 9, count),
        rng.integers(0, 3, count),
        rng.uniform(0.3, 21.0, count),
        np.where(rng.uniform(size=count) < 0.1, np.inf, rng.integers(0, 200, count)),
        log_odds,
        np.where(log_odds == 0, -np.inf, log_odds + 0.5),
        rng.uniform(size=count) < 0.3,
    )


def test_shares_are_counted_one_by_one() -> None:
    asked = answered(3000, np.random.default_rng(2))
    hits = [n for n in range(3000) if asked.hit[n]]
    found = live(asked)
    assert found.detections == len(hits)
    assert found.found.value == pytest.approx(sum(asked.reach[n] > 0 for n in hits) / len(hits))
    free = sum(asked.log_odds[n] != 0 and 1 / (1 + np.exp(-asked.log_odds[n])) < 0.1 for n in hits)
    assert found.called_free.value == pytest.approx(free / len(hits))
    assert found.unknown.value == pytest.approx(sum(asked.log_odds[n] == 0 for n in hits) / len(hits))
    assert found.found.low < found.found.value < found.found.high
    for parts in (by_radar(asked, ("a", "b", "c")), by_range(asked), by_age(asked)):
        assert sum(len(part) for part in parts.values()) == 3000
    assert len(by_age(asked)) == len(AGES)
    table = diagram(asked)
    assert table[2].sum() == pytest.approx(np.count_nonzero(asked.hit & (asked.log_odds != 0)))


def test_stretches_that_are_alike_leave_no_doubt() -> None:
    true, stretch = np.tile((True, False, False, False), 10), np.repeat(np.arange(10), 4)
    found = share(true, stretch)
    assert (found.value, found.low, found.high) == (0.25, 0.25, 0.25)
    one = share(np.repeat((True, False), 20), np.repeat((0, 1), 20))
    assert (one.low, one.high) == (0.0, 1.0)
