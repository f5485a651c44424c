"""The radars against geometry, and their counts and errors against what was drawn."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.support.tiny_towns import box, car_mover, line, room, street, town, track

from echogrid.core.messages import RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import static_range_rate
from echogrid_training.drives.simulate import simulate
from echogrid_training.sensors.episode import NEAR, Episode, RadarType, draw_episode, paper_like
from echogrid_training.sensors.ghosts import ghosts
from echogrid_training.sensors.radar_model import (
    ECHO,
    Sensitivity,
    Sensor,
    Surroundings,
    clutter,
    echoes,
    measure,
    merge,
    patchiness,
    rounded,
    sense,
    sensor_at,
)
from echogrid_training.sensors.scatterers import SCATTERER, box_around, car, placed, points
from echogrid_training.sensors.surfaces import flats
from echogrid_training.sensors.visibility import Traffic, nearest_points, poses_at
from echogrid_training.towns.town import Material, Thing, Town, Track

H = 1e-4  # s, of finite differences
NO_LOSS = (np.zeros((0, 2, 2)), np.zeros(0))


def ideal(episode: Episode) -> Episode:
    """The same car without errors, ghosts and clutter."""
    errors = ("range_sigma", "azimuth_sigma", "range_rate_sigma", "tails", "azimuth_outliers", "doppler_outliers", "jitter")
    quiet = dict.fromkeys(errors, 0.0)
    return replace(episode, radar=replace(episode.radar, **quiet), ghosts=0.0, clutter=0.0, ground=0.0, dropped=0.0)


def sensor(path: Track, time: float, base_from_sensor: SE2) -> Sensor:
    pose = poses_at(path, np.array([time]))
    return sensor_at(
        SE2(*(float(v[0]) for v in (pose.x, pose.y, pose.yaw))), base_from_sensor, float(pose.speed[0]), float(pose.yaw_rate[0])
    )


def in_world(scan: RadarScan, episode: Episode, recording_pose: SE2) -> np.ndarray:
    mount = next(corner.mount for corner in episode.corners if corner.mount.name == scan.sensor)
    in_sensor = np.stack((scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth)), axis=-1)
    return (recording_pose @ mount.base_from_sensor).apply(in_sensor)


def scans_of(place: Town, episode: Episode) -> list[RadarScan]:
    return simulate(place, episode)[0].scans


@pytest.mark.parametrize("corner", paper_like().corners, ids=lambda corner: corner.mount.name)
@pytest.mark.parametrize("moving", [False, True])
def test_range_rate_is_the_derivative_of_range(corner: object, moving: bool) -> None:
    """For scatterers all around a car that turns, standing or on a car that turns the other way."""
    ego, time = track(4.0, 7.0, 0.4), 2.0
    mount = corner.mount.base_from_sensor  # type: ignore[attr-defined]
    other = track(4.0, 9.0, -0.5, x=12.0, y=-4.0, yaw=2.0) if moving else track(4.0, 0.0, 0.0, x=12.0, y=-4.0, yaw=2.0)
    rng = np.random.default_rng(0)
    body = points(rng.uniform(-15.0, 15.0, (200, 2)), rng, rcs=60.0)
    body["luck"] = np.arange(200)  # to know them again
    all_round = RadarType(half_fov=math.pi, beam=1e3)

    def heard(at: float) -> dict[float, tuple[float, float]]:
        there = poses_at(other, np.array([at]))
        state = (float(getattr(there, name)[0]) for name in ("x", "y", "yaw", "speed", "yaw_rate"))
        found, rows = echoes(placed(body, *state), sensor(ego, at, mount), all_round, 60.0)
        return {float(luck): (float(echo["range"]), float(echo["range_rate"])) for luck, echo in zip(rows["luck"], found, strict=True)}

    before, now, after = heard(time - H), heard(time), heard(time + H)
    assert len(now) > 150
    for luck, (range_, rate) in now.items():
        if range_ > 1.0:
            assert rate == pytest.approx((after[luck][0] - before[luck][0]) / (2 * H), abs=1e-4)


def test_mirrored_range_rates_are_the_derivative_of_the_mirrored_range() -> None:
    """A car that drives beside a wall, seen in it."""
    wall = flats((line(Material.BUILDING, (-60.0, 9.0), (60.0, 9.0)),), np.random.default_rng(0))
    ego, other = track(2.0, 6.0, 0.1), track(2.0, 8.0, 0.2, x=6.0, y=-2.0)
    body = car(4.5, 1.8, np.random.default_rng(1))
    body["luck"] = np.linspace(0.01, 0.9, len(body))
    body["width"] = np.inf

    def heard(time: float) -> dict[float, tuple[float, float]]:
        there = poses_at(other, np.array([time]))
        here = sensor(ego, time, SE2(3.5, 0.8, 0.5))
        rows = placed(body, *(float(getattr(there, name)[0]) for name in ("x", "y", "yaw", "speed", "yaw_rate")))
        images = ghosts(rows, 1.0, wall, np.arange(1), NO_LOSS, here.place)
        assert (images["y"] > 9.0).all()
        found, rows = echoes(images, here, RadarType(half_fov=math.pi, beam=1e3), 90.0)
        return {float(luck): (float(echo["range"]), float(echo["range_rate"])) for luck, echo in zip(rows["luck"], found, strict=True)}

    before, now, after = heard(1.0 - H), heard(1.0), heard(1.0 + H)
    assert len(now) == len(body)
    for luck, (_, rate) in now.items():
        assert rate == pytest.approx((after[luck][0] - before[luck][0]) / (2 * H), abs=1e-4)


def test_the_image_of_a_standing_thing_has_the_path_length_by_the_wall() -> None:
    """Fermat: the way by the mirror is as long as the way to the image; and nothing appears beside the mirror's end."""
    wall = flats((line(Material.WALL, (0.0, 5.0), (10.0, 5.0)),), np.random.default_rng(0))
    rows = points(np.array(((8.0, 1.0), (40.0, 1.0))), np.random.default_rng(2), rcs=0.0)
    origin = np.array((2.0, 2.0))
    (image,) = ghosts(rows, 1.1, wall, np.arange(1), NO_LOSS, origin)
    on_wall = np.stack((np.linspace(0.0, 10.0, 100_001), np.full(100_001, 5.0)), axis=-1)
    by_wall = np.hypot(*(on_wall - origin).T) + np.hypot(*(on_wall - (8.0, 1.0)).T)
    assert math.dist((image["x"], image["y"]), origin) == pytest.approx(by_wall.min(), abs=1e-6)
    hidden = (np.array((((0.0, 3.0), (10.0, 3.0)),)), np.array((200.0,)))
    assert len(ghosts(rows, 1.1, wall, np.arange(1), hidden, origin)) == 0


