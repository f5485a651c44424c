"""`echogrid check` refuses what would end the service at its start, in the service's own words, and a recording is checked all the same."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import trustme
from tests.support.frames import CONFIG
from tests.support.program import echogrid

from echogrid.commands.check import command
from echogrid.config.loading import load_config
from echogrid.config.tables import Ros
from echogrid.errors import EchogridError
from echogrid.zenoh.publisher import Publisher

TLS = """
[publish]
listen = ["tls/127.0.0.1:1"]
tls = { ca = "ca.pem", certificate = "car.pem", key = "car.key", viewers = ["viewer"] }
"""


@pytest.fixture
def car(tmp_path: Path) -> Path:
    """A configuration with the files of its [publish.tls] beside it."""
    authority = trustme.CA()
    for name in ("car", "other"):
        issued = authority.issue_cert("127.0.0.1", common_name=name)
        issued.private_key_pem.write_to_path(tmp_path / f"{name}.key")
        issued.cert_chain_pems[0].write_to_path(tmp_path / f"{name}.pem")
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    (tmp_path / "echogrid.toml").write_text(CONFIG + TLS)
    return tmp_path / "echogrid.toml"


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda folder: (folder / "ca.pem").unlink(), "ca.pem: cannot be read: No such file or directory"),
        (lambda folder: (folder / "car.pem").unlink(), "car.pem: cannot be read: No such file or directory"),
        (lambda folder: (folder / "ca.pem").write_bytes(b"\xff\x00"), "ca.pem: holds no certificate in PEM form"),
        (lambda folder: (folder / "car.pem").write_text(""), "car.pem: holds no certificate in PEM form"),
        (lambda folder: (folder / "car.key").write_text("key"), "car.key: is not an unencrypted PEM key of the certificate "),
        (lambda folder: (folder / "other.key").replace(folder / "car.key"), "car.key: is not an unencrypted PEM key of the certificate "),
        (lambda folder: trustme.CA().cert_pem.write_to_path(folder / "ca.pem"), "car.pem: is not accepted by "),
    ],
)
def test_tls_files_that_do_not_fit_are_told_as_the_service_tells_it(car: Path, spoil: Callable[[Path], object], said: str) -> None:
    spoil(car.parent)
    with pytest.raises(EchogridError) as checked:
        command(car, None)
    with pytest.raises(EchogridError) as started:
        Publisher(load_config(car).publish, "car", Ros())
    assert str(checked.value) == f"{car}: {started.value}"
    assert str(checked.value).startswith(f"{car}: publish.tls: {car.parent / said}")


def test_those_that_fit_are_nothing_to_speak_of(car: Path) -> None:
    assert command(car, None)


def test_a_store_that_is_another_file_and_metrics_without_their_library_are_told(car: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    car.write_text(f"{CONFIG}\n[store]\npath = 'echogrid.toml'\n")
    with pytest.raises(EchogridError, match=rf"^{car}: {car}: is not a map of echogrid: it is not an SQLite file"):
        command(car, None)
    car.write_text(f"{CONFIG}\n[store]\npath = 'none.egmap'\n[metrics]\nfile = '/echogrid.prom'\n")
    assert command(car, None)
    monkeypatch.setattr("echogrid.watching.metrics.find_spec", lambda name: None)
    with pytest.raises(EchogridError, match=f"^{car}: metrics: prometheus-client is not installed"):
        command(car, None)
    assert not (car.parent / "none.egmap").exists()


def test_a_recording_is_checked_where_the_files_of_the_car_are_not(car: Path) -> None:
    (car.parent / "car.key").unlink()
    (car.parent / "can.log").write_text("(1.000000) can0 7FF#00\n")
    done = echogrid("check", "-c", car, car.parent / "can.log")
    assert done.returncode == 1
    assert "[motion_missing] " in done.stdout
    assert done.stderr == f"echogrid: {car}: publish.tls: {car.parent / 'car.key'}: cannot be read: No such file or directory\n"
