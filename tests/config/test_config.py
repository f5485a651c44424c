"""Every mistake in a configuration is one sentence that names file and key; nothing is opened before it is said."""

from __future__ import annotations

import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest
from tests.support.frames import CONFIG
from tests.support.places import DBC
from tests.support.waiting import PATIENCE

from echogrid.can.signals import SignalReader
from echogrid.config.loading import load_config
from echogrid.config.tables import Map
from echogrid.core.health import Health
from echogrid.errors import EchogridError
from echogrid.pipeline import Pipeline

SECOND = '[[radar]]\nname = "front_right"\nbus = "can0"\nx = 3.6\ny = -0.8\nyaw_deg = -45.0\n'


def complaint(tmp_path: Path, text: str) -> str:
    path = tmp_path / "echogrid.toml"
    path.write_text(text)
    with pytest.raises(EchogridError) as caught:
        SignalReader(load_config(path), path, Health())
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value)


@pytest.mark.parametrize(("table", "single"), [("bus", False), ("radar", False), ("motion", True), ("publish.tls", True)])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_table_that_is_opened_twice_is_told_with_both_lines_and_what_is_expected(
    tmp_path: Path, table: str, single: bool, end: str
) -> None:
    """All four pairs of brackets; only two [[...]] of a table that there may be several of are well."""
    for first, second in product((f"[{table}]", f"[[{table}]]"), repeat=2):
        decoy = f'text = """\n{second}\n"""'  # no line of the file's structure
        text = end.join((first, 'name = "a"', "[body]", decoy.replace("\n", end), f"  {second} # again", 'name = "b"'))
        said = complaint(tmp_path, text).removeprefix(f"{tmp_path / 'echogrid.toml'}: ")
        if first == second == f"[[{table}]]":
            assert not said.startswith("line")
            continue
        expected = f"one [{table}]" if single else f"[[{table}]] each time: there may be several"
        assert said == f"line 7: {second} found, and {first} in line 1, expected {expected}"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("bus = []\n[[bus]]\n", "line 2: [[bus]] found, but 'bus' is there already as a key, expected [[bus]] each time"),
        ('publish.tls.ca = "a"\n[publish.tls]', "line 2: [publish.tls] found, but 'publish.tls' is there already as a key, expected one ["),
        ("[body]\nwidth = 2\nwidth = 3\n", "line 3: 'width = 3' found, but what it names is there already, expected once"),
        ("[[motion]]\n", "motion: [[motion]] found, expected [motion]: there is one"),
        (
            "[[radar]]\n[radar.x]\n[[radar]]\n[radar.x]\n[radar.x]\n",
            "line 5: [radar.x] found, and [radar.x] in line 4, expected one [radar.x]",
        ),
    ],
)
def test_what_else_is_there_twice_or_of_the_wrong_brackets_is_told(tmp_path: Path, text: str, expected: str) -> None:
    assert complaint(tmp_path, text).startswith(f"{tmp_path / 'echogrid.toml'}: {expected}")


@pytest.mark.parametrize(("mark", "end"), [("\ufeff", "\n"), ("", "\r\n"), ("\ufeff", "\r\n")])
def test_what_editors_of_windows_write_is_read(tmp_path: Path, mark: str, end: str) -> None:
    path, same = tmp_path / "echogrid.toml", tmp_path / "same.toml"
    path.write_bytes((mark + CONFIG.replace("\n", end)).encode())
    same.write_text(CONFIG)
    assert load_config(path) == load_config(same)


