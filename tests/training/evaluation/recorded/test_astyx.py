"""One frame beside its lidar: labels and Elfes against the reference's own loops, and where the radar is placed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.support.astyx_files import cloud, reflections, write_file
from tests.support.networks import default, write

from echogrid.core.evidence.raster import GridSpec
from echogrid.errors import EchogridError
from echogrid_training.evaluation.metrics import average_precision
from echogrid_training.evaluation.recorded import astyx as real_astyx
from echogrid_training.evaluation.recorded.astyx import PLACES, Frame, Judge, elfes, label, load, obstacles, score, strongest

SPEC = GridSpec()
CELL, SIDE = SPEC.cell, SPEC.cells


def cell_of(x: float, y: float) -> tuple[int, int] | None:
    """In the reference's patch, the radar in the middle of its rear edge."""
    row, column = math.floor((y + 15) / CELL), math.floor(x / CELL)
    return (row, column) if 0 <= row < SIDE and 0 <= column < SIDE else None


def slow_label(points: np.ndarray) -> np.ndarray:
    """By the reference: nearest obstacle of each sector; free before it, then occupied where any is."""
    nearest: dict[int, tuple[float, float]] = {}
    for x, y, z in points.tolist():
        distance, bearing = math.hypot(x, y), math.atan2(y, x)
        sector = math.floor((bearing + math.pi) / math.radians(0.4))
        if -1.0 < z < 1.2 and distance > 2 and distance < nearest.get(sector, (math.inf, 0.0))[0]:
            nearest[sector] = distance, bearing
    ahead = [one for one in nearest.values() if abs(one[1]) <= math.radians(60)]
    out = -np.ones((SIDE, SIDE))
    for distance, bearing in ahead:
        for way in np.arange(0.5, distance - 0.3, CELL / 2):
            if (cell := cell_of(way * math.cos(bearing), way * math.sin(bearing))) is not None:
                out[cell] = 0
    for distance, bearing in ahead:
        if (cell := cell_of(distance * math.cos(bearing), distance * math.sin(bearing))) is not None:
            out[cell] = 1
    return out


def slow_elfes(points: np.ndarray) -> np.ndarray:
    out = np.zeros((SIDE, SIDE))
    for x, y in points.tolist():
        for turn in np.radians((-2, -1, 0, 1, 2)):
            distance, bearing = math.hypot(x, y), math.atan2(y, x) + turn
            way = np.arange(0.3, distance - 0.4, CELL)
            for cell in {cell_of(one * math.cos(bearing), one * math.sin(bearing)) for one in way} - {None}:
                out[cell] -= 0.1
            for step in (-CELL, 0.0, CELL):
                cell = cell_of((distance + step) * math.cos(bearing), (distance + step) * math.sin(bearing))
                if cell is not None:
                    out[cell] += 0.15 if step else 0.3
    return out


def test_labels_and_elfes_are_the_reference_s() -> None:
    frame = Frame(strongest(reflections(1)), obstacles(cloud(2)))
    np.testing.assert_array_equal(label(frame.lidar, PLACES["whole"], SPEC), slow_label(cloud(2)))
    np.testing.assert_allclose(elfes(frame.radar, PLACES["whole"], SPEC), slow_elfes(frame.radar), atol=1e-5)


def test_the_strongest_points_are_kept() -> None:
    points = reflections(3, 800)
    found = strongest(points)
    kept = [row for row in sorted(points.tolist(), key=lambda row: -row[4]) if math.hypot(*row[:2]) < 30 and -1.0 < row[2] < 1.5]
    assert len(kept) > 64
    np.testing.assert_array_equal(found, np.array(kept)[:64, :2])


