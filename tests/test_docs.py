"""The documents name every key and signal that there is."""

from __future__ import annotations

import re
from pathlib import Path

import cantools
import msgspec
import pytest

from echogrid.can.profile import MotionProfile, PoseProfile, RadarProfile
from echogrid.can.signals import SignalReader
from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.health import Health
from echogrid.judging.finding import CODES
from tests.support.places import ROOT


def keys(kind: object) -> set[str]:
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return {field.encode_name for field in msgspec.structs.fields(kind)} | set().union(
            *(keys(field.type) for field in msgspec.structs.fields(kind))
        )
    return set().union(*(keys(inner) for inner in getattr(kind, "__args__", ())))


@pytest.mark.parametrize(
    ("document", "kind"),
    [("docs/configuration.md", Config), ("dbc/README.md", RadarProfile), ("dbc/README.md", MotionProfile), ("dbc/README.md", PoseProfile)],
)
def test_every_key_is_explained(document: str, kind: type) -> None:
    text = (ROOT / document).read_text()
    assert {key for key in keys(kind) if not re.search(rf"\b{key}\b", text)} == set()


def test_every_code_of_a_check_is_explained() -> None:
    rows = re.findall(r"(?m)^\| (`.*?) \|", (ROOT / "docs" / "checking.md").read_text())
    assert {code for row in rows for code in re.findall(r"`(\w+)`", row)} >= set(CODES)


@pytest.mark.parametrize("path", sorted((ROOT / "dbc").glob("*.dbc")), ids=lambda path: path.name)
def test_every_signal_is_in_the_table_with_its_unit(path: Path) -> None:
    text = (ROOT / "dbc" / "README.md").read_text().split(f"### {path.name}")[1].split("###")[0]
    for message in cantools.database.load_file(path).messages:
        for signal in message.signals:
            name = re.sub(r"_\d+$", "_{k}", signal.name)
            assert re.search(rf"\| `{re.escape(name)}` \| {re.escape(signal.unit or '1')} \| {signal.scale:g} \|", text), name


def test_the_configuration_to_start_from_is_sound() -> None:
    path = ROOT / "deploy" / "echogrid.toml"
    config = load_config(path)
    assert len(SignalReader(config, path, Health()).ids("radars")) == 8