def test_the_smallest_configuration_drives(tmp_path: Path) -> None:
    path = tmp_path / "echogrid.toml"
    path.write_text(CONFIG)
    config = load_config(path)
    assert config.grid.spec().cells * config.grid.spec().cell == 30.0
    assert config.publish.listen == ("tcp/127.0.0.1:7447",)
    reader = SignalReader(config, path, Health())
    assert reader.ids("can0") == [(0x100, False), (0x102, False), (0x300, False), (0x301, False)]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (("yaw_deg", "yaw_dge"), "radar[0]: unknown key 'yaw_dge'; did you mean 'yaw_deg'?"),
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\nlearns = "never"'), "radar[0]: unknown key 'learns'; it is one of another table"),
        (('vehicle = "test"', 'vehicle = "test"\nspeed = 3'), "unknown key 'speed'"),
        (("x = 3.6", 'x = "front"'), "radar[0].x: 'front' found, expected a number"),
        (("x = 3.6", "x = 36.0"), "radar[0]: 'front_left' is mounted at x = 36, y = 0.8 m, outside the car"),
        (("x = 3.6", "x = nan"), "is not valid TOML: 'nan' is not a finite number"),
        (("x = 3.6", "x = 1e999"), "is not valid TOML: '1e999' is not a finite number"),
        (("x = 3.6", "x = " + "9" * 5000), "is not valid TOML: Exceeds the limit (4300 digits)"),
        (("x = 3.6", "x = " + "[" * 5000), "tables or arrays are nested too deeply"),
        (("x = 3.6", "x" + ".a" * 5000 + " = 3.6"), "tables or arrays are nested too deeply"),
        (("x = 3.6", "x = 3.6 #" + "." * (1 << 20)), "holds more than 1024 KiB"),
        (('vehicle = "test"', "store.flush_s = 0"), "store.flush_s: 0 found, expected a number >= 0.1"),
        (('vehicle = "test"', "store.max_mib = 1"), "store.max_mib: 1 found, expected a whole number >= 16"),
        (('vehicle = "test"', "map.max_mib = 1"), "map.max_mib: 1 found, expected a whole number >= 8"),
        (
            ('vehicle = "test"', "map.max_tiles = 16\npublish.window_cells = 640"),
            "publish.window_cells: 640 found, whose 36 tiles have no room in map.max_tiles and map.max_mib, which hold 16",
        ),
        (
            ('model = "analytic"', "map.max_mib = 8\npublish.window_cells = 640"),  # 352 KiB each
            "publish.window_cells: 640 found, whose 36 tiles have no room in map.max_tiles and map.max_mib, which hold 19",
        ),
        (('vehicle = "test"', "map.cycle_ms = 1e308"), "map.cycle_ms: 1e+308 found, expected a number <= 1000000.0"),
        (('model = "analytic"', f'model = "default"\nmodel_sha256 = "{"0" * 64}"'), "model_sha256: given for 'default', expected beside"),
        (('model = "analytic"', 'model_sha256 = "0"'), "model_sha256: '0' found, expected 64 digits from 0 to f"),
        (("y = 0.8", "y = 1.8"), "radar[0]: 'front_left' is mounted at x = 3.6, y = 1.8 m, outside the car"),
        (("x = 3.6", ""), "radar[0]: the key 'x' is missing"),
        (('[motion]\nbus = "can0"', '[motion]\nbus = "can7"'), "motion.bus: no [[bus]] is named 'can7', found can0"),
        (('vehicle = "test"', 'vehicle = "my/car"'), "vehicle: 'my/car' found, expected letters, digits, _ and - alone"),
        (("yaw_deg = 45.0", "yaw_deg = 45.0\nfov_deg = 700"), "radar[0].fov_deg: 700 found, expected a number <= 360"),
        (("yaw_deg = 45.0", "yaw_deg = 45.0\nfov_deg = 2.1"), "radar[0].fov_deg: 2.1 found, expected a number >= 5"),
        (("yaw_deg = 45.0", "yaw_deg = 450"), "radar[0].yaw_deg: 450 found, expected a number <= 360"),
        (
            ('interface = "virtual"', 'interface = "socketkan"'),
            "bus[0].interface: 'socketkan' found, expected one that python-can knows, such as socketcan; did you mean 'socketcan'?",
        ),
        (
            ('vehicle = "test"', "publish.rate_hz = 25"),
            "publish.rate_hz: 25 found, expected at most 20: the map is updated every map.cycle_ms = 50",
        ),
        (
            ("yaw_deg = 45.0", 'yaw_deg = 45.0\nprofile = "corner"'),
            "radar[0]: no profile 'corner' is shipped, expected one of ars408, corner_radar",
        ),
        (
            ("[motion]", '[[bus]]\nname = "b"\nchannel = "can0"\n[motion]'),
            "bus[1]: 'b' and 'can0' are both channel 'can0', expected channels of their own, in recordings too (log_channel)",
        ),
        (
            ("[motion]", '[[bus]]\nname = "b"\nchannel = "can1"\nlog_channel = "can0"\n[motion]'),
            "bus[1]: 'b' and 'can0' are both channel 'can0'",
        ),
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\nprofile = "none.toml"'), "none.toml: cannot be read: No such file"),
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\nprofile = "corner_rader"'), "or a path that ends in .toml; did you mean 'corner_radar'?"),
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\nprofile = "echogrid"'), "or a path that ends in .toml; did you mean 'echogrid.toml'?"),
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\nprofile = "echogrid.toml"'), "echogrid.toml: is a configuration, expected a profile"),
        (("[[bus]]", "[bus]"), "bus: [bus] found, expected [[bus]]: there may be several"),
        (('vehicle = "test"', "publish.rate = 5"), "publish: unknown key 'rate'; did you mean 'rate_hz'?"),
        (
            ('vehicle = "test"', 'ros.namespace = "car"'),
            "ros.namespace: 'car' found, expected /, or names behind slashes such as /echogrid",
        ),
        (('vehicle = "test"', 'ros.distro = "kilted"'), "or 'off'; 'jazzy' stands for every distribution since Iron"),
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\nprofile = "vehicle_motion"'), "vehicle_motion.toml: kind: 'motion' found, expected 'radar'"),
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\nprofile = "ford_mrr"'), "is shipped without a DBC file"),
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\ndbc = "none.dbc"'), "none.dbc: cannot be read: No such file"),
        (('name = "front_left"', 'name = "front_left'), ": 'name = \"front_left'"),
        (('vehicle = "test"', "vehicle = test"), "is not valid TOML: Invalid value (at line 2, column 11): 'vehicle = test'"),
        (("x = 3.6", "x = 3,6"), "): 'x = 3,6'"),
        (("x = 3.6", "x = 3,6 \x1b[2J"), "): 'x = 3,6 ?[2J'"),
        (("x = 3.6", f"x = 3,6 # {'.' * 99}"), "): 'x = 3,6 # " + "." * 50 + "'"),
        (('vehicle = "test"', r'model = "C:\car\net.onnx"'), r"""): 'model = "C:\car\net.onnx"'"""),
        (
            ("yaw_deg = 45.0", 'yaw_deg = 45.0\nprofile = "car.DBC"'),
            "radar[0]: profile: 'car.DBC' found, which belongs under",
        ),
        (('model = "analytic"', 'model = "best"'), "model: 'best' found, expected analytic, default, paper, or the path of an .onnx file"),
        (('vehicle = "test"', 'store.path = ""'), "store.path: an empty text found, expected a name"),
        (('vehicle = "test"', 'publish.listen = ["tcp/127.0.0.1:1", ""]'), "publish.listen[1]: an empty text found, expected a name"),
        (('vehicle = "test"', 'store.path = ".."'), "is a folder, expected the name of a file in it, such as map.egmap"),
        (('vehicle = "test"', r'store.path = "a\u0000.egmap"'), "store.path: a text with \\u0000 found, expected a name"),
        (
            ("yaw_deg = 45.0", r'yaw_deg = 45.0\nprofile = "\u0000.toml"'.replace(r"\n", "\n")),
            "radar[0].profile: a text with \\u0000 found",
        ),
        (('interface = "virtual"', 'interface = "virtual"\nbitrate = -1'), "bus[0].bitrate: -1 found, expected a whole number >= 1000"),
        (('interface = "virtual"', 'interface = "virtual"\nbitrate = 500'), "bus[0].bitrate: 500 found, expected a whole number >= 1000"),
        (('vehicle = "test"', 'model_fallback = "yes"'), "model_fallback: 'yes' found, expected true or false"),
        (('vehicle = "test"', 'map.fusion = "looks"'), "map.fusion: 'looks' found, expected 'sum' for the analytic model"),
        (('vehicle = "test"', 'map.fusion = "mean"'), "map.fusion: 'mean' found, expected 'looks' or 'sum'"),
        (("[motion]", SECOND.replace("front_right", "front_left") + "[motion]"), "radar[1].name: 'front_left' is taken already"),
        (("y = 0.8", "y = 0.8\nid_offset = 0x500"), "radar[0]: id_offset: 1280 found, which takes 'RadarHeader' to 0x800, expected"),
        (("y = 0.8", "y = 0.8\nid_offset = -770"), "radar[0]: id_offset: -770 found, which takes 'RadarHeader' to -0x2, expected"),
        (("[motion]", SECOND + "[motion]"), "radar[1]: 'front_right' and 'front_left' both read id 0x300 on bus 'can0'"),
    ],
)
def test_a_mistake_is_one_sentence(tmp_path: Path, change: tuple[str, str], expected: str) -> None:
    assert change[0] in CONFIG
    assert expected in complaint(tmp_path, CONFIG.replace(*change))


