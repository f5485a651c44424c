"""Every command of docs/own_data.md is one; what they do is tested in own/ and labelling/."""

from __future__ import annotations

import re

import pytest
from tests.support.places import ROOT

from echogrid_training.cli import _parser

TEXT = (ROOT / "docs" / "own_data.md").read_text("utf-8").replace("\\\n", " ")
COMMANDS = [line.split("#")[0].split() for line in re.findall(r"(?m)^    echogrid-train (.*)$", TEXT)]


@pytest.mark.parametrize("arguments", COMMANDS, ids=" ".join)
def test_a_command_is_one(arguments: list[str]) -> None:
    options = _parser().parse_args([word.replace("DRIVE…", "drive") for word in arguments])
    assert callable(options.command)


def test_there_are_some() -> None:
    assert {arguments[0] for arguments in COMMANDS} == {"evaluate", "adapt", "simulate", "import", "label", "fit"}
