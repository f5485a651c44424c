"""What a whole recording says of a car's motion sensors, before it is mapped."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec

from echogrid.config.tables import Config
from echogrid.core.motion.error_filter import Kept
from echogrid.errors import EchogridError
from echogrid.logs.log import Log, check_rereadable
from echogrid.pipeline import Pipeline


def learn(log: Path, config: Config, source: Path, on_progress: Callable[[float], None] | None = None) -> Kept:
    """Replays a recording, as far as it can be read, for what is learned on it; the map that it makes on the way, by plain geometry, is
    thrown away.

    Raises EchogridError where the configuration does not allow to learn.
    """
    if config.motion.learns == "never":
        raise EchogridError(f"{source}: motion.learns: 'never' found, expected 'driving' or 'standing' with --learn-first")
    check_rereadable(log)
    by_geometry = msgspec.structs.replace(config, model="analytic", model_sha256=None, map=msgspec.structs.replace(config.map, fusion=None))
    pipeline, recording = Pipeline(by_geometry, source), Log(log)
    with suppress(EchogridError):  # what is wrong with the file is said where it is mapped
        for _ in pipeline.updates(recording.batches()):
            if on_progress is not None:
                on_progress(recording.progress)
    pipeline.mapper.end_cycle()
    pipeline.mapper.learn()
    return pipeline.mapper.odometry.errors.keep()
