"""map_server files: pixels against nav2_map_server's rules written out one cell at a time; what it would refuse is one sentence."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from echogrid.core.map.tiled_map import probability
from echogrid.errors import EchogridError
from echogrid.maps import dense_map, map_server

TINY = np.finfo(np.float32).tiny
YAML = (
    "image: map.png\nmode: {mode}\nresolution: 0.25\norigin: [1.5, -2.0, 0.0]\nnegate: {negate}\n"
    "occupied_thresh: {occupied}\nfree_thresh: {free}\n"
)


def reference(picture: Path, mode: str, negate: bool, occupied: float, free: float) -> list[list[int]]:
    """Cells (H, W), lowest y first, one at a time after nav2's map_io of Jazzy 1.3.7 and later; floats of 32 bits, as there."""
    single = np.float32
    with Image.open(picture) as image:
        plain = image.convert("RGBA")
        rows = []
        for y in reversed(range(plain.height)):
            row = []
            for x in range(plain.width):
                red, green, blue, alpha = (Fraction(channel) for channel in plain.getpixel((x, y)))
                wide = math.floor((299 * red + 587 * green + 114 * blue) * 257 / 1000 + Fraction(1, 2))
                level = wide // 257
                occ = single(level) / single(255) if negate else single(1) - single(level) / single(255)
                if mode == "raw":
                    row.append(level if level <= 100 else -1)
                elif alpha < 255:
                    row.append(-1)
                elif occ <= single(free):
                    row.append(0)
                elif occ >= single(occupied):
                    row.append(100)
                elif mode == "trinary":
                    row.append(-1)
                else:
                    row.append(math.floor((occ - single(free)) / (single(occupied) - single(free)) * single(100) + single(0.5)))
            rows.append(row)
    return rows


@pytest.mark.parametrize("kind", ["L", "RGB", "RGBA", "LA", "P", "1"])
@pytest.mark.parametrize("mode", map_server.MODES)
@pytest.mark.parametrize(("negate", "occupied", "free"), [(0, 0.65, 0.25), (1, 0.65, 0.196), (0, 0.9, 0.0), (0, 0.5, 0.5)])
def test_pictures_are_read_as_nav2_reads_them(tmp_path: Path, kind: str, mode: str, negate: int, occupied: float, free: float) -> None:
    rng = np.random.default_rng(len(kind) + negate)
    colours = rng.integers(0, 256, (12, 23, 4), dtype=np.uint8)
    colours[:, :12, 3] = 255
    colours[:, 5:, :3] = colours[:, 5:, :1]  # most are grey
    image = Image.fromarray(colours)
    if kind == "LA":
        image = Image.merge("LA", (image.getchannel("R"), image.getchannel("A")))
    elif kind != "RGBA":
        image = image.convert("RGB").convert(kind)
    image.save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_text(YAML.format(mode=mode, negate=negate, occupied=occupied, free=free))
    expected = np.array(reference(tmp_path / "map.png", mode, bool(negate), occupied, free))
    header = map_server.read_header(tmp_path / "map.yaml")
    cells = map_server.cells_of(*map_server.load_picture(tmp_path / "map.png"), header)
    np.testing.assert_array_equal(cells, expected)
    assert len(np.unique(expected)) > 1
    read = map_server.read(tmp_path / "map.yaml")
    assert (read.origin, read.cell) == ((1.5, -2.0), 0.25)
    np.testing.assert_array_equal(read.log_odds == 0, expected == -1)
    known = expected >= 0
    p = np.clip(expected[known] / 100, 1 / (1 + math.exp(3.5)), 1 / (1 + math.exp(-3.5)))
    np.testing.assert_allclose(probability(read.log_odds[known].astype(float)), p, atol=1e-6)


