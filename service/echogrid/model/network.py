"""A learned inverse sensor model in ONNX, checked against its own contract before anything else is opened."""

from __future__ import annotations

import hashlib
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read by the import: it would report its use to its makers
import onnxruntime
from numpy.typing import NDArray

from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.history_raster import CHANNELS, Bytes, HistoryRaster
from echogrid.core.evidence.raster import GridSpec, Image, rasterize
from echogrid.core.kernels.dispatch import loops
from echogrid.core.map.look_map import Calibration
from echogrid.core.radar.mount import Mount
from echogrid.errors import EchogridError
from echogrid.files import read

KEY, VERSION = "echogrid", 2  # of the metadata: the contract as JSON
PAPER = ("detections",)
FOLD = 2  # cells along a side of the blocks that are folded into channels (space to depth)
COARSE = 8  # cells along a side of a block whose mean a golden answer keeps
# Of golden answers, in logits. Float sums differ between machines by far less. Those of int8 are whole numbers that no kernel has to cut
# off (echogrid_training.learning.quantise), the same everywhere: sums that were cut off showed by 0.08 and more.
TOLERANCE = {"float": 1e-3, "int8": 0.05}
MOST_BYTES = 256 << 20  # of a file
MOST_GOLDEN = 1 << 20  # bytes of an image, unpacked

Planes = NDArray[np.float32]
Precision = Literal["float", "int8"]


class Golden(msgspec.Struct, frozen=True):
    """An image and what the network makes of it, small enough to travel along (base64 in the JSON)."""

    image: bytes  # zlib of uint8 (C, H, W); the paper's: 1 where a detection is, else 0
    coarse: bytes  # float32 little-endian (P, H / COARSE, W / COARSE): means of the output over blocks


class Contract(msgspec.Struct, frozen=True, kw_only=True):
    """What to draw for the file, and what comes out. A file may say more about its training."""

    version: int
    cells: int  # along a side: row i is y, column j is x, cell [0, 0] at the rear right
    cell: float  # m
    channels: tuple[str, ...]  # the paper's one, (1, 1, H, W) of -1 and 1, or history_raster's, folded (1, 4 C, H / 2, W / 2) bytes
    output: Literal["log-odds", "class-logits"]  # (1, H, W), or of free, unknown and occupied, folded: (1, 4 * 3, H / 2, W / 2)
    precision: Precision
    fusion: Literal["sum", "looks"]  # the map's rule that it is meant for
    calibration: Calibration  # of the rule `looks`
    golden: tuple[Golden, ...]


