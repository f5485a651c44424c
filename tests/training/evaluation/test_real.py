"""`evaluate real` from recordings made here to figures, tables and pictures."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.support import astyx_files, nuscenes_files, posts, radarscenes_files
from tests.support.networks import default, write

from echogrid.errors import EchogridError
from echogrid_training.evaluation.real import add_arguments, finite, named, run

NUSCENES = {"front_left": "FRONT_LEFT", "front_right": "FRONT_RIGHT", "rear_left": "BACK_LEFT", "rear_right": "BACK_RIGHT"}


def scene(path: Path) -> Path:
    """The street of posts as nuScenes' compact file."""
    made = nuscenes_files.Made({name: [] for name in NUSCENES.values()}, {name: [] for name in NUSCENES.values()}, {}, [], [], [])
    for sensor, stamp, found in posts.scans():
        points = np.zeros(len(found), dtype=nuscenes_files.POINT)
        range_, azimuth, rate, rcs = found.T
        points["x"], points["y"], points["rcs"] = range_ * np.cos(azimuth), range_ * np.sin(azimuth), rcs
        points["vx"], points["vy"] = rate * np.cos(azimuth), rate * np.sin(azimuth)
        made.clouds[NUSCENES[sensor]].append(points)
        made.stamps[NUSCENES[sensor]].append(stamp // 1000)
    for sensor, mount in posts.MOUNTS.items():
        made.mounts[NUSCENES[sensor]] = [mount.x, mount.y, 0.7, math.cos(mount.yaw / 2), 0.0, 0.0, math.sin(mount.yaw / 2)]
    for stamp in posts.MOTION_NS.tolist():
        turns = 60 * posts.SPEED / (2 * math.pi * 0.305)
        made.wheels.append({"utime": stamp // 1000} | dict.fromkeys(nuscenes_files.WHEELS, turns))
        made.imu.append({"utime": stamp // 1000, "rotation_rate": [0.0, 0.0, 0.0]})
        place = {"pos": [posts.pose(stamp).x, 0.0, 0.0], "vel": [posts.SPEED, 0.0, 0.0], "orientation": [1.0, 0.0, 0.0, 0.0]}
        made.pose.append({"utime": stamp // 1000} | place)
    return nuscenes_files.write_compact(made, path)


def sequence(path: Path) -> Path:
    """And as RadarScenes': its radars 1 to 4 are the right rear, right front, left front and left rear."""
    numbers = {"rear_right": 1, "front_right": 2, "front_left": 3, "rear_left": 4}
    start = int(posts.MOTION_NS[0])
    scans = [(numbers[sensor], (stamp - start) // 1000, found.astype("f4")) for sensor, stamp, found in posts.scans()]
    times = np.array([stamp for _, stamp, _ in scans])
    odometry = np.zeros((len(scans), 5), dtype="f4")
    odometry[:, 0], odometry[:, 3] = posts.SPEED * times * 1e-6, posts.SPEED
    radarscenes_files.write_compact(radarscenes_files.Made(scans, times, odometry), path)
    arrays = dict(np.load(path)) | {"mount_x_y_yaw": np.array([(m.x, m.y, m.yaw) for m in (posts.MOUNTS[name] for name in numbers)])}
    np.savez(path, **arrays)
    return path


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What was hit often is occupied, what was looked at and not hit is free."""
    return str(write(tmp_path_factory.mktemp("model") / "net.onnx", *default(128, 30 / 128)))


def evaluate(kind: str, *sources: Path, model: str, out: Path, more: tuple[str, ...] = ()) -> tuple[dict[str, Any], str]:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    arguments = [kind, *map(str, sources), "--model", model, "--json", str(out / "deep" / "real.json"), "--out", str(out / "pictures")]
    tables = run(parser.parse_args([*arguments, *more]))
    return json.loads((out / "deep" / "real.json").read_text()), tables


def test_drives_are_scored_beside_each_other(model: str, tmp_path: Path) -> None:
    scene(tmp_path / "scene-0001.npz")
    scene(tmp_path / "scene-0002.npz")
    figures, tables = evaluate("nuscenes", tmp_path, model=model, out=tmp_path, more=("--scene", "scene-0001", "--scene", "scene-0002"))
    first, second = figures["drives"]
    assert (first["name"], second["name"]) == ("scene-0001", "scene-0002")
    assert first["driven_m"] == pytest.approx(posts.SPEED * posts.SECONDS, rel=0.05)
    left_out = sorted((stamp, sensor, len(found)) for sensor, stamp, found in posts.scans())[1::2]
    assert first["left_out"] == pytest.approx(sum(count for _, _, count in left_out), rel=0.1)  # scans at one time may come in either order
    assert list(first["methods"]) == ["elfes", "analytic", "looks", "learned"]
    for method, one in first["methods"].items():
        assert one["swept"] == 0, method
        assert one == second["methods"][method], method  # the same street, and thresholds chosen on the first fit the second
        for yardstick in ("elfes", "analytic"):
            theirs, mine = first["methods"][yardstick], one["against"][yardstick]
            assert mine["equal_area"]["covered_m2"] <= theirs["occupied"]["covered_m2"] + 1e-6
            assert mine["equal_free_area"]["free_m2"] <= theirs["free"]["free_m2"] + 1e-6
            assert mine["equal_area"]["recall"] <= one["within_reach"]
        assert one["against"]["elfes"]["equal_area"]["recall"] > 0.8, method  # the posts stand where they stood
    summed = {(one["method"], one["yardstick"]): one for one in figures["summaries"]}
    ratio = first["methods"]["looks"]["against"]["elfes"]["equal_area"]["recall"] / first["methods"]["elfes"]["occupied"]["recall"]
    assert summed["looks", "elfes"]["recall"] == pytest.approx(ratio)
    assert summed["looks", "elfes"]["recall_first"] == pytest.approx(ratio)
    assert len(summed) == 6
    assert f"| scene-0002 | looks | {first['methods']['looks']['swept']:.3%} |" in tables
    for name in ("scene-0001", "scene-0002"):
        with Image.open(tmp_path / "pictures" / f"{name}.png") as picture:
            assert min(picture.size) > 300


def test_a_sequence_gives_the_scores_of_the_same_street(model: str, tmp_path: Path) -> None:
    figures, tables = evaluate("radarscenes", sequence(tmp_path / "seq_1.npz"), model=model, out=tmp_path, more=("--sum",))
    (drive,) = figures["drives"]
    assert drive["name"] == "radarscenes-seq_1"
    assert list(drive["methods"]) == ["elfes", "analytic", "looks", "learned", "sum"]
    assert all(one["against"]["elfes"]["equal_area"]["recall"] > 0.8 for name, one in drive["methods"].items() if name != "sum")
    assert all(one["swept"] == 0 for one in drive["methods"].values())
    assert figures["summaries"][0]["recall_first"] is None  # there is no other than the first
    assert "nan" not in tables
    assert "net.onnx" in figures["model"]


def test_frames_are_scored_in_both_places(model: str, tmp_path: Path) -> None:
    figures, tables = evaluate("astyx", astyx_files.write_file(tmp_path / "two.npz"), model=model, out=tmp_path)
    assert [(one["name"], one["place"], one["frames"]) for one in figures["frames"]] == [("two", "whole", 2), ("two", "near", 2)]
    assert figures["frames"][0]["cells"] > figures["frames"][1]["cells"]
    assert tables.count("\n") == 1 + 2 * 5
    assert (tmp_path / "pictures" / "two_near.png").exists()


def test_an_analytic_model_is_no_network(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        evaluate("astyx", tmp_path / "none.npz", model="analytic", out=tmp_path)
    assert "'analytic' found, expected default, paper, or the path of an .onnx file" in capsys.readouterr().err


def test_a_model_that_is_mistyped_is_told_the_one_that_is_meant() -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="'defualt' found, expected default, paper, or .*; did you mean 'default'?"):
        named("defualt")


def test_a_drive_without_places_and_a_file_that_is_no_network_are_one_sentence(model: str, tmp_path: Path) -> None:
    path = sequence(tmp_path / "seq_1.npz")
    arrays = dict(np.load(path))
    for sensor in (1, 2, 3, 4):
        arrays[f"radar{sensor}_odom"][:, 1] += 1000.0  # s: the odometry is of another hour
    np.savez(path, **arrays)
    with pytest.raises(EchogridError, match="^radarscenes-seq_1: none of its scans is between samples of speed and yaw rate"):
        evaluate("radarscenes", path, model=model, out=tmp_path)
    (tmp_path / "net.onnx").write_text("no network")
    with pytest.raises(EchogridError, match="net.onnx: is not an ONNX model that onnxruntime reads: "):
        evaluate("radarscenes", path, model=str(tmp_path / "net.onnx"), out=tmp_path)


def test_json_has_no_word_for_infinity() -> None:
    assert finite({"a": (1.0, -math.inf), "b": [{"c": math.nan}], "d": "x", "e": 3}) == {
        "a": [1.0, None],
        "b": [{"c": None}],
        "d": "x",
        "e": 3,
    }