@pytest.mark.parametrize("kind", ["png", "pgm", "tiff"])
def test_pictures_of_16_bits_are_those_of_8(tmp_path: Path, kind: str) -> None:
    """Levels that GraphicsMagick cuts to the same 8 bits are the same cells."""
    levels = np.random.default_rng(5).integers(0, 256, (7, 11), dtype=np.uint16)
    Image.fromarray(levels.astype(np.uint8)).save(tmp_path / "eight.png")
    wide = levels * 257 + np.random.default_rng(6).integers(0, 257, levels.shape, dtype=np.uint16) * (levels < 255)
    if kind == "pgm":
        (tmp_path / "wide.pgm").write_bytes(b"P5 11 7 65535\n" + wide.astype(">u2").tobytes())
    else:
        Image.fromarray(wide).save(tmp_path / f"wide.{kind}")
    for mode in map_server.MODES:
        cells = []
        for picture in ("eight.png", f"wide.{kind}"):
            text = YAML.format(mode=mode, negate=0, occupied=0.65, free=0.25).replace("map.png", picture)
            (tmp_path / "map.yaml").write_text(text)
            cells.append(map_server.read(tmp_path / "map.yaml").log_odds)
        np.testing.assert_array_equal(cells[0], cells[1])


@pytest.mark.parametrize(("alpha", "expected"), [(255, [100, 0, -1]), (254, [-1, -1, -1]), (0, [-1, -1, -1])])
@pytest.mark.parametrize("kind", ["RGBA", "LA", "P"])
def test_an_opaque_alpha_changes_nothing_and_what_shines_through_is_unknown(
    tmp_path: Path, kind: str, alpha: int, expected: list[int]
) -> None:
    """An editor saves alpha beside the greys of a saver, and erases to transparent black."""
    grey = Image.fromarray(np.array([[0, 254, 205]], np.uint8))
    if kind == "P":
        picture = grey.convert("P", palette=Image.Palette.ADAPTIVE)
        picture.save(tmp_path / "map.png", transparency=bytes([alpha] * 3))
    else:
        Image.merge("LA", (grey, Image.new("L", grey.size, alpha))).convert(kind).save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_text(YAML.format(mode="trinary", negate=0, occupied=0.65, free=0.196))
    header = map_server.read_header(tmp_path / "map.yaml")
    assert map_server.cells_of(*map_server.load_picture(header.image), header).tolist() == [expected]


def test_a_grey_on_a_threshold_belongs_to_it_and_colours_count_as_the_eye_sees_them(tmp_path: Path) -> None:
    """Nav2's `>=` and `<=`; pure green has the luma 149, yellow 225."""
    header = map_server.Header(tmp_path, "trinary", 0.05, (0.0, 0.0), False, 0.8, 0.2)
    opaque = np.ones((1, 2), dtype=bool)
    assert map_server.cells_of(np.array([[51, 204]], np.uint8), opaque, header).tolist() == [[100, 0]]
    assert map_server.luma(np.array([[[0, 255, 0], [255, 255, 0]]], np.uint8)).tolist() == [[149, 225]]
    every = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(map_server.luma(np.stack((every, every, every), axis=-1)), every)


@pytest.mark.parametrize(
    ("written", "negate"),
    [("0", False), ("1", True), ("2", True), ("-1", True), ("no", False), ("YES", True), ("Off", False), ("y", True), ("'true'", True)],
)
def test_yaml_as_yaml_has_it(tmp_path: Path, written: str, negate: bool) -> None:
    """Words for truth, any case of a mode, a byte order mark, a list over lines, anchors, keys of others with whatever they hold."""
    Image.fromarray(np.array([[0, 254]], np.uint8)).save(tmp_path / "map.png")
    text = (
        'site: &here\n  floor: 2\n  tags: [a, b]\nimage: "map.png"  # beside\nresolution: +.25\norigin: [-1.0,\n  -2.0, 0.0]\n'
        f"negate: {written}\noccupied_thresh: 65e-2\nfree_thresh: .196\nmode: SCALE\nnote: |\n  image: no.png\n  negate: 1\nmore: *here\n"
        "---\nimage: second.png\n"
    )
    for data in (text.encode(), text.encode("utf-8-sig"), text.encode("utf-16"), text.replace("\n", "\r\n").encode()):
        (tmp_path / "map.yaml").write_bytes(data)
        header = map_server.read_header(tmp_path / "map.yaml")
        assert header == map_server.Header(tmp_path / "map.png", "scale", 0.25, (-1.0, -2.0), negate, 0.65, 0.196)


