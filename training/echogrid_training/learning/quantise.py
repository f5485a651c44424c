"""A float graph as int8: static, with the steps of every tensor chosen by what real images make it hold.

Bytes times signed bytes of 7 bits. x86 without VNNI adds two products in 16 bits, where those of 8 bits would be cut off; so one file gives
the same answer, bit for bit, on every processor.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

ROUND = 16  # channels that a convolution makes together: onnxruntime's kernels take a row of fewer one by one
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


def streamlined(model: onnx.ModelProto) -> onnx.ModelProto:
    """The same answers of a quantised graph, bit for bit, in less time: what doubles the cells along each side is written as joins, which
    onnxruntime does piece by piece where its Resize goes cell by cell, and the last convolution makes a round number of channels."""
    shapes = {
        one.name: [side.dim_value for side in one.type.tensor_type.shape.dim]
        for one in onnx.shape_inference.infer_shapes(model).graph.value_info
    }
    for node in [node for node in model.graph.node if node.op_type == "Resize"]:
        _double_by_joins(model.graph, node, shapes[node.input[0]])
    _round_the_last(model.graph)
    used = {name for node in model.graph.node for name in node.input}
    for one in [one for one in model.graph.initializer if one.name not in used]:
        model.graph.initializer.remove(one)
    onnx.checker.check_model(model)
    return model


def _double_by_joins(graph: onnx.GraphProto, resize: onnx.NodeProto, shape: list[int]) -> None:
    """In bytes: cells beside each other in memory, each row joined with itself cell by cell, then row by row."""
    _, channels, height, width = shape
    (before,) = [node for node in graph.node if resize.input[0] in node.output]
    (after,) = [node for node in graph.node if resize.output[0] in node.input]
    assert (before.op_type, after.op_type) == ("DequantizeLinear", "QuantizeLinear")
    assert before.input[1:] == after.input[1:]  # the very bytes come out
    name = resize.name
    graph.initializer.extend(
        [
            numpy_helper.from_array(np.array((height, 2 * width * channels)), f"{name}_rows"),
            numpy_helper.from_array(np.array((1, 2 * height, 2 * width, channels)), f"{name}_cells"),
        ]
    )
    steps: tuple[tuple[str, tuple[str, ...], dict[str, Any]], ...] = (
        ("Transpose", (before.input[0],), {"perm": (0, 2, 3, 1)}),
        ("Concat", (f"{name}_0",) * 2, {"axis": 3}),
        ("Reshape", (f"{name}_1", f"{name}_rows"), {}),
        ("Concat", (f"{name}_2",) * 2, {"axis": 1}),
        ("Reshape", (f"{name}_3", f"{name}_cells"), {}),
        ("Transpose", (f"{name}_4",), {"perm": (0, 3, 1, 2)}),
    )
    at = list(graph.node).index(resize)
    for number, (kind, given, how) in enumerate(steps):
        out = after.output[0] if number == len(steps) - 1 else f"{name}_{number}"
        graph.node.insert(at + number, helper.make_node(kind, given, [out], name=f"{name}_{number}", **how))
    for node in (before, resize, after):
        graph.node.remove(node)


def _round_the_last(graph: onnx.GraphProto) -> None:
    """The convolution that makes the answer: channels of zeros behind its own, cut off again."""
    made, constants = {node.output[0]: node for node in graph.node}, {one.name: one for one in graph.initializer}
    last = made[graph.output[0].name]
    convolution = made[made[last.input[0]].input[0]]
    assert (last.op_type, convolution.op_type) == ("DequantizeLinear", "Conv")
    channels = len(numpy_helper.to_array(constants[made[convolution.input[1]].input[0]]))
    missing = -channels % ROUND
    for given in convolution.input[1:]:
        values, step, zero = (constants[name] for name in made[given].input)
        for one in (values, step, zero):
            array = numpy_helper.to_array(one)
            more = np.repeat(array[:1], missing, axis=0)  # a bias's steps must be those of its weights, here too
            more = np.zeros_like(more) if one is values else more
            one.CopyFrom(numpy_helper.from_array(np.concatenate((array, more)), one.name))
    bounds = {"begin": 0, "end": channels, "axis": 1}
    graph.initializer.extend(numpy_helper.from_array(np.array((value,)), f"answer_{key}") for key, value in bounds.items())
    cut = helper.make_node("Slice", [last.input[0], *(f"answer_{key}" for key in bounds)], ["answer_cut"], name="answer_cut")
    graph.node.insert(list(graph.node).index(last), cut)
    last.input[0] = "answer_cut"
    del graph.value_info[:]  # shapes that are others now, and can be told from the rest
