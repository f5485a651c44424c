"""A learned inverse sensor model in ONNX, checked against its own contract before anything else is opened."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from echogrid.core.raster import GridSpec, Image
from echogrid.errors import EchogridError

KEY, VERSION = "echogrid", 1  # of the metadata: the contract as JSON
CHANNELS, RANGE, OUTPUT = ("detections",), (-1.0, 1.0), "log-odds"
COARSE = 8  # cells along a side of a block whose mean a golden answer keeps
TOLERANCE = 1e-3  # of the golden answers: onnxruntime's float kernels differ between machines by far less


class Golden(msgspec.Struct, frozen=True):
    """An image and what the network makes of it, small enough to travel along (base64 in the JSON)."""

    occupied: bytes  # uint16 little-endian flat indices of the image's cells that are 1, row-major
    coarse: bytes  # float32 little-endian means of the output over blocks of COARSE x COARSE cells, row-major


class Contract(msgspec.Struct, frozen=True, kw_only=True):
    """What whoever runs the file must draw, and what comes out. A file may say more about its training."""

    version: int
    cells: int  # along a side: row i is y, column j is x, cell [0, 0] at the rear right
    cell: float  # m
    channels: tuple[str, ...]
    input_range: tuple[float, float]
    output: str
    golden: tuple[Golden, ...]


class OnnxSensorModel:
    """Callable (1, H, W) image in [-1, 1] -> (H, W) log-odds. One thread: on a busy machine two make the slowest runs far slower."""

    def __init__(self, path: Path, spec: GridSpec) -> None:
        """Raises EchogridError where the file is no model, was made for another grid, or does not give its golden answers."""
        self.path = path
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # a waiting core is not ours to burn
        try:
            self._session = onnxruntime.InferenceSession(path.read_bytes(), options, providers=["CPUExecutionProvider"])
        except OSError as error:
            raise EchogridError(f"{path}: cannot be read: {error.strerror}") from error
        except Exception as error:  # onnxruntime's errors have no common class
            raise EchogridError(f"{path}: is no ONNX model that onnxruntime reads: {str(error).splitlines()[0]}") from error
        self.contract = self._read_contract()
        self._input = self._session.get_inputs()[0]
        self._check(spec)

    def __call__(self, image: Image) -> Image:
        (output,) = self._session.run(None, {self._input.name: image[None]})
        result: Image = output.reshape(image.shape[-2:])
        return result

    def _read_contract(self) -> Contract:
        text = self._session.get_modelmeta().custom_metadata_map.get(KEY)
        if text is None:
            raise EchogridError(f"{self.path}: has no metadata '{KEY}': it was not exported for this service")
        try:
            return msgspec.json.decode(text, type=Contract)
        except msgspec.DecodeError as error:
            raise EchogridError(f"{self.path}: metadata '{KEY}': {error}") from error

    def _check(self, spec: GridSpec) -> None:
        found = self.contract
        demands = {"version": VERSION, "cells": spec.cells, "channels": CHANNELS, "input_range": RANGE, "output": OUTPUT}
        for key, expected in demands.items():
            if getattr(found, key) != expected:
                raise EchogridError(f"{self.path}: was made for {key} = {getattr(found, key)}, expected {expected}")
        if abs(found.cell - spec.cell) > 1e-9:
            raise EchogridError(f"{self.path}: was made for cell = {found.cell} m, expected {spec.cell} m")
        if list(self._input.shape) != [1, 1, spec.cells, spec.cells]:
            raise EchogridError(f"{self.path}: takes an input of shape {self._input.shape}, expected {[1, 1, spec.cells, spec.cells]}")
        if not found.golden:
            raise EchogridError(f"{self.path}: metadata '{KEY}' hold no golden answers to check it by")
        for number, golden in enumerate(found.golden):
            self._check_golden(number, golden, spec)

    def _check_golden(self, number: int, golden: Golden, spec: GridSpec) -> None:
        blocks = spec.cells // COARSE
        if len(golden.occupied) % 2 or len(golden.coarse) != 4 * blocks**2:
            raise EchogridError(f"{self.path}: golden answer {number} is not of {blocks} x {blocks} blocks")
        occupied = np.frombuffer(golden.occupied, dtype="<u2")
        if len(occupied) and occupied.max() >= spec.cells**2:
            raise EchogridError(f"{self.path}: golden answer {number} names cell {occupied.max()}, expected below {spec.cells**2}")
        image = np.full((1, spec.cells, spec.cells), -1.0, dtype=np.float32)
        image.reshape(-1)[occupied] = 1.0
        worst = float(np.abs(coarse(self(image)) - np.frombuffer(golden.coarse, dtype="<f4").reshape(blocks, blocks)).max())
        if not worst <= TOLERANCE:  # no number neither
            raise EchogridError(f"{self.path}: golden answer {number} is off by {worst:.3g}, expected at most {TOLERANCE:g}")


def coarse(output: Image) -> NDArray[np.float32]:
    """(H / COARSE, W / COARSE) means over blocks of an output (H, W)."""
    height, width = output.shape
    means: NDArray[np.float32] = output.reshape(height // COARSE, COARSE, width // COARSE, COARSE).mean(axis=(1, 3), dtype=np.float32)
    return means
