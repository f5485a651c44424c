"""`echogrid replay --publish`: a recording through the service, at its own pace, and out to whoever listens, as the car would send it."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from echogrid.commands.recorder import Recorder
from echogrid.commands.replay import aside, check_outputs, first_ns, in_part, no_map, nothing_known, reported, say, true_poses
from echogrid.commands.state_log import StateLog
from echogrid.commands.terminal import progress
from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.live.player import Player, on_virtual_buses
from echogrid.live.service import Service
from echogrid.logs.drive import Drive, find_drive
from echogrid.logs.log import Log
from echogrid.logs.traffic import Traffic
from echogrid.pipeline import Pipeline


def command(
    path: Path,
    config: Path | None,
    out: Path,
    *,
    speed: float,
    model: str | None,
    record: Path | None,
    store: Path | None,
    foxglove: tuple[str, int] | None,
    as_json: bool,
) -> bool:
    """As `echogrid replay`, until the recording's end or until SIGTERM or SIGINT; returns whether the map is to be trusted: as far as it
    goes where it was stopped."""
    drive = find_drive(path, config)
    stopped = threading.Event()
    with progress(f"publishing {path.name}") as advance:
        summary = publish(
            drive,
            out,
            speed=speed,
            model=model,
            record=record,
            store=store,
            foxglove=foxglove,
            on_progress=advance,
            on_start=lambda service: _stoppable(service, stopped),
            say=aside if as_json else say,
        )
    return reported(summary, drive, out, as_json=as_json) or stopped.is_set()


def publish(
    drive: Drive,
    out: Path,
    *,
    speed: float = 1.0,
    model: str | None = None,
    record: Path | None = None,
    store: Path | None = None,
    foxglove: tuple[str, int] | None = None,
    on_progress: Callable[[float], None] | None = None,
    on_start: Callable[[Service], None] | None = None,
    say: Callable[[str], None] = say,
) -> dict[str, Any]:
    """Plays a recording to the service at `speed` times its pace, and writes the files of a replay into `out`; returns the summary.

    The service is that of `run`, with the configuration's [publish], [ros] and [metrics]; its map is kept in `store` alone. `record` and
    `foxglove` are as for `run`. It may be stopped early: the files then hold what was mapped until then, be it nothing. Raises
    EchogridError as `replay`.
    """
    config = at_the_desk(load_config(drive.config, model), store)
    check_outputs(out, store)
    pipeline = Pipeline(config, drive.config)
    truth = true_poses(drive, say)
    recorder = Recorder(pipeline, states=StateLog(say))
    traffic = Traffic(config, pipeline.signals)
    log = Log(drive.log)
    begun_ns = None if store is None else first_ns(drive.log)
    service = Service(pipeline, recorder.take, record=record, foxglove=foxglove, begun_ns=begun_ns)
    player = Player(service, log, speed=speed, see=traffic.take, on_progress=on_progress)
    service.workers.add("player", player.run)
    if on_start is not None:
        on_start(service)
    service.run()
    if player.ended and not player.sent:
        raise nothing_known(drive, pipeline, traffic, player.torn)
    faults = log.times.faults() + traffic.coarse(log.times) if player.ended else []
    summary = recorder.write(out, truth, faults, log.account.notes + log.times.notes() + traffic.strangers())
    if not pipeline.health.cycles and player.ended:
        raise no_map(drive, traffic.why_no_map(pipeline.health, pipeline.state(0).reasons), player.torn)
    if player.torn is not None:
        raise in_part(player.torn, log, out)
    return summary


def at_the_desk(config: Config, store: Path | None) -> Config:
    """The same configuration on buses of this process; the car's own map is left alone."""
    kept = msgspec.structs.replace(config.store, path=None if store is None else str(store))
    return msgspec.structs.replace(on_virtual_buses(config), store=kept)


def _stoppable(service: Service, stopped: threading.Event) -> None:
    """Both signals end it, and `stopped` says so."""

    def stop(*_: object) -> None:
        stopped.set()
        service.workers.stop.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)
    ends = (*service.config.publish.listen, *service.config.publish.connect)
    logging.getLogger("echogrid").info("publishing on %s as vehicle '%s'", ", ".join(ends), service.config.vehicle)
