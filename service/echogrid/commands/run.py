"""`echogrid run`: the service, until a signal ends it."""

from __future__ import annotations

import itertools
import logging
import signal
import time
from pathlib import Path

from echogrid.config.loading import load_config
from echogrid.errors import EchogridError
from echogrid.live.process import begin, settle
from echogrid.live.service import Service
from echogrid.pipeline import Pipeline

log = logging.getLogger("echogrid")


def run(config_path: Path, model: str | None = None, record: Path | None = None, foxglove: tuple[str, int] | None = None) -> None:
    """Until SIGTERM or SIGINT; SIGHUP reads the configuration again. Raises EchogridError.

    `record`: an MCAP file, or a folder, where it is named by the time of the start; `foxglove`: host and port of a live view.
    """
    begin()
    if record is not None and record.is_dir():
        record = named_by_time(record, time.time())
    service = Service(Pipeline(load_config(config_path, model), config_path), record=record, foxglove=foxglove)
    notifier = service.manager.notifier

    def reload() -> None:  # in the mapping's thread, wherever that is: it may hold its lock, so nothing here waits for it
        notifier.reloading()
        try:
            service.reload(load_config(config_path, model))
            log.info(f"{config_path} was read again: {service.config.publish}")
        except EchogridError as error:
            log.error(f"not reloaded, the configuration stays as it was: {error}")  # each refusal is logged
        notifier.ready("reloaded")

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: service.workers.stop.set())
    signal.signal(signal.SIGHUP, lambda *_: reload())
    settle()
    service.run()
    log.info("stopped after %d cycles", service.pipeline.health.cycles)


def named_by_time(folder: Path, now_s: float) -> Path:
    """A recording in it that is not there yet, at a time of Unix. Computers without a clock of their own begin each time at the same."""
    stem = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(now_s))
    names = (f"{stem}{'' if number == 1 else f'-{number}'}.mcap" for number in itertools.count(1))
    return next(folder / name for name in names if not (folder / name).exists())
