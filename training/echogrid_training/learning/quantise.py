"""A float graph as int8: static, with the steps of every tensor chosen by what real images make it hold.

Bytes times signed bytes of 7 bits. x86 without VNNI adds two products in 16 bits, where those of 8 bits would be cut off; so one file gives
the same answer, bit for bit, on every processor.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

BYTE = 1 / 255  # the step of the input: its bytes are what they were
STEPS = {"quant_type": QuantType.QUInt8, "scale": np.array(BYTE, np.float32), "zero_point": np.array(0, np.uint8)}  # of it, from 0


class Shown(CalibrationDataReader):  # type: ignore[misc]
    """Images (N, C, H, W) in [0, 1], one at a time."""

    def __init__(self, name: str, images: NDArray[np.float32]) -> None:
        self._left: Iterator[dict[str, NDArray[np.float32]]] = ({name: image[None]} for image in images)

    def get_next(self) -> dict[str, NDArray[np.float32]] | None:
        return next(self._left, None)


def quantised(graph: onnx.ModelProto, name: str, images: NDArray[np.float32]) -> onnx.ModelProto:
    """The graph with input `name` as bytes: those of the images in [0, 1] times 255."""
    with tempfile.TemporaryDirectory() as folder:
        float_path, clean, out = (Path(folder) / f"{part}.onnx" for part in ("float", "clean", "int8"))
        onnx.save(graph, float_path)
        quant_pre_process(str(float_path), str(clean), skip_symbolic_shape=True)
        quantize_static(
            str(clean),
            str(out),
            Shown(name, images),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            reduce_range=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            calibrate_method=CalibrationMethod.MinMax,
            extra_options={"TensorQuantOverrides": {name: [STEPS]}},
        )
        return with_bytes(onnx.load(out), name)


def with_bytes(model: onnx.ModelProto, name: str) -> onnx.ModelProto:
    """The input as bytes, made floats by a DequantizeLinear of its own before all else."""
    graph = model.graph
    (given,) = [one for one in graph.input if one.name == name]
    inside = f"{name}_as_float"
    for node in graph.node:
        for index, taken in enumerate(node.input):
            if taken == name:
                node.input[index] = inside
    graph.initializer.extend(
        [numpy_helper.from_array(np.array(BYTE, np.float32), "byte_step"), numpy_helper.from_array(np.array(0, np.uint8), "byte_zero")]
    )
    graph.node.insert(0, helper.make_node("DequantizeLinear", [name, "byte_step", "byte_zero"], [inside], name="bytes"))
    given.type.tensor_type.elem_type = onnx.TensorProto.UINT8
    return model