def log_odds() -> np.ndarray:
    values = np.random.default_rng(3).normal(0, 2, (9, 14)).clip(-3.5, 3.5).astype(np.float32)
    values[::3] = 0
    values[1, 1] = TINY
    return values


def test_what_is_written_is_what_nav2_reads_back(tmp_path: Path) -> None:
    """By the slow rules: trinary keeps sides of thresholds, scale and raw the percent."""
    ours = log_odds()
    p, unknown = probability(ours.astype(float)), ours == 0
    for mode, expected in (
        ("trinary", np.where(p >= 0.5, 100, np.where(p <= 0.1, 0, -1))),
        ("scale", np.rint(100 * p)),
        ("raw", np.rint(100 * p)),
    ):
        yaml = tmp_path / f"{mode}.yaml"
        map_server.write(yaml, map_server.pixels_of(ours, mode), (0.5, -3.25), 0.25, mode)
        picture = map_server.picture_path(yaml, mode)
        assert sorted(path.name for path in tmp_path.glob(f"*{mode}*")) == sorted([yaml.name, picture.name])
        header = map_server.read_header(yaml)
        assert (header.image, header.mode, header.origin, header.cell, header.negate) == (picture, mode, (0.5, -3.25), 0.25, False)
        found = np.array(reference(picture, mode, False, header.occupied, header.free))
        # 255 levels of grey are a third of a percent wide, so that rounding twice may be one off.
        np.testing.assert_allclose(found, np.where(unknown, -1, expected), atol=1 if mode == "scale" else 0)
        np.testing.assert_array_equal(found == -1, np.where(unknown, -1, expected) == -1)


@pytest.mark.parametrize("mode", map_server.MODES)
def test_writing_what_was_read_changes_nothing(tmp_path: Path, mode: str) -> None:
    one, two = tmp_path / "one.yaml", tmp_path / "two.yaml"
    map_server.write(one, map_server.pixels_of(log_odds(), mode), (0.0, 0.0), 0.25, mode)
    read = map_server.read(one)
    map_server.write(two, map_server.pixels_of(read.log_odds, mode), read.origin, read.cell, mode)
    again = map_server.read(two)
    np.testing.assert_array_equal(read.log_odds, again.log_odds)
    assert (read.log_odds[1, 1] == TINY) == (mode != "trinary")  # even odds are known, but lie between trinary's thresholds