def test_an_ideal_radar_sees_a_room_on_its_walls() -> None:
    episode = ideal(paper_like(3))
    walls = room()[0].segments()
    found = 0
    for scan in scans_of(town(*room()), episode):
        places = in_world(scan, episode, SE2(0.0, 0.0, 0.0))
        away = [np.hypot(*(nearest_points(walls, place) - place).T).min() for place in places]
        assert np.max(away, initial=0.0) < 1e-6
        assert (np.abs(scan.azimuth) <= episode.radar.half_fov).all()
        np.testing.assert_array_equal(scan.range_rate, 0.0)
        found += len(scan)
    assert found > 500


def test_an_ideal_radar_under_way_shows_standing_things_as_the_gate_expects_them() -> None:
    episode, ego = ideal(paper_like(3)), track(1.0, 6.0, 0.3)
    recording, _ = simulate(town(*room(60.0, 40.0), box(Material.POLE, 9.0, 6.0, 0.2, 0.2), ego=ego), episode)
    checked = 0
    for scan in recording.scans:
        mount = next(corner.mount for corner in episode.corners if corner.mount.name == scan.sensor)
        expected, _ = static_range_rate(scan.azimuth, Mount(mount.base_from_sensor, mount.fov / 2, 60.0), 6.0, 0.3)
        np.testing.assert_allclose(scan.range_rate, expected, atol=1e-9)
        checked += len(scan)
    assert checked > 100


