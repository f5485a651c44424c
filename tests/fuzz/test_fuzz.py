"""What hostile bytes once did, or could do, they do no more; make fuzz looks for more of their kind."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import pytest

from tests.fuzz.targets import CORPUS, TARGETS, corpus
from tests.support.places import ROOT


@pytest.mark.filterwarnings("default")  # a hostile file may warn
@pytest.mark.parametrize("name", TARGETS)
def test_the_corpus_does_no_harm(name: str) -> None:
    inputs = corpus(name)
    assert inputs
    for path in inputs:
        TARGETS[name](path.read_bytes())


def test_every_folder_of_the_corpus_has_its_target() -> None:
    assert {path.name for path in CORPUS.iterdir()} == set(TARGETS)


@pytest.mark.skipif(importlib.util.find_spec("atheris") is None, reason="atheris has no wheel for this machine or Python")
def test_a_short_look_for_more_finds_nothing() -> None:
    """All targets in one process, from the corpus on; limits of memory and time for each input."""
    command = [sys.executable, "-m", "tests.fuzz", "all", "--seconds", "3"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