def test_yaml_as_other_savers_write_it(tmp_path: Path) -> None:
    """Comments, quotes, a list one item a line, no mode, a boolean, keys that are not ours."""
    Image.fromarray(np.array([[0, 254], [205, 0]], np.uint8)).save(tmp_path / "a map.pgm")
    (tmp_path / "map.yaml").write_text(
        "# saved\n---\nimage: 'a map.pgm'\nresolution: 5e-2\norigin:\n- -1.0\n- 2\n- 0.\nnegate: false  # or true\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\ncost_translation_table: none\n"
    )
    read = map_server.read(tmp_path / "map.yaml")
    assert (read.origin, read.cell) == ((-1.0, 2.0), 0.05)
    assert np.sign(read.log_odds).tolist() == [[0, 1], [1, -1]]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("image: map.png\n", "", "map.yaml: the key 'image' is missing, expected the yaml file of a map_server map"),
        ("image: map.png", "image: other.png", "other.png: the yaml file names this picture, but it does not exist"),
        ("image: map.png", "image: map.yaml", "map.yaml: is not a readable picture: cannot identify image file"),
        ("mode: raw", "mode: costmap", "map.yaml: mode: found 'costmap', expected one of trinary, scale, raw"),
        ("resolution: 0.25", "resolution: -1", "map.yaml: resolution: found -1, expected metres above 0"),
        ("resolution: 0.25", "resolution: fine", "map.yaml: resolution: found 'fine', expected a number"),
        (
            "0.0]",
            "0.5]",
            "map.yaml: origin: found the yaw 0.5, expected 0: write 0 there, import the map, rotate it with `echogrid map merge`",
        ),
        (", 0.0]", "]", "map.yaml: origin: found 2 numbers, expected three: x, y, yaw"),
        ("0.0]", ".nan]", "map.yaml: origin: found '.nan', expected a number"),
        ("negate: 0", "negate: maybe", "map.yaml: negate: found 'maybe', expected 0 or 1"),
        ("negate: 0", "negate: tRUE", "map.yaml: negate: found 'tRUE', expected 0 or 1"),
        ("negate: 0", "negate: 0\nnegate: 1", "map.yaml: the key 'negate' is there 2 times, expected once"),
        ("origin: [1.5, -2.0, 0.0]", "origin: 1.5", "map.yaml: the key 'origin' is missing, expected a list of numbers"),
        ("free_thresh: 0.2", "free_thresh: 0.8", "free_thresh, occupied_thresh: found 0.8 and 0.65, expected 0 <= free <= occupied <= 1"),
        ("mode: raw", "mode raw", "map.yaml: is no yaml: "),
        ("mode: raw", "mode: \udcff", "map.yaml: is no yaml: "),
        ("mode: raw", "mode: " + "[" * 5000, "map.yaml: is no yaml that map_server writes: it is nested too deeply"),
    ],
)
def test_what_is_no_map_is_one_sentence(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    text = YAML.format(mode="raw", negate=0, occupied=0.65, free=0.2)
    assert old in text
    Image.fromarray(np.zeros((2, 2), np.uint8)).save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_bytes(text.replace(old, new).encode(errors="surrogateescape"))
    with pytest.raises(EchogridError) as caught:
        map_server.read(tmp_path / "map.yaml")
    assert str(caught.value).startswith(str(tmp_path))
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_pictures_that_cannot_be_cells_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "map.yaml").write_text(YAML.format(mode="raw", negate=0, occupied=0.65, free=0.2))
    Image.fromarray(np.zeros((4, 4), np.float32)).save(tmp_path / "map.png", format="TIFF")
    with pytest.raises(EchogridError, match="its pixels are 'F', expected grey or colours of 8 or 16 bits"):
        map_server.read(tmp_path / "map.yaml")
    Image.fromarray(np.full((4, 4), 1 << 16, np.int32)).save(tmp_path / "map.png", format="TIFF")
    with pytest.raises(EchogridError, match="its grey levels have more than 16 bits"):
        map_server.read(tmp_path / "map.yaml")
    whole = Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 64), dtype=np.uint8))
    whole.save(tmp_path / "map.png")
    monkeypatch.setattr(map_server, "MOST_CELLS", 64 * 63)
    with pytest.raises(EchogridError, match="it has 64 x 64 pixels"):
        map_server.read(tmp_path / "map.yaml")
    monkeypatch.undo()
    (tmp_path / "map.png").write_bytes((tmp_path / "map.png").read_bytes()[:2000])
    with pytest.raises(EchogridError, match="is not a readable picture: image file is truncated"):
        map_server.read(tmp_path / "map.yaml")


def test_an_npz_in_bands_is_the_npz_of_the_whole(tmp_path: Path) -> None:
    """Bit for bit the same file; numpy reads it."""
    whole = np.arange(60, dtype=np.float32).reshape(12, 5)
    bands = dense_map.Bands(whole.shape, whole.dtype, (whole[i : i + 5] for i in range(0, 12, 5)))
    for name, array in (("one.npz", whole), ("two.npz", bands)):
        dense_map.write_npz(
            tmp_path / name,
            {"log_odds": array, "origin": np.array((1.0, 2.0)), "cell": np.array(0.25), "names": np.array(["left", "right"])},
        )
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    with np.load(tmp_path / "two.npz") as file:
        np.testing.assert_array_equal(file["log_odds"], whole)
        assert file["names"].tolist() == ["left", "right"]
        assert (file["cell"].shape, file["origin"].tolist()) == ((), [1.0, 2.0])
    assert dense_map.read_npz(tmp_path / "two.npz").names == ("left", "right")


