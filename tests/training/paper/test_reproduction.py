"""The reproduction's page and pictures: what the numbers show, and where colours and lines lie."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from echogrid_training.learning.autoencoder import PaperAutoencoder
from echogrid_training.learning.dataset import SPEC
from echogrid_training.learning.loss import CLASSES, Weighting
from echogrid_training.learning.recipe import Sensor
from echogrid_training.learning.train import Settings, Trained
from echogrid_training.paper.autoencoders import PAPERS, Autoencoder
from echogrid_training.paper.material import Part
from echogrid_training.paper.reproduction_pictures import CAR, LINES, TRUTH, ZOOM, chart, grey, input_picture, map_picture, patch_picture
from echogrid_training.paper.reproduction_report import RULES, Reproduction, figures, page
from echogrid_training.paper.table_one import markdown, observations, table
from echogrid_training.paper.true_pose_map import MapErrors
from echogrid_training.truth.ground_truth import TruthMap


def network(seed: int, sensor: Sensor, weighting: Weighting, *towns: tuple[float, float]) -> Autoencoder:
    """With errors of free and occupied cells town by town; the second town has three times the cells of the first, and so on."""
    settings = Settings("paper", weighting, epochs=2, seed=seed, width=2, sensor=sensor)
    trained = Trained(settings, PaperAutoencoder(2).state_dict(), "f00d", (1.0, 0.0), None, (0.6, 0.37, 0.03))  # type: ignore[arg-type]
    cells = 100.0 * 3 ** np.arange(len(towns))
    sums = np.array([[np.array((free, 0.1, occupied)) * count, [count] * 3] for (free, occupied), count in zip(towns, cells, strict=True)])
    line = {"step": 8, "seconds": 30.0, "loss": 1.0, "held_out_mse": dict.fromkeys(CLASSES, 0.1)}
    return Autoencoder(trained, {"ternary": sums, "soft": sums * np.array((0.5, 1.0))[:, None]}, [line, line], "beef")


def networks(seeds: int = 1) -> list[Autoencoder]:
    """Four that have the paper's own errors, in two towns and from each seed."""
    return [network(seed, *kind, of, of) for kind, of in PAPERS.items() for seed in range(seeds)]


def made(name: str = "test-00000") -> Reproduction:
    four = networks(2)
    maps = {(rule, one.name): MapErrors(0.5, 0.25, 1.5, 0.4, 0.6) for rule in RULES for one in four[::2]}
    pictures = {f"map-{rule}-{one.name}": b"png" for rule in RULES for one in four[::2]} | {"map-truth": b"png", "prior": b"png"}
    parts = {"learned from": Part([Path("<a>")], 7, "c0ffee", ['{"family":"<train>"}']), "test": Part([], 3, "f00d", [])}
    return Reproduction(four, table(four), parts, name, 231.4, maps, pictures)


def test_what_the_paper_reads_off_its_table_can_be_read_off_its_numbers() -> None:
    assert [(holds, share) for _, holds, share in observations(table(networks()))] == [(True, 1.0)] * 4
    four = networks()
    four[0] = network(0, "lidar", "inverse", (0.5, 1.46), (0.5, 1.46))
    assert [holds for _, holds, _ in observations(table(four))] == [False, True, False, True]


def test_errors_are_pooled_over_towns_and_averaged_over_seeds() -> None:
    four = networks()
    four[:1] = [network(0, "lidar", "inverse", (0.1, 1.0), (0.2, 1.4)), network(1, "lidar", "inverse", (0.3, 1.0), (0.2, 1.4))]
    line = table(four)[0]
    one, other = (0.1 + 3 * 0.2) / 4, (0.3 + 3 * 0.2) / 4
    assert line.mean["ternary", "free"] == pytest.approx((one + other) / 2)
    assert line.spread["ternary", "free"] == pytest.approx(math.sqrt(2 * ((one - other) / 2) ** 2))
    assert line.mean["soft", "occupied"] == pytest.approx(0.5 * (1.0 + 3 * 1.4) / 4)
    pooled = {(0, 2): 1.4, (1, 1): (1.0 + 3 * 1.4) / 4, (2, 0): 1.0}  # towns as often as they are drawn
    assert set(np.round(line.drawn["ternary", "occupied"], 9)) == {round(value, 9) for value in pooled.values()}
    (share,) = {share for claim, _, share in observations(table(four)) if claim.startswith("lidar")}
    assert share == 1.0


def test_how_often_a_claim_holds_is_told_by_the_draws() -> None:
    """In one of two towns the lidar is the worse one: drawn twice, which happens in a quarter of the draws, it turns the claim round."""
    four = networks()
    four[1] = network(0, "lidar", "independent", (0.49, 0.55), (0.60, 0.55))
    four[3] = network(0, "radar", "independent", (0.40, 0.69), (0.70, 0.69))
    share = observations(table(four))[3][2]
    assert share == pytest.approx(0.75, abs=0.05)


