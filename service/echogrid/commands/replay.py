"""`echogrid replay`: a recording through the whole chain, and its results as files."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from echogrid.can.intake.frames import FrameBatch
from echogrid.can.signals import buses_of
from echogrid.commands.learning import learn
from echogrid.commands.recorder import Recorder, report
from echogrid.commands.state_log import StateLog
from echogrid.commands.terminal import progress, show_map
from echogrid.config.loading import load_config
from echogrid.errors import EchogridError, NoMapError
from echogrid.files import check_file, check_folder, named
from echogrid.logs.drive import Drive, Truth, find_drive, load_truth
from echogrid.logs.log import Log, check_rereadable
from echogrid.logs.traffic import Traffic
from echogrid.pipeline import Pipeline
from echogrid.store.claim import check_free
from echogrid.store.store_file import SUFFIX
from echogrid.store.tile_keeper import GOES_ON, TileKeeper, check_ours

if TYPE_CHECKING:
    from echogrid.recording.replay_recording import ReplayRecording

PACE = 0.01  # s

NO_POSE = "pose.key: a recording holds no messages of Zenoh, so its poses are not there; poses over CAN are"


def command(
    path: Path,
    config: Path | None,
    out: Path,
    *,
    realtime: bool,
    model: str | None,
    record: Path | None,
    store: Path | None,
    learn_first: bool,
    as_json: bool,
) -> bool:
    """A drive folder, or a log with its configuration: a progress bar, changes of state as they come, then the summary in words.

    Returns whether the map is to be trusted. `as_json`: the summary as JSON, and nothing else on stdout. The rest is as in `replay`.
    """
    drive = find_drive(path, config)
    with progress(f"replay {path.name}") as advance:
        tell = aside if as_json else say
        summary = replay(
            drive,
            out,
            realtime=realtime,
            model=model,
            record=record,
            store=store,
            learn_first=learn_first,
            on_progress=advance,
            say=tell,
        )
    return reported(summary, drive, out, as_json=as_json)


def reported(summary: dict[str, Any], drive: Drive, out: Path, *, as_json: bool) -> bool:
    """The map where a terminal shows it, and the summary in words, or as JSON alone; whether the map is to be trusted.

    Raises EchogridError where the recording's times are wrong.
    """
    if not as_json:
        show_map(out)
    report(summary, out, as_json=as_json)
    if summary["faults"]:
        raise EchogridError(f"{drive.log}: {'; '.join(summary['faults'])}")
    return summary["not_to_be_trusted"] is None


def check_outputs(out: Path, store: Path | None) -> None:
    """Raises EchogridError where what is asked for cannot be written, before the recording is gone through."""
    check_folder(out)
    if store is not None:
        check_file(store, SUFFIX)
        check_ours(store)
        check_free(store)


def say(line: str) -> None:
    """On the terminal, while a progress bar may stand there."""
    print(line, flush=True)


def aside(line: str) -> None:
    """The same where stdout is for a program."""
    print(line, file=sys.stderr, flush=True)


def replay(
    drive: Drive,
    out: Path,
    *,
    realtime: bool = False,
    model: str | None = None,
    record: Path | None = None,
    store: Path | None = None,
    learn_first: bool = False,
    on_progress: Callable[[float], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Runs a recording through the chain and writes its files into `out`; returns the summary. `say` is told of changes of the state.

    `learn_first`: the recording is gone through twice, and mapped with what it says of the car as a whole; nothing is learned then.

    `record`: also write an MCAP file. `store`: also write the map's tiles into this file, which may already hold other maps.

    A torn recording is mapped up to where it breaks off, and one with parts that cannot be understood without them; the files are written,
    then EchogridError is raised. A recording with no id that the configuration knows is refused with NoMapError, and nothing is written;
    of one that gives no map the summary is written before. `faults` in the summary is what is wrong with the times, `notes` what else is
    worth a word.
    """
    config = load_config(drive.config, model)
    check_outputs(out, store)
    kept = None
    if learn_first:
        kept = learn(drive.log, config, drive.config, None if on_progress is None else lambda share: on_progress(share / 2))
        config = msgspec.structs.replace(config, motion=msgspec.structs.replace(config.motion, learns="never"))
    pipeline = Pipeline(config, drive.config)
    if kept is not None:
        pipeline.mapper.odometry.errors.recall(kept, same_drive=True)
    truth = true_poses(drive, say)
    log = Log(drive.log)
    recorder = Recorder(pipeline, states=StateLog(say))
    torn: EchogridError | None = None
    traffic = Traffic(config, pipeline.signals)
    with ExitStack() as opened:
        if record is not None:
            opened.enter_context(named(record))
        recording = None if record is None else opened.enter_context(_recording(record, pipeline))
        keeper: TileKeeper | None = None
        try:
            for batch in log.batches():
                buses = buses_of(batch, config.bus)
                traffic.take(batch, buses)
                if store is not None and keeper is None:
                    keeper = opened.enter_context(pipeline.keep(store, begun_ns(batch), threading.Lock()))
                for some in _paced(batch) if realtime else (slice(None),):
                    piece, begin = batch.where(some), 0
                    if realtime:
                        _wait(float(piece.stamps[-1]), recorder)
                    for end, update in recorder.take(piece, buses[some]):
                        if recording is not None:
                            recording.take(piece.where(slice(begin, end)), buses[some][begin:end], update)
                        begin = end
                        if keeper is not None and keeper.due():
                            _flush(keeper)
                if on_progress is not None:
                    on_progress(log.progress if kept is None else (1.0 + log.progress) / 2)
        except EchogridError as error:
            torn = error
        if not traffic.heard:
            if recording is not None:
                recording.discard()
            raise nothing_known(drive, pipeline, traffic, torn)
        faults = log.times.faults() + traffic.coarse(log.times)
        beside = traffic.strangers() + ([] if config.pose is None or config.pose.key is None else [NO_POSE])
        pipeline.mapper.end_cycle()
        if not pipeline.health.cycles:
            if recording is not None:
                recording.discard()
            why = "; ".join(faults) or traffic.why_no_map(pipeline.health, pipeline.state(0).reasons)
            if torn is None:
                recorder.write(out, truth, faults, [*log.account.notes, *log.times.notes(), *beside])
            raise no_map(drive, why, torn)
        if keeper is not None and torn is None:
            _flush(keeper)  # before the log is read, so that no frame has to wait
        summary = recorder.write(out, truth, faults, log.account.notes + log.times.notes() + beside)
        if keeper is not None and torn is None:
            _flush(keeper)
    if torn is not None:
        raise in_part(torn, log, out)
    return summary