@pytest.mark.parametrize("name", ["x" * 300, "/".join(["x" * 200] * 25)], ids=["a long name", "a long path"])
@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\nprofile = "{}.toml"'), "radar[0]: {here}.toml: cannot be read: File name too long"),
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\nprofile = "{}"'), "radar[0]: no profile '{name}' is shipped"),
        (("yaw_deg = 45.0", 'yaw_deg = 45.0\ndbc = "{}.dbc"'), "radar[0]: {here}.dbc: cannot be read: File name too long"),
        (('[motion]\nbus = "can0"', '[motion]\nbus = "can0"\nprofile = "{}.toml"'), "motion: {here}.toml: cannot be read: File name too"),
        (('[motion]\nbus = "can0"', '[motion]\nbus = "can0"\ndbc = "{}.dbc"'), "motion: {here}.dbc: cannot be read: File name too long"),
        (
            ("[motion]", '[pose]\nbus = "can0"\nprofile = "{}.toml"\n[motion]'),
            "pose: {here}.toml: cannot be read: File name too long",
        ),
        (('model = "analytic"', 'model = "{}.onnx"'), "model: {here}.onnx: cannot be read: File name too long"),
        (('model = "analytic"', 'store.path = "{}.egmap"'), "store.path: {here}.egmap cannot be the name of a file: File name too long"),
    ],
)
def test_a_name_that_no_file_can_have_is_said_with_its_key(tmp_path: Path, name: str, change: tuple[str, str], expected: str) -> None:
    assert change[0] in CONFIG
    path = tmp_path / "echogrid.toml"
    path.write_text(CONFIG.replace(change[0], change[1].replace("{}", name)))
    with pytest.raises(EchogridError) as caught:
        Pipeline(load_config(path), path)
    assert str(caught.value).startswith(f"{path}: " + expected.format(here=tmp_path / name, name=name))