def test_walls_hide_and_cars_do_not_quite() -> None:
    """A strong reflector behind a wall is never seen, one behind a car now and then."""
    place = box(Material.POLE, 12.0, 0.0, 0.2, 0.2)
    shield = {material: box(material, 8.0, 0.0, 1.8, 4.5, top=1.5) for material in (Material.WALL, Material.CAR)}
    ahead = replace(
        paper_like(),
        corners=(replace(paper_like().corners[0], mount=replace(paper_like().corners[0].mount, base_from_sensor=SE2(0, 0, 0))),) * 4,
    )
    seen = {}
    for material, thing in shield.items():
        surroundings = Surroundings(town(thing, place), 60.0)
        surroundings.scatterers["rcs"][surroundings.scatterers["x"] > 11.9] = 10.0
        nobody, rng = Traffic((), np.zeros(1)).at(0), np.random.default_rng(0)
        here = Sensor(0.0, 0.0, 0.0, 0.0, 0.0)
        scans = [sense(surroundings, nobody, here, ahead.corners[0], ideal(ahead), Sensitivity(33.0), rng) for _ in range(30)]
        seen[material] = sum(int(((scan.range > 11.5) & (scan.range < 12.5)).any()) for scan in scans)
    assert seen[Material.WALL] == 0
    assert seen[Material.CAR] > 0


def test_azimuth_is_positive_to_the_left() -> None:
    left = line(Material.BUILDING, (-20.0, 6.0), (20.0, 6.0))
    episode = ideal(paper_like())
    ahead = tuple(replace(corner, mount=replace(corner.mount, base_from_sensor=SE2(0.0, 0.0, 0.0))) for corner in episode.corners)
    scans = scans_of(town(left), replace(episode, corners=ahead))  # type: ignore[arg-type]
    assert sum(len(scan) for scan in scans) > 50
    assert all((scan.azimuth > 0).all() for scan in scans)


def test_the_strongest_of_each_cell_is_left() -> None:
    """Against a loop over pairs that share a cell in all three."""
    rng = np.random.default_rng(0)
    found = np.zeros(300, dtype=ECHO)
    found["range"], found["azimuth"] = rng.uniform(1.0, 20.0, 300), rng.uniform(-1.2, 1.2, 300)
    found["range_rate"], found["snr"] = rng.uniform(-2.0, 2.0, 300), rng.permutation(300)
    radar = RadarType(range_resolution=1.0, range_rate_resolution=0.5, azimuth_resolution=0.3)
    cells = [
        (math.floor(one["range"] / 1.0), math.floor(one["range_rate"] / 0.5), math.floor(math.sin(one["azimuth"]) / math.sin(0.3)))
        for one in found
    ]
    strongest: dict[tuple[int, int, int], float] = {}
    for cell, one in zip(cells, found, strict=True):
        strongest[cell] = max(strongest.get(cell, -1.0), float(one["snr"]))
    assert sorted(merge(found, radar, np.zeros(3))["snr"].tolist()) == sorted(strongest.values())
    assert len(strongest) < 300


def test_a_cluster_lies_at_the_centroid_of_the_power_in_its_cell() -> None:
    """Against a sum over each cell's echoes; which echoes are left does not change."""
    rng = np.random.default_rng(1)
    found = np.zeros(200, dtype=ECHO)
    found["range"], found["azimuth"], found["snr"] = rng.uniform(1.0, 6.0, 200), rng.uniform(-1.0, 1.0, 200), rng.uniform(10.0, 30.0, 200)
    radar = RadarType(range_resolution=1.0, azimuth_resolution=0.3, centroids=True)
    strongest, clusters = (np.sort(merge(found, one, np.zeros(3)), order="snr") for one in (replace(radar, centroids=False), radar))
    np.testing.assert_array_equal(clusters["snr"], strongest["snr"])
    for cluster, best in zip(clusters, strongest, strict=True):
        cell = (math.floor(best["range"]), math.floor(math.sin(best["azimuth"]) / math.sin(0.3)))
        echoes_of = [one for one in found if (math.floor(one["range"]), math.floor(math.sin(one["azimuth"]) / math.sin(0.3))) == cell]
        power = sum(10 ** (one["snr"] / 10) for one in echoes_of)
        for name in ("range", "azimuth"):
            assert cluster[name] == pytest.approx(sum(10 ** (one["snr"] / 10) * one[name] for one in echoes_of) / power)


