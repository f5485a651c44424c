"""The container file against the files and the command that it names; no image is built here."""

from __future__ import annotations

import json
import re
from fnmatch import fnmatch

from tests.support.places import DEPLOY, ROOT

from echogrid.cli import _parser

TEXT = (DEPLOY / "Containerfile").read_text()


def test_what_it_copies_is_in_a_checkout_or_what_a_release_leaves() -> None:
    default = re.findall(r"^ARG VERSION=(\S+)$", TEXT, re.MULTILINE)
    copied = re.findall(r"^COPY (?!--)(\S+) ", TEXT, re.MULTILINE)
    assert (default, copied) == (["*"], ["requirements/service.txt", "dist/echogrid-${VERSION}-cp311-abi3-*.whl"])
    assert (ROOT / copied[0]).is_file()
    built = {f"dist/echogrid-{version}-{tag}.whl" for version in ("0.1.0", "0.2.0") for tag in ("cp311-abi3-linux_x86_64", "py3-none-any")}
    for version, found in (("*", 2), ("0.1.0", 1)):
        assert len([name for name in built if fnmatch(name, copied[1].replace("${VERSION}", version))]) == found


def test_it_starts_the_service_with_the_configuration_that_it_says_to_mount() -> None:
    entry, command = (json.loads(re.findall(rf"^{word} (.*)$", TEXT, re.MULTILINE)[0]) for word in ("ENTRYPOINT", "CMD"))
    given = _parser().parse_args(command)
    assert (entry, given.command.__name__) == (["echogrid"], "_run")
    assert f"-v {given.config.parent}:{given.config.parent}:ro" in TEXT
    state = re.findall(r"STATE_DIRECTORY=(\S+)", TEXT)[0]
    assert f":{state} echogrid" in TEXT
    assert f"VOLUME {state}\n" in TEXT