@pytest.mark.parametrize("key", ["listen", "connect"])
@pytest.mark.parametrize(
    ("endpoint", "expected"),
    [
        ("tcp/127.0.0.1", "has no port, expected one such as 'tcp/127.0.0.1:7447'"),
        ("tcp/[::1]", "has no port"),
        ("tcp/127.0.0.1:", "has no port"),
        ("tls/car.example:7447x", "has no port"),
        ("tcp/127.0.0.1:0", "has the port 0, expected one from 1 to 65535"),
        ("udp/127.0.0.1:65536", "has the port 65536, expected one from 1 to 65535"),
        ("tcp/:7447", "has no host"),
        ("127.0.0.1:7447", "has no protocol"),
        ("tpc/127.0.0.1:7447", "has the protocol 'tpc', expected one such as 'tcp/127.0.0.1:7447'; did you mean 'tcp'?"),
    ],
)
def test_an_endpoint_that_leads_nowhere_is_said_first(tmp_path: Path, key: str, endpoint: str, expected: str) -> None:
    change = 'vehicle = "test"', f'publish.{key} = ["{endpoint}"]'
    assert f"publish.{key}: '{endpoint}' {expected}" in complaint(tmp_path, CONFIG.replace(*change))


@pytest.mark.parametrize("endpoint", ["tcp/[::1]:1", "tcp/localhost:65535#iface=lo", "unixsock-stream//run/echogrid.sock"])
def test_an_endpoint_that_leads_somewhere_is_taken(tmp_path: Path, endpoint: str) -> None:
    path = tmp_path / "echogrid.toml"
    path.write_text(CONFIG.replace('vehicle = "test"', f'publish.connect = ["{endpoint}"]'))
    assert load_config(path).publish.connect == (endpoint,)


