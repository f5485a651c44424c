"""What ROS is told of each state: read back by rosbags."""

from __future__ import annotations

from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore
from tests.support.status import status

from echogrid.core.health import SensorHealth
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.trust.watch import Watch
from echogrid.topics.diagnostic_array import encode_diagnostics
from echogrid.topics.diagnostics import diagnostics

STORE = get_typestore(Stores.ROS2_HUMBLE)
OK, WARN, ERROR, STALE = range(4)  # diagnostic_msgs/msg/DiagnosticStatus
PARTS = ["service", "motion", "store", "recording", "pose", "radar front_left", "radar rear_right", "bus chassis", "bus radars"]


def read(of: dict[str, Any]) -> dict[str, Any]:
    """ROS's DiagnosticStatus of each part, without the program's name."""
    payload = encode_diagnostics(diagnostics(of, "car", 1_700_000_000_000_000_005))
    message = STORE.deserialize_cdr(payload, "diagnostic_msgs/msg/DiagnosticArray")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 5)
    assert all(part.name.startswith("echogrid: ") for part in message.status)
    return {part.name.removeprefix("echogrid: "): part for part in message.status}


def test_every_part_is_there_and_knows_what_it_is() -> None:
    parts = read(status())
    assert list(parts) == PARTS
    assert [part.hardware_id for part in parts.values()] == [
        "car",
        "car",
        "car",
        "car",
        "car",
        "front_left",
        "rear_right",
        "chassis",
        "radars",
    ]


@pytest.mark.parametrize(("state", "level"), [("ok", OK), ("degraded", WARN), ("no_motion", ERROR), ("stale", STALE), ("stopped", ERROR)])
def test_the_service_has_the_level_of_its_state(state: str, level: int) -> None:
    part = read(status(state, "radar x: this", "yaw rate: that"))["service"]
    assert (part.level, part.message) == (level, f"{state}; radar x: this; yaw rate: that")


@pytest.mark.parametrize("reason", ["vehicle: another service", "publish.connect: 'tcp/10.0.0.9:7447' is not connected"])
def test_what_is_wrong_outside_is_worth_a_warning(reason: str) -> None:
    part = diagnostics(status("ok", reason), "car", 5).status[0]
    assert (part.level, part.message) == (WARN, f"ok; {reason}")


def test_a_reason_is_told_by_the_part_that_it_names() -> None:
    reasons = ("radar rear_right: silent for 1.2 s", "yaw rate: stuck", "radar rear_right: late", "bus chassis: off", "radar rear: no")
    parts = read(status("degraded", *reasons))
    assert {name: (part.level, part.message) for name, part in parts.items() if name != "service"} == {
        "motion": (WARN, "yaw rate: stuck"),
        "store": (OK, "ok"),
        "recording": (WARN, "failed: No space left on device"),
        "pose": (WARN, "silent: none for 1.4 s"),
        "radar front_left": (OK, "ok"),
        "radar rear_right": (WARN, "silent for 1.2 s; late"),
        "bus chassis": (WARN, "off"),
        "bus radars": (ERROR, "down"),
    }


def test_a_map_that_is_not_kept_is_a_warning_of_its_own() -> None:
    sent = status()
    sent["store"] |= {"state": "full", "reason": "a.egmap: database or disk is full"}
    parts = read(sent)
    assert (parts["store"].level, parts["store"].message) == (WARN, "full: a.egmap: database or disk is full")
    assert parts["service"].level == OK
    assert "store" not in read({**sent, "store": None})


def test_without_motion_that_is_an_error() -> None:
    part = read(status("no_motion", "wheel speed: silent for 0.6 s"))["motion"]
    assert (part.level, part.message) == (ERROR, "wheel speed: silent for 0.6 s")


@pytest.mark.parametrize("state", ["stale", "stopped"])
def test_of_an_old_map_no_part_is_called_ok(state: str) -> None:
    parts = read(status(state, "radar front_left: silent for 9.0 s"))
    assert {name: (part.level, part.message) for name, part in parts.items() if name != "service"} == {
        "motion": (STALE, state),
        "store": (STALE, state),
        "recording": (WARN, "failed: No space left on device"),
        "pose": (WARN, "silent: none for 1.4 s"),
        "radar front_left": (WARN, "silent for 9.0 s"),
        "radar rear_right": (STALE, state),
        "bus chassis": (STALE, state),
        "bus radars": (ERROR, "down"),
    }


def test_the_sentences_of_the_watch_find_their_parts() -> None:
    """A reason that no part but the service tells would make all parts look sound."""
    mount = Mount(SE2(3.6, 0.8, 0.8), 1.3, 25.0)
    watch = Watch({"front_left": mount}, {"front_left": SensorHealth()}, GateNoise())
    reasons = watch.state(0).reasons
    assert any(reason.startswith("radar front_left: ") for reason in reasons)
    parts = read({**status("degraded", *reasons), "sensors": {"front_left": {}}, "buses": {}})
    told = [part.message for name, part in parts.items() if name != "service"]
    assert len(reasons) == 4  # no map yet, wheel speed, yaw rate, radar
    assert sum(message.count("nothing so far") for message in told) == 3


def test_numbers_are_those_of_the_status() -> None:
    sent = status()
    parts = read(sent)
    values = {name: {pair.key: pair.value for pair in part.values} for name, part in parts.items()}
    for radar, counters in sent["sensors"].items():
        assert values[f"radar {radar}"] == {key: str(value) for key, value in counters.items()}
    assert values["bus chassis"] == {key: str(value) for key, value in sent["buses"]["chassis"].items()}
    service = values["service"]
    assert (service["epoch"], service["model"], service["frames"]) == ("2", sent["model"], str(sent["frames"]))
    assert (service["rates.map_hz"], service["latency_ms.p99"]) == ("19.5", "31.25")