def test_clusters_lie_between_the_echo_and_the_middle_of_its_body() -> None:
    """On that line in the world, evenly from the echo to the share at most; what has no body stays where it is."""
    rng = np.random.default_rng(2)
    middle = np.array((14.0, 6.0))
    body = placed(car(4.5, 1.8, rng), float(middle[0]), float(middle[1]), 0.7)
    here, radar = Sensor(0.0, 0.0, 0.2, 0.0, 0.0), RadarType(half_fov=math.pi, beam=1e3, inward=0.8, tails=0.0)
    quiet = replace(radar, range_sigma=0.0, azimuth_sigma=0.0, azimuth_outliers=0.0)
    found, rows = echoes(np.repeat(body, 200), here, quiet, 90.0)
    seen = measure(found, replace(paper_like().corners[0], azimuth_bias=0.0, ripple=0.0), quiet, rng)
    bearing = seen["azimuth"] + here.yaw
    away = seen["range"] - rows["beyond"]
    places = np.stack((away * np.cos(bearing), away * np.sin(bearing)), axis=-1)
    from_echo = np.stack((rows["x"], rows["y"]), axis=-1)
    way = middle - from_echo
    far = np.hypot(*way.T)
    share = ((places - from_echo) * way).sum(axis=1)[far > 0.5] / far[far > 0.5] ** 2
    across = np.abs(way[:, 0] * (places - from_echo)[:, 1] - way[:, 1] * (places - from_echo)[:, 0])[far > 0.5] / far[far > 0.5]
    assert across.max() < 0.2  # an arc for a chord
    assert np.quantile(share, (0.02, 0.5, 0.98)) == pytest.approx((0.016, 0.4, 0.784), abs=0.05)
    post, _ = echoes(points(np.array(((9.0, 3.0),)), rng, rcs=30.0), here, quiet, 90.0)
    assert measure(post, replace(paper_like().corners[0], azimuth_bias=0.0), quiet, rng)["range"] == pytest.approx(math.hypot(9.0, 3.0))


def test_detours_and_a_bias_make_things_look_farther() -> None:
    count, radar = 20_000, RadarType(range_sigma=0.0, detour=0.4)
    true = np.zeros(count, dtype=ECHO)
    true["range"], true["snr"] = 10.0, 60.0
    seen = measure(true, replace(paper_like().corners[0], range_bias=0.2), radar, np.random.default_rng(3))["range"] - 10.0
    assert seen.min() >= 0.2
    assert seen.mean() == pytest.approx(0.6, rel=0.03)
    assert np.median(seen) == pytest.approx(0.2 + 0.4 * math.log(2.0), rel=0.03)  # exponential