def _recording(path: Path, pipeline: Pipeline) -> ReplayRecording:
    """Loaded where one is asked for."""
    from echogrid.recording.replay_recording import ReplayRecording

    return ReplayRecording(path, pipeline)


def begun_ns(first: FrameBatch) -> int:
    """When the map of a recording begins, by its first frames: when it was driven, not when it is played."""
    return round(float(first.stamps[0]) * 1e9)


def first_ns(log: Path) -> int | None:
    """The same of a recording that is yet to be read; None where it has no frame. Raises EchogridError where it cannot be read."""
    check_rereadable(log)
    first = next(Log(log).batches(), None)
    return None if first is None else begun_ns(first)


def in_part(torn: EchogridError, log: Log, out: Path) -> EchogridError:
    """What is wrong with a recording, and where the map of what could be read of it is."""
    return EchogridError(f"{torn}; the map {'up to there' if log.account.torn or not log.account.odd else 'of all else'} is in {out}")


def no_map(drive: Drive, why: str, torn: EchogridError | None) -> EchogridError:
    """Why a recording gave none, and what is wrong with it where it is `torn`."""
    if torn is None:
        return NoMapError(f"{drive.log}: no map came of it: {why}")
    return EchogridError(f"{torn}; no map came of what could be read: {why}")


def _flush(keeper: TileKeeper) -> None:
    """Nothing waits for the mapping here, so a disk that cannot be written ends it."""
    keeper.flush()
    if keeper.status.state != "ok":
        raise EchogridError(keeper.status.reason.removesuffix(GOES_ON))


def _paced(batch: FrameBatch) -> list[slice]:
    """Frames that are played together: those of the same PACE seconds, as long as times go on."""
    edges = [0, *(np.flatnonzero(np.diff(np.floor(batch.stamps / PACE))) + 1).tolist(), len(batch)]
    return [slice(begin, end) for begin, end in pairwise(edges)]


def _wait(timestamp: float, recorder: Recorder) -> None:
    if recorder.first_s is not None:
        ahead = (timestamp - recorder.first_s) - (time.perf_counter() - recorder.started)
        if ahead > 0:
            time.sleep(ahead)


def true_poses(drive: Drive, say: Callable[[str], None] | None) -> Truth | None:
    """The true poses; None, and a word, where the file is another program's."""
    try:
        return load_truth(drive.truth)
    except EchogridError as error:
        if say is not None:
            say(f"not used: {error}")
        return None


def nothing_known(drive: Drive, pipeline: Pipeline, traffic: Traffic, torn: EchogridError | None) -> EchogridError:
    """What to say of a recording without a frame that the configuration knows."""
    if torn is not None and not pipeline.health.frames:
        return torn
    said = traffic.nothing_known(drive.config, pipeline.health)
    return NoMapError(f"{drive.log}: {said}") if torn is None else EchogridError(f"{torn}; {said}")