def test_the_table_has_one_cell_for_each_column() -> None:
    lines = markdown(table(networks())).splitlines()
    assert {line.count("|") for line in lines[:6]} == {11}
    first = "0.140 [0.140, 0.140] | 0.100 [0.100, 0.100] | 1.460 [1.460, 1.460]"
    assert lines[2].startswith(f"| lidar | inverse class ratio | 0.14 | 1.46 | {first} | 0.070")
    assert "0.140 ± 0.000 [" in markdown(table(networks(2)))
    assert lines[-1].endswith("| yes (100% of the draws of towns: yes) |")


def test_figures_are_json_and_name_what_they_are_made_of() -> None:
    told = json.loads(json.dumps(figures(made()), allow_nan=False))
    assert [one["holds"] for one in told["observations"]] == [True] * 4
    assert told["table"][0]["ternary: free"]["mean"] == pytest.approx(0.14)
    assert told["parts"]["learned from"] == {"drives": ["<a>"], "samples": 7, "sha256": "c0ffee", "plans": ['{"family":"<train>"}']}
    assert set(told["networks"]) == {f"{sensor}-{weighting}-{seed}" for sensor, weighting in PAPERS for seed in (0, 1)}


def test_names_from_outside_stay_text() -> None:
    said = page(made("<script>alert(1)</script>"))
    assert "<script" not in said
    assert "&lt;script&gt;" in said
    assert "&lt;train&gt;" in said
    assert "&lt;a&gt;" in said


def test_the_page_says_what_is_not_the_papers() -> None:
    said = " ".join(page(made()).split())
    assert "so we chose channel widths, depth and" in said
    assert "<b>The towns are simulated</b>" in said
    assert "along test-00000, with 231 m" in said
    assert all(digest in said for digest in ("c0ffee", "f00d", "beef"))
    assert "Means of 2 seeds" in said


def test_what_lies_ahead_on_the_left_is_drawn_at_the_upper_left() -> None:
    centres = SPEC.centres()
    patch = np.where((centres[..., 0] > 10) & (centres[..., 1] > 10), np.float32(1), np.float32(-1))
    picture = np.asarray(patch_picture(patch))
    assert picture[0, 0].tolist() == [255] * 3
    assert [picture[row, column].tolist() for row, column in ((0, -1), (-1, 0), (-1, -1))] == [[0] * 3] * 3
    outline = np.argwhere((picture == CAR).all(axis=2))  # of a car with its rear axle in the middle: more of it is ahead
    ahead, behind = SPEC.cells * ZOOM / 2 - outline[:, 0].min(), outline[:, 0].max() - SPEC.cells * ZOOM / 2
    assert (ahead * SPEC.cell / ZOOM, behind * SPEC.cell / ZOOM) == pytest.approx((3.9, 1.0), abs=0.2)


def test_greys_are_the_papers() -> None:
    np.testing.assert_array_equal(grey(np.array([-1.0, 0.0, 1.0], np.float32)), [0, 128, 255])


def test_a_dot_is_grown_about_its_cell() -> None:
    image = np.full((SPEC.cells, SPEC.cells), -1.0, np.float32)
    image[20, 100] = 1.0
    bright = np.argwhere(np.asarray(input_picture(image)).min(axis=2) == 255) // ZOOM
    assert sorted(set(map(tuple, bright.tolist()))) == [(row, column) for row in (26, 27, 28) for column in (106, 107, 108)]


def test_the_truth_lies_over_the_map_with_y_up() -> None:
    said, over = np.full((30, 40), -3.0, np.float32), np.zeros((30, 40), np.float32)
    over[0, 39] = 2.0  # at the lower right
    truth = TruthMap(over, (0.0, 0.0), 0.25)
    picture = np.asarray(map_picture(said, over, truth, np.array(((1.0, 1.0), (1.0, 2.0)))))
    red, green, blue = picture[-1, -1].tolist()
    assert red > green > blue
    assert abs(red - 0.6 * TRUTH[0]) < 10
    coloured = np.ptp(picture.astype(int), axis=2) > 0
    zoom = picture.shape[0] // 30
    assert coloured.sum() == zoom**2 + coloured[:, : 10 * zoom].sum()  # one cell, and the way
    rows = np.flatnonzero(coloured[:, : 10 * zoom].any(axis=1)) / zoom
    assert (rows.min(), rows.max()) == pytest.approx((30 - 8, 30 - 4), abs=0.5)


def middle(picture: Image.Image, colour: tuple[int, int, int], left: int, right: int) -> float:
    """Mean row of a colour between two columns, above the legend."""
    found = (np.asarray(picture) == colour).all(axis=2)[:250, left:right]
    return float(np.argwhere(found)[:, 0].mean())


def test_a_falling_line_falls_and_the_larger_lies_higher() -> None:
    picture = chart("loss", {"one": [1.0, 0.6, 0.5], "other": [0.3, 0.2, 0.1], "none": [math.nan] * 3})
    one, other = LINES[:2]
    assert middle(picture, one, 60, 120) < middle(picture, one, 340, 400)
    assert middle(picture, one, 60, 400) < middle(picture, other, 60, 400)
    chart("loss", {"nothing": []})