def test_what_reflects_more_than_its_kind_does_so_as_a_whole() -> None:
    """Of sigma 1 over the plane; half a metre on it is nearly the same, twenty metres on another one."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-200.0, 200.0, (2, 4000))
    here = patchiness(x, y)
    assert here.mean() == pytest.approx(0.0, abs=0.1)
    assert here.std() == pytest.approx(1.0, abs=0.1)
    assert np.corrcoef(here, patchiness(x + 0.4, y - 0.3))[0, 1] > 0.9
    assert abs(np.corrcoef(here, patchiness(x - 12.0, y + 16.0))[0, 1]) < 0.4


def test_motion_tells_directions_apart() -> None:
    """The same two reflections at equal range: one detection at standstill by a single beam, two under way."""
    rows = points(np.array(((8.0, 4.0), (8.0, -4.0))), np.random.default_rng(0), rcs=30.0)
    radar = RadarType(azimuth_resolution=math.pi, fading=0.0)
    counts = []
    for speed in (0.0, 8.0):
        here = Sensor(0.0, 0.0, 0.0, 0.6 * speed, 0.8 * speed)
        found, _ = echoes(rows, here, radar, 33.0)
        counts.append(len(merge(found, radar, np.full(3, 0.1))))
    assert counts == [1, 2]


@pytest.mark.parametrize("strongest_first", [False, True])
def test_a_scan_has_no_more_than_the_most(strongest_first: bool) -> None:
    """The first of what a radar without a limit would report: the nearest, or else far walls are among them."""
    episode = replace(paper_like(2), density=64.0)
    all_, few = (
        scans_of(street(0.2), replace(episode, radar=replace(episode.radar, most=most, strongest_first=strongest_first)))
        for most in (64, 10)
    )
    assert max(len(scan) for scan in all_) <= 64
    for whole, first in zip(all_, few, strict=True):
        assert len(first) == min(len(whole), 10)
        np.testing.assert_array_equal(first.range, whole.range[:10])
        assert strongest_first or (np.diff(whole.range) >= 0).all()
    assert (np.mean([scan.range.max() for scan in few]) > 10.0) == strongest_first


@pytest.mark.parametrize(("density", "thinning"), [(2.0, 0.0), (2.0, 1.0), (8.0, 0.5), (24.0, 1.0), (45.0, 0.0)])
def test_the_count_is_the_drawn_density(density: float, thinning: float) -> None:
    recording, _ = simulate(street(1.0), replace(paper_like(5), density=density, thinning=thinning))
    assert np.mean([(scan.range < NEAR).sum() for scan in recording.scans]) == pytest.approx(density, rel=0.2)


def test_the_same_seeds_give_the_same_bits() -> None:
    def bits(seed: int, town_seed: int = 3) -> bytes:
        recording, truth = simulate(street(0.5, seed=town_seed), draw_episode(seed, "street"))
        scans = [np.concatenate((scan.range, scan.azimuth, scan.range_rate, scan.rcs, [scan.stamp_ns])) for scan in recording.scans]
        return b"".join((*(scan.tobytes() for scan in scans), recording.motion.wheel_speed.tobytes(), truth.log_odds.tobytes()))

    first = bits(1)
    assert bits(1) == first
    assert len({first, bits(2), bits(1, town_seed=4)}) == 3


def test_errors_have_their_size() -> None:
    count, corner = 20_000, paper_like().corners[0]
    true = np.zeros(count, dtype=ECHO)
    true["range"], true["snr"], true["azimuth"] = 15.0, 30.0, np.radians(45.0)
    radar = RadarType(tails=0.0, azimuth_outliers=0.0, doppler_outliers=0.1)
    found = measure(true, replace(corner, azimuth_bias=0.01, range_rate_bias=0.1), radar, np.random.default_rng(0))
    assert (found["range"] - 15.0).std() == pytest.approx(radar.range_sigma, rel=0.05)
    assert found["azimuth"].mean() - math.radians(45.0) == pytest.approx(0.01, abs=1e-3)
    assert found["azimuth"].std() == pytest.approx(math.radians(1.0), rel=0.05)
    gross = np.abs(found["range_rate"] - 0.1) > 5 * radar.range_rate_sigma
    assert gross.mean() == pytest.approx(0.1, abs=0.02)
    assert found["range_rate"][~gross].mean() == pytest.approx(0.1, abs=0.01)
    at_edge = true.copy()
    at_edge["azimuth"] = np.radians(70.0)
    assert measure(at_edge, corner, radar, np.random.default_rng(0))["azimuth"].std() > 3 * math.radians(1.0)


def test_range_rates_are_folded_and_places_rounded() -> None:
    episode = paper_like(4)
    coarse = replace(episode, radar=replace(episode.radar, ambiguity=10.0, position_step=0.2))
    scans = scans_of(street(1.0, speed=14.0), coarse)
    rates = np.concatenate([scan.range_rate for scan in scans])
    assert np.abs(rates).max() <= 5.0
    assert all(scan.ambiguity == 10.0 for scan in scans)
    x = np.concatenate([scan.range * np.cos(scan.azimuth) for scan in scans])
    np.testing.assert_allclose(x / 0.2, np.round(x / 0.2), atol=1e-6)
    assert rounded(np.array([3.0]), np.array([0.5]), 0.0) == (3.0, 0.5)


def test_what_is_lost_is_not_sent_and_what_is_blocked_says_so() -> None:
    episode = paper_like(6)
    first, second, *others = episode.corners
    faulty = replace(episode, corners=(replace(first, lost=(0.5, 1.0)), replace(second, blockage=0.9), *others), dropped=0.0)
    recording, _ = simulate(street(1.0), faulty)
    by_radar = {
        name: [scan for scan in recording.scans if scan.sensor == name] for name in (corner.mount.name for corner in episode.corners)
    }
    assert [len(scans) for scans in by_radar.values()] == [10, 20, 20, 20]
    assert all(scan.blockage == 0.9 for scan in by_radar["front_right"])
    assert np.mean([len(scan) for scan in by_radar["front_right"]]) < 0.4 * np.mean([len(scan) for scan in by_radar["rear_left"]])
    dropped, _ = simulate(town(*room(), ego=track(2.0)), replace(episode, dropped=0.3))
    assert 80 < len(dropped.scans) < 140


def test_radars_keep_their_own_time() -> None:
    recording, _ = simulate(town(*room()), paper_like(1))
    stamps = {
        corner.mount.name: [scan.stamp_ns for scan in recording.scans if scan.sensor == corner.mount.name]
        for corner in paper_like().corners
    }
    phases = {name: (times[0] - recording.truth.stamp_ns[0]) / 50e6 for name, times in stamps.items()}
    assert len({round(phase, 1) for phase in phases.values()}) == 4
    for times in stamps.values():
        steps = np.diff(times) / 1e9
        assert 0.048 <= steps.min() < 0.05 < steps.max() <= 0.1021  # one may have been dropped
        assert steps.std() > 0


def test_fading_lasts_for_a_part_of_a_metre() -> None:
    """The correlation of a scatterer's strength: nearly one after a centimetre, nearly none after a metre, and one at standstill."""
    rng = np.random.default_rng(0)
    rows = points(np.stack((np.full(4000, 20.0), np.zeros(4000)), axis=-1), rng, rcs=0.0)

    def strength(x: float) -> np.ndarray:
        found, _ = echoes(rows, Sensor(0.0, x, 0.0, 0.0, 0.0), RadarType(), 60.0)
        return np.asarray(found["snr"])

    assert np.corrcoef(strength(0.0), strength(0.01))[0, 1] > 0.99
    assert np.corrcoef(strength(0.0), strength(0.3))[0, 1] == pytest.approx(math.exp(-0.5), abs=0.06)
    assert abs(np.corrcoef(strength(0.0), strength(1.5))[0, 1]) < 0.06
    assert strength(0.0).std() == pytest.approx(4.0, rel=0.05)
    np.testing.assert_array_equal(strength(0.0), strength(0.0))


