"""What a recording, or live buses, say about a configuration: decoded whole, not mapped, and judged."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from echogrid.can.bus import LiveBus, wait
from echogrid.can.intake.frames import FrameBatch
from echogrid.config.tables import Config
from echogrid.errors import EchogridError
from echogrid.judging.finding import Finding
from echogrid.judging.judge import Judgement
from echogrid.judging.listening import Listener
from echogrid.judging.mending import Fix
from echogrid.judging.recorded import Recorded
from echogrid.logs.formats.account import Account
from echogrid.logs.formats.times import Times
from echogrid.logs.log import Log
from echogrid.logs.traffic import Traffic

POLL = 0.1  # s


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """What frames say; `fixes` one for each finding, `torn` what the file lost."""

    listener: Listener
    account: Account
    times: Times
    traffic: Traffic
    torn: EchogridError | None
    recorded: Recorded
    judgement: Judgement
    findings: tuple[Finding, ...]
    fixes: tuple[Fix, ...]

    def faults(self) -> list[str]:
        """What is wrong with the times of the frames."""
        return self.times.faults() + self.traffic.coarse(self.times)


def check_log(config: Config, source: Path, path: Path, on_progress: Callable[[float], None] | None = None) -> Report:
    """Decodes a recording without mapping it, and judges it. Raises EchogridError where nothing of it can be read."""
    listener = Listener(config, source)
    log, traffic = Log(path), Traffic(config, listener.reader)
    torn: EchogridError | None = None
    try:
        for batch in log.batches():
            traffic.take(batch, listener.take(batch))
            if on_progress is not None:
                on_progress(log.progress)
    except EchogridError as error:
        if not log.messages:
            raise
        torn = error
    return _report(listener, log.account, log.times, traffic, torn)


def check_live(config: Config, source: Path, seconds: float, on_progress: Callable[[float], None] | None = None) -> Report:
    """Listens to the configured buses, to all their ids, and judges the frames as those of a recording.

    Raises EchogridError where a bus cannot be opened.
    """
    listener = Listener(config, source)
    heard = listen(config, source, seconds, on_progress)
    times, traffic = Times(), Traffic(config, listener.reader)
    times.add(heard.stamps)
    traffic.take(heard, listener.take(heard))
    return _report(listener, Account(), times, traffic, None)


def listen(config: Config, source: Path, seconds: float, on_progress: Callable[[float], None] | None = None) -> FrameBatch:
    """All frames of the configured buses for so long, in the order of their times."""
    heard: list[FrameBatch] = []
    with ExitStack() as opened:
        buses = []
        for bus in config.bus:
            try:
                buses.append(LiveBus(bus, []))
            except EchogridError as error:
                raise EchogridError(f"{source}: {error}") from error
            opened.callback(buses[-1].close)
        begin = time.monotonic()
        while (passed := time.monotonic() - begin) < seconds:
            wait(buses, min(POLL, seconds - passed))
            for one in buses:
                batch = one.take()
                if batch is not None:
                    heard.append(batch)
                one.bring_back()
            if on_progress is not None:
                on_progress(min(passed / seconds, 1.0))
    return FrameBatch.joined(heard, by_time=True)[0]


def _report(listener: Listener, account: Account, times: Times, traffic: Traffic, torn: EchogridError | None) -> Report:
    judgement, findings, mender = listener.judged()
    if traffic.coarse(times):  # from one of their steps to the next nobody is heard, which is no pause
        findings = [one for one in findings if one.code != "silence" or one.value > 2 * times.finest]
    fixes = tuple(mender.fix(one) for one in findings)
    return Report(listener, account, times, traffic, torn, listener.recorded(), judgement, tuple(findings), fixes)