@pytest.mark.parametrize(
    ("arrays", "complaint"),
    [
        ({"log_odds": np.zeros(3)}, "is not a map with the arrays log_odds, origin and cell"),
        ({"log_odds": np.zeros((2, 3)), "origin": np.zeros(2)}, "cell is not a file in the archive"),
        ({"log_odds": np.zeros(3), "origin": np.zeros(2), "cell": np.array(1.0)}, "the planes do not have one shape"),
        (
            {"log_odds": np.zeros((2, 3)), "origin": np.zeros(2), "cell": np.array(1.0), "radars": np.zeros((3, 2))},
            "the planes do not have one shape",
        ),
        ({"log_odds": np.full((2, 3), np.nan), "origin": np.zeros(2), "cell": np.array(1.0)}, "not all numbers are finite"),
        ({"log_odds": np.zeros((2, 3)), "origin": np.zeros(2), "cell": np.array(-1.0)}, "not all numbers are finite"),
        (
            {
                "log_odds": np.zeros((2, 3)),
                "origin": np.zeros(2),
                "cell": np.array(1.0),
                "radars": np.full((2, 3), 2),
                "names": np.array(["a"]),
            },
            "radars has bits beyond the 1 names",
        ),
        ({"log_odds": np.array([[{}]]), "origin": np.zeros(2), "cell": np.array(1.0)}, "Object arrays cannot be loaded"),
    ],
)
def test_an_npz_that_is_no_map_is_one_sentence(tmp_path: Path, arrays: dict[str, np.ndarray], complaint: str) -> None:
    np.savez(tmp_path / "map.npz", **arrays)
    with pytest.raises(EchogridError) as caught:
        dense_map.read_npz(tmp_path / "map.npz")
    assert str(caught.value).startswith(f"{tmp_path / 'map.npz'}: is not a map with the arrays log_odds, origin and cell: ")
    assert complaint in str(caught.value)


def test_a_zip_bomb_and_noise_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez_compressed(tmp_path / "map.npz", log_odds=np.zeros((64, 64), np.float32), origin=np.zeros(2), cell=np.array(1.0))
    monkeypatch.setattr(dense_map, "MOST_CELLS", 64 * 32)
    with pytest.raises(EchogridError, match="an array unpacks to"):
        dense_map.read_npz(tmp_path / "map.npz")
    (tmp_path / "map.npz").write_bytes(b"noise")
    with pytest.raises(EchogridError, match="is not a map with the arrays log_odds, origin and cell: File is not a zip file"):
        dense_map.read_npz(tmp_path / "map.npz")


def test_grey_is_a_share_of_the_pictures_own_maximum(tmp_path: Path) -> None:
    """Whether its numbers are text, bytes or words: findings/opencv_pgm_maxval.sh reads one of these otherwise."""
    pictures = {
        "plain": b"P5\n3 1\n255\n" + bytes((0, 120, 255)),
        "text": b"P2\n3 1\n85\n0 40 85\n",
        "bytes": b"P5\n3 1\n85\n" + bytes((0, 40, 85)),
        "words": b"P5\n3 1\n21845\n" + np.array((0, 10280, 21845), ">u2").tobytes(),
    }
    for name, data in pictures.items():
        (tmp_path / name).with_suffix(".pgm").write_bytes(data)
        (tmp_path / name).with_suffix(".yaml").write_text(
            f"image: {name}.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\nmode: scale\n"
        )
    maps = {name: map_server.read((tmp_path / name).with_suffix(".yaml")).log_odds for name in pictures}
    assert maps["plain"][0, 0] > 3
    assert maps["plain"][0, 2] < -3
    for read in maps.values():
        np.testing.assert_array_equal(read, maps["plain"])