def test_the_near_patch_has_the_first_cells_of_the_whole_one() -> None:
    frame = Frame(strongest(reflections(4)), obstacles(cloud(5)))
    shift = round((PLACES["near"].x - PLACES["whole"].x) / CELL)
    assert shift * CELL == PLACES["near"].x - PLACES["whole"].x
    for draw, points in ((label, frame.lidar), (elfes, frame.radar)):
        whole, near = (draw(points, PLACES[place], SPEC) for place in ("whole", "near"))
        np.testing.assert_array_equal(near[:, shift:], whole[:, : SIDE - shift])
    assert (label(frame.lidar, PLACES["near"], SPEC)[:, :shift] == -1).all()  # nothing is scored beside and behind the radar


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write(tmp_path_factory.mktemp("model") / "net.onnx", *default(SIDE, CELL, calibration={"learned": 2.0, "offset": -0.3})))


def test_the_network_is_shown_one_scan(model: str) -> None:
    judge = Judge(model, "near")
    around = judge.around(Frame(np.array(((5.0, 1.0), (9.0, -2.0))), np.empty((0, 2))))
    np.testing.assert_allclose(around.now.points, ((8.75, 1.0), (12.75, -2.0)))
    np.testing.assert_array_equal(around.past.points, around.now.points)
    np.testing.assert_array_equal(around.now.origins, ((3.75, 0.0), (3.75, 0.0)))
    assert np.isnan(around.now.rcs).all()
    assert around.looks.place.tolist() == [[3.75, 0.0, 0.0]]
    image = judge.network.draw(around)
    assert [int((image[channel] > 0).sum()) for channel in (0, 3, 6)] == [2, 2, 2]


def test_scores_are_pooled_over_frames(model: str) -> None:
    frames = [Frame(strongest(reflections(seed)), obstacles(cloud(seed + 9))) for seed in (6, 7)]
    judge = Judge(model, "whole")
    found = score("made", frames, judge)
    judged = [judge(frame) for frame in frames]
    observed = [one.label >= 0 for one in judged]
    occupied = np.concatenate([one.label[seen] == 1 for one, seen in zip(judged, observed, strict=True)])
    assert (found.frames, found.cells, found.occupied) == (2, len(occupied), occupied.mean())
    for method in ("elfes", "learned", "looks", "detections", "distance"):
        scores = np.concatenate([one.scores[method][seen] for one, seen in zip(judged, observed, strict=True)])
        assert found.average_precision[method] == average_precision(scores, occupied)
    first, (_, weight) = judged[0].scores, judge.network(judge.around(frames[0]))
    hits, near, passes = judge.measured(frames[0])[2:]
    assert (first["looks"][hits > 0.5] > 0).all()  # a reflection that nothing contradicts, whatever the network says
    assert (first["looks"][(near > 0) & (passes == 0)] > -2.2).all()  # surely free is not what lies beside one
    assert (hits > 0.5).any()
    assert ((near > 0) & (passes == 0)).any()
    assert (weight[first["looks"] == 0] == 0).all()


def test_a_file_is_read_frame_by_frame(tmp_path: Path) -> None:
    first, second = load(write_file(tmp_path / "two.npz"))
    np.testing.assert_allclose(second.radar, strongest(reflections(1, 90)[40:]), rtol=1e-6)
    np.testing.assert_allclose(first.lidar, obstacles(np.round(cloud(2, 500)[:200] / 0.005) * 0.005), atol=1e-9)


def test_bad_files_are_one_sentence(tmp_path: Path) -> None:
    for changes, sentence in (
        ({"radar_off": np.array((0, 40, 91))}, "bad.npz: the lengths of radar_off, lidar_off and their arrays do not fit together$"),
        ({"lidar_off": np.array((0, 500))}, "the lengths of radar_off"),
        ({"radar_xyz_vr_mag": np.zeros((90, 4))}, r"have the shapes \(90, 4\) and \(500, 3\), expected 5 and 3 columns$"),
    ):
        with pytest.raises(EchogridError, match=sentence):
            load(write_file(tmp_path / "bad.npz", **changes))
    with pytest.raises(EchogridError, match="missing.npz: cannot be read"):
        load(tmp_path / "missing.npz")
    with pytest.raises(EchogridError, match="missing.onnx: cannot be read"):
        real_astyx.Judge(str(tmp_path / "missing.onnx"), "near")
