"""The maps that are judged are the service's, bit for bit, and the probes leave them as they should."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
import pytest
from tests.support.networks import paper, write

from echogrid.config.loading import load_config
from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid.core.messages import RadarScan
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid_training.evaluation.simulated import probes
from echogrid_training.evaluation.simulated.baselines import Elfes
from echogrid_training.evaluation.simulated.learned import File, Key, Network, networks
from echogrid_training.evaluation.simulated.maps import (
    ELFES,
    GEOMETRY,
    TUNED,
    Geometry,
    Row,
    View,
    drive_through,
    geometric_layer,
    learned_layer,
    rows,
)
from echogrid_training.evaluation.simulated.tape import Tape, play

OTHERS = tuple(
    Elfes(False, BeamModel(free=free, beam_sigma=sigma), clamp) for free, sigma, clamp in ((-0.3, 0.04, 2.0), (-0.12, 0.018, 1e6))
)


@pytest.fixture(scope="module")
def learned(room_tape: Tape, network_file: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[Key, Network]:
    graph, contract = paper(128, 30.0 / 128)
    other = write(tmp_path_factory.mktemp("paper") / "paper.onnx", graph, contract | {"class_shares": (0.6, 0.35, 0.05)})
    return networks([File("tiny", network_file), File("paper", other)], room_tape.mounts)


@pytest.fixture(scope="module")
def driven(room_tape: Tape, learned: dict[Key, Network]) -> tuple[list[Row], list[View]]:
    of = rows(room_tape, Geometry(room_tape), learned, OTHERS)
    return of, list(drive_through(room_tape, of))


def served(folder: Path, model: str, fusion: Literal["sum", "looks"], clamp: float = 3.5, **beam: float) -> Pipeline:
    drive = find_drive(folder, None)
    config = load_config(drive.config, model)
    config = msgspec.structs.replace(config, map=msgspec.structs.replace(config.map, fusion=fusion, clamp=clamp))
    config = msgspec.structs.replace(config, sensor_model=msgspec.structs.replace(config.sensor_model, **beam))
    pipeline = Pipeline(config, drive.config)
    for _ in pipeline.updates(Log(drive.log).batches()):
        pass
    return pipeline


def test_maps_are_the_services(room_drive: Path, driven: tuple[list[Row], list[View]], learned: dict[Key, Network]) -> None:
    by_key = {row.key: row.mapper.map for row in driven[0]}
    tiny, other = (str(network.model.path) for network in learned.values())
    for key, model, fusion in (
        ((ELFES, 0), "analytic", "sum"),
        (("tiny, looks", 0), tiny, "looks"),
        (("tiny, sum", 0), tiny, "sum"),
        (("paper, sum", 0), other, "sum"),
    ):
        expected = served(room_drive, model, fusion).mapper.map  # type: ignore[arg-type]
        row, column, log_odds = by_key[key].whole()
        assert (row, column) == expected.whole()[:2]
        np.testing.assert_array_equal(log_odds, expected.whole()[2], err_msg=str(key))


def test_a_sum_without_clamp_is_the_services_with_a_clamp_that_nothing_reaches(
    room_drive: Path, driven: tuple[list[Row], list[View]], learned: dict[Key, Network]
) -> None:
    by_key = {row.key: row.mapper.map for row in driven[0]}
    other = str(learned["paper", 0].model.path)
    found = by_key["paper, sum without clamp", 0].whole()[2]
    np.testing.assert_array_equal(found, served(room_drive, other, "sum", 1e6).mapper.map.whole()[2])
    assert np.abs(found).max() > 10 * 3.5
    assert np.abs(by_key["paper, sum", 0].whole()[2]).max() == 3.5


def test_other_beams_and_clamps_are_what_the_service_makes_of_them(room_drive: Path, driven: tuple[list[Row], list[View]]) -> None:
    of = {row.key: row for row in driven[0]}
    for index, elfes in enumerate(OTHERS):
        beam = {"free": elfes.beam.free, "beam_sigma_deg": float(np.degrees(elfes.beam.beam_sigma))}
        expected = served(room_drive, "analytic", "sum", elfes.clamp, **beam).mapper.map
        row, column, log_odds = expected.whole()
        found = of[TUNED, index]
        assert not found.published
        window = found.read(found.mapper.map.window_of_layers(row, column, *log_odds.shape))
        np.testing.assert_allclose(window, log_odds, atol=1e-5)
        assert np.count_nonzero(window) == np.count_nonzero(found.mapper.map.window_of_layers(*found.mapper.map.bounds())[index])


def test_views_are_five_metres_apart_and_then_of_the_finished_map(driven: tuple[list[Row], list[View]]) -> None:
    of, views = driven
    assert [view.level for view in views] == ["around", "around", "finished", "finished", "finished"]  # 14 m
    assert set(views[0].scores) == {row.key for row in of}
    for early, late in zip(views[:2], views[3:], strict=True):
        np.testing.assert_array_equal(early.place.truth, late.place.truth)
        assert (early.scores[ELFES, 0] != late.scores[ELFES, 0]).any()


def test_layers_alone(driven: tuple[list[Row], list[View]]) -> None:
    """Where nothing was measured, the network is believed in part; what was measured is told wherever it was."""
    of, views = driven
    scores = views[-1].scores
    mean, both, measured = (scores[key] for key in (("tiny, learned layer of looks", 0), ("tiny, looks", 0), (GEOMETRY, 0)))
    alone = (mean != 0) & (measured == 0)
    assert alone.any()
    assert (np.abs(both[alone]) < np.maximum(np.abs(mean[alone] - 0.25), 0.5)).all()
    assert ((measured != 0) <= (both != 0)).all()
    layers = np.array((6.0, 2.0, 0.0, 0.0, 5.0), dtype=np.float32)[:, None, None]
    assert learned_layer(layers) == 3.0
    assert geometric_layer(layers) < -0.5  # five looks passed
    assert [row.published for row in of] == [True, False, False, *(True, True, False, False), False, *(True, True, False, False)]


def test_a_standing_car_learns_nothing_by_looks(room_tape: Tape, learned: dict[Key, Network], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probes, "STANDING", 4)
    changes = probes.standstill(room_tape, Geometry(room_tape), learned)
    assert set(changes) == {(ELFES, 0), ("tiny, looks", 0), ("tiny, sum", 0), ("paper, looks", 0), ("paper, sum", 0)}
    assert changes["tiny, looks", 0] == changes["paper, looks", 0] == 0.0
    assert 0 < changes[ELFES, 0] < 1


def test_what_a_standing_car_hears(room_tape: Tape) -> None:
    """As many scans a second as before, of what was measured last, with no range rate; and it stays where it is."""
    before = room_tape.events[: len(room_tape.events) // 2]
    seconds = list(probes.standing(before, 3))
    heard = [item for event in before for item in event.items if isinstance(item, RadarScan)]
    for events in seconds:
        scans = [item for event in events for item in event.items if isinstance(item, RadarScan)]
        assert len(scans) == sum(scan.received_ns > before[-1].now_ns - 1_000_000_000 for scan in heard)
        assert not any(scan.range_rate.any() for scan in scans)
        last = {scan.sensor: scan for scan in heard}
        assert all(scan.range is last[scan.sensor].range for scan in scans)
    (row,) = rows(room_tape, Geometry(room_tape), {}, ())
    list(play([*before, *probes.braking(before)], [row.mapper]))
    there = row.mapper.odometry.states[-1]  # where the braking ends
    places = [ego.odom_from_base for events in seconds for ego in play(events, [row.mapper])]
    assert np.hypot(places[-1].x - there.odom_from_base.x, places[-1].y - there.odom_from_base.y) < 0.2
    assert places[-1] == places[5]


def test_a_cold_start_is_judged_as_looks_come(room_tape: Tape, learned: dict[Key, Network], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probes, "STARTS", (0.3, 0.9))
    found = list(probes.cold_starts(room_tape, Geometry(room_tape), learned))
    assert [looks for looks, _ in found] == [1, 3, 10, 1]  # the second start is 1.4 m before the end
    known = [np.count_nonzero(view.scores[ELFES, 0]) for _, view in found]
    assert known[0] < known[1] < known[2]


def test_the_second_time_round_adds_to_the_same_map(room_tape: Tape) -> None:
    of = rows(room_tape, Geometry(room_tape), {}, ())
    first = [view for view in drive_through(room_tape, of) if view.level == "finished"]
    second = list(probes.revisits(room_tape, of))
    assert [view.level for view in second] == ["revisited"] * len(first)
    for one, two in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.place.truth, two.place.truth)
        assert ((one.scores[ELFES, 0] != 0) <= (two.scores[ELFES, 0] != 0)).all()  # what is known stays known
        assert (one.scores[ELFES, 0] != two.scores[ELFES, 0]).any()