def test_movers_are_seen_with_their_own_motion() -> None:
    oncoming = car_mover(track(1.0, 10.0, x=20.0, yaw=math.pi))
    episode = ideal(paper_like(2))
    ahead = tuple(replace(corner, mount=replace(corner.mount, base_from_sensor=SE2(0.0, 0.0, 0.0))) for corner in episode.corners)
    scans = scans_of(town(movers=(oncoming,), ego=track(1.0, 5.0)), replace(episode, corners=ahead))  # type: ignore[arg-type]
    rates = np.concatenate([scan.range_rate for scan in scans])
    assert len(rates) > 20
    assert (rates < -13.0).all()


def test_clutter_is_as_much_as_drawn() -> None:
    episode, here = replace(paper_like(), clutter=0.05, ground=0.02, density=20.0), Sensor(0.0, 0.0, 0.0, 5.0, 0.0)
    rng = np.random.default_rng(0)
    found = np.concatenate([clutter(here, episode, 33.0, rng) for _ in range(2000)])
    assert (found["range"] < NEAR).sum() / 2000 == pytest.approx(20.0 * 0.07, rel=0.05)
    standing = np.isclose(found["range_rate"], -5.0 * np.cos(found["azimuth"]))
    assert 0.5 < standing.mean() < 0.75


def test_every_material_reflects_near_its_thing() -> None:
    for material in Material:
        thing = box(material, 3.0, -2.0, 4.5, 1.8, top=1.5, bottom=2.5 if material is Material.OVERHEAD else 0.0, yaw=0.4)
        rows = Surroundings(town(thing), 60.0).scatterers
        assert rows.dtype == SCATTERER
        assert len(rows) > 0
        assert (np.hypot(rows["x"] - 3.0, rows["y"] + 2.0) < 3.5).all()


def test_an_empty_town_is_silent() -> None:
    scans = scans_of(town(), ideal(paper_like()))
    assert len(scans) == 80
    assert sum(len(scan) for scan in scans) == 0


def test_the_box_around_an_outline() -> None:
    thing: Thing = box(Material.CAR, 3.0, -2.0, 4.5, 1.8, yaw=0.4)
    length, width, (x, y, yaw) = box_around(thing.outline)
    assert (length, width, x, y) == pytest.approx((4.5, 1.8, 3.0, -2.0))
    assert math.sin(yaw - 0.4) == pytest.approx(0.0, abs=1e-9)
