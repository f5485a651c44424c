"""`echogrid check --seconds N`: live buses are judged as the log of the same frames is, with the same verdicts and exit codes."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import can
import pytest
from tests.commands.test_check_command import written
from tests.judging.mistakes import PLANTED
from tests.judging.trial import winding
from tests.support.program import echogrid

from echogrid.commands.check import command
from echogrid.commands.judged import check_log
from echogrid.config.loading import load_config


def send(messages: list[can.Message], channel: str) -> threading.Thread:
    """All frames with the times of their recording, once a receiver may be there."""

    def run() -> None:
        with can.Bus(interface="virtual", channel=channel, preserve_timestamps=True, protocol=can.CanProtocol.CAN_FD) as bus:
            time.sleep(0.5)
            for message in messages:
                bus.send(message)

    thread = threading.Thread(target=run)
    thread.start()
    return thread


@pytest.mark.parametrize("name", ["sound", "azimuth's sign", "id_offset"])
def test_the_verdict_is_that_of_the_log(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    planted = winding() if name == "sound" else next(one for one in PLANTED if one.name == name).plant(winding())
    channel = f"check {name}"
    config, log = written(tmp_path, planted.sub('channel = "can0"', f'channel = "{channel}"\nlog_channel = "can0"'))
    sender = send(planted.messages, channel)
    sound = command(config, None, seconds=6.0, as_json=True)
    sender.join()
    live = json.loads(capsys.readouterr().out)
    recorded = check_log(load_config(config), config, log)
    assert live["log"] is None
    assert live["frames"] == len(planted.messages)
    assert [(one["code"], one["radars"], one["sentence"]) for one in live["findings"]] == [
        (one.code, list(one.radars), one.sentence) for one in recorded.findings
    ]
    assert sound == (not recorded.findings)
    assert sound == (name == "sound")


def test_a_silent_bus_is_a_finding_and_one_that_is_not_there_an_error(tmp_path: Path) -> None:
    config, _ = written(tmp_path, winding().sub('channel = "can0"', 'channel = "silent"'))
    done = echogrid("check", "-c", config, "--seconds", "0.3")
    assert (done.returncode, done.stderr) == (2, "")
    assert "[motion_missing] " in done.stdout
    assert done.stdout.endswith("the live buses: 6 mistakes found\n")
    config, _ = written(tmp_path, winding().sub('interface = "virtual"', 'channel = "nowhere0"').sub('\nchannel = "can0"', ""))
    done = echogrid("check", "-c", config, "--seconds", "0.3")
    assert done.returncode == 1
    assert done.stderr.startswith(f"echogrid: {config}: bus 'can0': socketcan channel 'nowhere0' cannot be opened: ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--seconds", "0"), 2, "'0' found, expected seconds from 0.1 to 3600"),
        (("--seconds", "long"), 2, "'long' found, expected seconds from 0.1 to 3600"),
        (("any.log", "--seconds", "1"), 1, "either a LOG or --seconds can be checked, not both"),
    ],
)
def test_what_cannot_be_meant_is_one_sentence(arguments: tuple[str, ...], code: int, said: str, tmp_path: Path) -> None:
    config, _ = written(tmp_path, winding())
    done = echogrid("check", "-c", config, *arguments)
    assert done.returncode == code
    assert said in done.stderr