class OnnxSensorModel:
    """Callable: surroundings in base -> (2, H, W), log-odds of occupied and the weight of the answer, 0 … 1.

    The weight is how far the network holds a cell for observable; 1 where it has no class for that. One thread: on a busy machine two
    make the slowest runs far slower.
    """

    def __init__(self, path: Path, spec: GridSpec, mounts: Mapping[str, Mount], sha256: str | None = None) -> None:
        """Raises EchogridError if the file has another SHA-256 (None: any will do), is not a model, was made for another grid, or does not
        give its golden answers."""
        self.path = path
        self.spec = spec
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # a waiting core is not ours to burn
        data = read(path, MOST_BYTES)
        self.sha256 = hashlib.sha256(data).hexdigest()
        if sha256 is not None and self.sha256 != sha256:
            raise EchogridError(f"{path}: has the SHA-256 {self.sha256}, expected {sha256}")
        try:
            self._session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime's errors have no common class
            raise EchogridError(f"{path}: is not an ONNX model that onnxruntime reads: {_line(error)}") from error
        self.contract = self._read_contract()
        self._input = self._session.get_inputs()[0].name
        self._check(spec)
        self._raster = HistoryRaster(spec, mounts)

    def __call__(self, around: Surroundings) -> Planes:
        return self.answer(self.draw(around))

    def draw(self, around: Surroundings) -> Bytes:
        """(C, H, W), the image that the contract's channels ask for."""
        if self.contract.channels == PAPER:
            return (rasterize(around.now.points, self.spec) > 0).astype(np.uint8)
        return self._raster(around)

    def answer(self, image: Bytes) -> Planes:
        """(2, H, W) log-odds and weight for a drawn image."""
        output = self._output(image)
        if self.contract.output == "log-odds":
            return np.concatenate((output, np.ones_like(output)))
        answer = np.empty((2, image.shape[1], image.shape[2]), dtype=np.float32)
        loops.odds(output[0], answer)
        return answer

    def run(self, image: Bytes) -> Planes:
        """(P, H, W), the network's own output for a drawn image (C, H, W)."""
        output = self._output(image)
        return output if self.contract.output == "log-odds" else unfolded(output[0])

    def _output(self, image: Bytes) -> Planes:
        """As the file gives it: see `Contract.output`."""
        (output,) = self._session.run(None, {self._input: fed(image)})
        return np.asarray(output)

    def _read_contract(self) -> Contract:
        try:
            text = self._session.get_modelmeta().custom_metadata_map.get(KEY)
        except UnicodeDecodeError as error:
            raise EchogridError(f"{self.path}: has metadata that is not text") from error
        if text is None:
            raise EchogridError(f"{self.path}: has no metadata '{KEY}': it was not exported for this service")
        try:
            return msgspec.json.decode(text, type=Contract)
        except msgspec.DecodeError as error:
            raise EchogridError(f"{self.path}: metadata '{KEY}': {error}") from error

    def _check(self, spec: GridSpec) -> None:
        found = self.contract
        for key, expected in {"version": VERSION, "cells": spec.cells}.items():
            if getattr(found, key) != expected:
                raise EchogridError(f"{self.path}: was made for {key} = {getattr(found, key)}, expected {expected}")
        if abs(found.cell - spec.cell) > 1e-9:
            raise EchogridError(f"{self.path}: was made for cell = {found.cell} m, expected {spec.cell} m")
        if found.channels not in (PAPER, CHANNELS):
            raise EchogridError(f"{self.path}: was made for channels = {found.channels}, expected {PAPER} or {CHANNELS}")
        side, half = spec.cells, spec.cells // FOLD
        expected_input = (
            ("tensor(float)", [1, 1, side, side])
            if found.channels == PAPER
            else ("tensor(uint8)", [1, FOLD**2 * len(CHANNELS), half, half])
        )
        expected_output = ("tensor(float)", [1, side, side] if found.output == "log-odds" else [1, 3 * FOLD**2, half, half])
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        if (len(inputs), len(outputs)) != (1, 1):
            taken, given = (", ".join(end.name for end in ends) for ends in (inputs, outputs))
            raise EchogridError(f"{self.path}: has inputs {taken} and outputs {given}, expected one of each")
        for does, end, expected_end in (("takes", inputs[0], expected_input), ("gives", outputs[0], expected_output)):
            if (end.type, list(end.shape)) != expected_end:
                raise EchogridError(
                    f"{self.path}: {does} a {end.type} of shape {end.shape}, expected a {expected_end[0]} of shape {expected_end[1]}"
                )
        if not found.golden:
            raise EchogridError(f"{self.path}: metadata '{KEY}' holds no golden answers to check it with")
        for number, golden in enumerate(found.golden):
            self._check_golden(number, golden)

    def _check_golden(self, number: int, golden: Golden) -> None:
        shape = (len(self.contract.channels), self.spec.cells, self.spec.cells)
        blocks = self.spec.cells // COARSE
        planes = 1 if self.contract.output == "log-odds" else 3
        try:
            image = zlib.decompressobj().decompress(golden.image, MOST_GOLDEN)
        except zlib.error as error:
            raise EchogridError(f"{self.path}: golden answer {number} is not a packed image: {error}") from error
        if len(image) != np.prod(shape) or len(golden.coarse) != 4 * planes * blocks**2:
            raise EchogridError(f"{self.path}: golden answer {number} is not of {planes} x {blocks} x {blocks} blocks for an image {shape}")
        try:
            found = coarse(self.run(np.frombuffer(image, np.uint8).reshape(shape)))
        except Exception as error:  # onnxruntime's again
            raise EchogridError(f"{self.path}: does not run: {_line(error)}") from error
        worst = float(np.abs(found - np.frombuffer(golden.coarse, dtype="<f4").reshape(found.shape)).max())
        tolerance = TOLERANCE[self.contract.precision]
        if not worst <= tolerance:  # no number neither
            raise EchogridError(f"{self.path}: golden answer {number} is off by {worst:.3g}, expected at most {tolerance:g}")


def fed(image: Bytes) -> NDArray[np.uint8] | Image:
    """What a session takes for a drawn image (C, H, W): the paper's one plane as -1 and 1, others folded."""
    return np.where(image[None] > 0, np.float32(1), np.float32(-1)) if len(image) == 1 else folded(image)[None]


def folded(image: Bytes) -> Bytes:
    """Space to depth, see `loops.fold`: (C, H, W) -> (4 C, H / 2, W / 2)."""
    channels, height, width = image.shape
    out = np.empty((FOLD**2 * channels, height // FOLD, width // FOLD), dtype=np.uint8)
    loops.fold(image, out)
    return out


def unfolded(planes: Planes) -> Planes:
    """Depth to space: (4 P, H, W) -> (P, 2 H, 2 W), the inverse of `folded`."""
    channels, height, width = planes.shape
    blocks = planes.reshape(-1, FOLD, FOLD, height, width)
    return blocks.transpose(0, 3, 1, 4, 2).reshape(channels // FOLD**2, FOLD * height, FOLD * width)


def coarse(planes: Planes) -> Planes:
    """(P, H / COARSE, W / COARSE) means over blocks of (P, H, W)."""
    count, height, width = planes.shape
    means: Planes = planes.reshape(count, height // COARSE, COARSE, width // COARSE, COARSE).mean(axis=(2, 4), dtype=np.float32)
    return means


def _line(error: Exception) -> str:
    """The first line of what onnxruntime says, which may be nothing."""
    return next(iter(str(error).splitlines()), type(error).__name__)
