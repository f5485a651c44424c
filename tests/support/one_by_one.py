"""A drive message by message: each is mapped before the next is there."""

from __future__ import annotations

import can
import numpy as np

from echogrid.can.intake.frames import FrameBatch
from echogrid.core.mapper import MapUpdate
from echogrid.pipeline import Pipeline


def mapped(pipeline: Pipeline, bus: str, message: can.Message) -> list[MapUpdate]:
    """The map's states that one message of a bus makes."""
    number = np.array([pipeline.signals.number(bus)])
    return [update for _, update in pipeline.take(FrameBatch.of([message]), number) if update is not None]
