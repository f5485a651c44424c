"""The reproduction's page and pictures: what the numbers show, and where colours and lines lie."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from echogrid_training.learning.autoencoder import PaperAutoencoder
from echogrid_training.learning.dataset import SPEC, Samples
from echogrid_training.learning.loss import CLASSES
from echogrid_training.learning.train import Settings, Trained
from echogrid_training.paper.autoencoders import PAPERS, Autoencoder
from echogrid_training.paper.reproduction_pictures import CAR, LINES, TRUTH, ZOOM, chart, grey, input_picture, map_picture, patch_picture
from echogrid_training.paper.reproduction_report import RULES, Part, Reproduction, markdown, observations, page
from echogrid_training.paper.true_pose_map import MapErrors
from echogrid_training.truth.ground_truth import TruthMap


def networks() -> list[Autoencoder]:
    """Four that have the paper's own errors."""
    four = []
    for (sensor, weighting), (free, occupied) in PAPERS.items():
        settings = Settings("paper", weighting, epochs=2, width=2, sensor=sensor)
        trained = Trained(settings, PaperAutoencoder(2).state_dict(), "f00d", (1.0, 0.0), None, (0.6, 0.37, 0.03))  # type: ignore[arg-type]
        errors = dict(zip(CLASSES, (free, 0.1, occupied), strict=True))
        line = {"step": 8, "seconds": 30.0, "loss": 1.0, "held_out_mse": errors}
        four.append(Autoencoder(trained, {"ternary": errors, "soft": dict.fromkeys(CLASSES, math.nan)}, [line, line]))
    return four


def made(name: str = "test-00000") -> Reproduction:
    four = networks()
    maps = {(rule, network.name): MapErrors(0.5, 0.25, 1.5, 0.4, 0.6) for rule in RULES for network in four}
    pictures = {f"map-{rule}-{network.name}": b"png" for rule in RULES for network in four} | {"map-truth": b"png", "prior": b"png"}
    part = Part([], Samples.empty(0))
    parts = {"learned from": part, "test": part}
    return Reproduction(four, parts, {"learned from": ['{"family":"<train>"}'], "test": []}, name, 231.4, maps, pictures)


def test_what_the_paper_reads_off_its_table_can_be_read_off_its_numbers() -> None:
    assert [holds for _, holds in observations(networks())] == [True] * 4
    four = networks()
    four[0] = replace(four[0], errors={"ternary": dict(zip(CLASSES, (0.5, 0.1, 1.46), strict=True)), "soft": {}})
    assert [holds for _, holds in observations(four)] == [False, True, False, True]


def test_the_table_has_one_cell_for_each_column() -> None:
    lines = markdown(networks()).splitlines()
    assert {line.count("|") for line in lines} == {11}
    assert lines[2] == "| lidar | inverse class ratio | 0.14 | 1.46 | 0.140 | 0.100 | 1.460 | – | – | – |"


def test_names_from_outside_stay_text() -> None:
    said = page(made("<script>alert(1)</script>"))
    assert "<script" not in said
    assert "&lt;script&gt;" in said
    assert "&lt;train&gt;" in said


def test_the_page_says_what_is_not_the_papers() -> None:
    said = " ".join(page(made()).split())
    assert "so we chose channel widths, depth and" in said
    assert "<b>The towns are simulated</b>" in said
    assert "along test-00000, with 231 m" in said


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
