"""What is installed is pinned, to the byte: a fresh environment has all that a pyproject.toml names, and nothing else by that name."""

from __future__ import annotations

import re
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support.places import ROOT

HASHED = ("service", "develop", "build", "tools")


def pins(name: str) -> dict[str, str]:
    """Versions in a file of requirements/ by the packages' names."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text()
    found = re.findall(r"^([A-Za-z0-9._-]+)==([^\s;\\]+)", text, re.MULTILINE)
    return {str(canonicalize_name(package)): version for package, version in found}


def asked(path: str) -> list[Requirement]:
    """What a pyproject.toml asks for, extras and build backend too."""
    document = tomllib.loads((ROOT / path).read_text())
    project = document["project"]
    texts = [*project["dependencies"], *(text for extra in project.get("optional-dependencies", {}).values() for text in extra)]
    return [Requirement(text) for text in texts + document["build-system"]["requires"] if text != "echogrid"]


@pytest.mark.parametrize(
    ("path", "files"), [("pyproject.toml", ("service", "develop", "build")), ("training/pyproject.toml", ("develop", "torch", "build"))]
)
def test_whatever_is_asked_for_is_pinned_to_a_version_that_will_do(path: str, files: tuple[str, ...]) -> None:
    pinned = {name: version for file in files for name, version in pins(file).items()}
    for requirement in asked(path):
        version = pinned.get(canonicalize_name(requirement.name))
        assert version is not None, f"{requirement.name} is not pinned: make lock"
        assert requirement.specifier.contains(version), f"{requirement} against {version}: make lock"


def test_whatever_the_service_runs_on_is_the_same_where_it_is_tested() -> None:
    assert pins("service").items() <= pins("develop").items()


@pytest.mark.parametrize("name", HASHED)
def test_every_pin_has_its_hashes(name: str) -> None:
    """Else pip takes none of the file's."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text()
    blocks = re.split(r"^(?=[A-Za-z0-9])", re.sub(r"^#.*\n", "", text, flags=re.MULTILINE), flags=re.MULTILINE)
    # A package may be there once for one version of Python and once for another.
    assert {canonicalize_name(block.partition("==")[0]) for block in blocks[1:]} == pins(name).keys()
    assert len(pins(name)) > 1
    assert all(re.search(r"--hash=sha256:[0-9a-f]{64}\b", block) for block in blocks[1:])