@pytest.mark.parametrize("profile", sorted(DBC.glob("*.toml")), ids=lambda path: path.stem)
def test_a_profile_in_place_of_a_configuration_is_called_one(profile: Path) -> None:
    with pytest.raises(EchogridError, match="is a profile of kind '(radar|motion)', expected a configuration"):
        load_config(profile)


def test_no_radar_and_no_text(tmp_path: Path) -> None:
    assert "radar: none is configured" in complaint(tmp_path, CONFIG[: CONFIG.index("[[radar]]")])
    (tmp_path / "echogrid.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(EchogridError, match="is not a text file"):
        load_config(tmp_path / "echogrid.toml")
    with pytest.raises(EchogridError, match="cannot be read: No such file"):
        load_config(tmp_path / "other.toml")


def test_without_a_word_about_it_the_shipped_network_runs(tmp_path: Path) -> None:
    path = tmp_path / "echogrid.toml"
    path.write_text(CONFIG.replace('model = "analytic"', ""))
    assert (load_config(path).model, load_config(path).map.fusion, load_config(path).model_fallback) == ("default", None, False)


def test_the_command_lines_model_stands_in_for_the_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A path is from the working folder, as the shell completes it; in the file it is from the file's folder."""
    path = tmp_path / "echogrid.toml"
    path.write_text(CONFIG.replace('model = "analytic"', 'model = "paper"\nmap.fusion = "looks"'))
    monkeypatch.chdir(tmp_path.parent)
    assert load_config(path).model == "paper"
    assert load_config(path, "default").model == "default"
    (tmp_path.parent / "net.onnx").touch()
    assert load_config(path, "net.onnx").model == str(tmp_path.parent / "net.onnx")
    with pytest.raises(EchogridError, match="map.fusion: 'looks' found, expected 'sum' for the analytic model"):
        load_config(path, "analytic")


@pytest.mark.parametrize("command", [("run", "-c"), ("check", "-c")])
def test_the_command_line_says_it_without_a_traceback(tmp_path: Path, command: tuple[str, str]) -> None:
    path = tmp_path / "echogrid.toml"
    path.write_text(CONFIG.replace("yaw_deg", "yaw_dg"))
    done = subprocess.run(
        [sys.executable, "-m", "echogrid", *command, str(path)], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.returncode == 1
    assert done.stderr == f"echogrid: {path}: radar[0]: unknown key 'yaw_dg'; did you mean 'yaw_deg'?\n"


def test_the_smaller_bound_of_the_memory_wins() -> None:
    assert Map(max_tiles=100, max_mib=256).tiles(4) == 100
    assert Map(max_tiles=1024, max_mib=11).tiles(4) == 32  # of 352 KiB
    assert Map(max_tiles=1024, max_mib=10).tiles(1) == 64  # of 160 KiB


def test_more_radars_than_a_tile_has_bits_for_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "echogrid.toml"
    one = CONFIG[CONFIG.index("[[radar]]") :].split("[[radar]]")[1]
    for count, refused in ((16, False), (17, True)):
        radars = [f"[[radar]]{one.replace('front_left', f'r{n}')}" for n in range(count)]
        path.write_text(CONFIG.split("[[radar]]")[0] + "".join(radars))
        if refused:
            with pytest.raises(EchogridError, match="radar: 17 are configured, expected at most 16: the map keeps a bit for each"):
                load_config(path)
        else:
            assert len(load_config(path).radar) == 16
