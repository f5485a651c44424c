"""The int8 file against the float one, and what a processor is given to do in it."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from tests.support.rectangles import rectangles
from torch.nn.functional import conv2d

from echogrid.core.evidence.raster import GridSpec
from echogrid.model.network import OnnxSensorModel, fed
from echogrid_training.learning.quantise import quantised

INT8 = "default.int8.onnx"


@pytest.fixture(scope="module")
def graph(unet_files: dict[str, Path]) -> onnx.GraphProto:
    return onnx.load(unet_files[INT8]).graph


def test_int8_agrees_with_float_on_images_that_it_was_not_calibrated_with(unet_files: dict[str, Path]) -> None:
    """Within a few tenths of a logit where the classes compete, and in nearly all cells about which class it is."""
    images = rectangles(6, 77).images
    exact, rounded = (
        np.stack([model.run(image) for image in images])  # (N, 3, H, W) class logits
        for model in (OnnxSensorModel(unet_files[name], GridSpec(), {}) for name in ("default.onnx", INT8))
    )
    off = np.abs(rounded - exact)
    spread = exact.max() - exact.min()
    assert np.sqrt((off**2).mean()) < 0.02 * spread
    assert np.sqrt((off**2).mean()) < 0.3
    assert (exact.argmax(axis=1) == rounded.argmax(axis=1)).mean() > 0.98
    assert off.max() > 1e-4  # it is another file


def test_every_convolution_is_worked_in_integers(unet_files: dict[str, Path], tmp_path: Path) -> None:
    """As onnxruntime rewrites it for this machine: every convolution on bytes, none left in float."""
    convolutions = [node.op_type for node in onnx.load(unet_files["default.onnx"]).graph.node].count("Conv")
    assert convolutions > 10
    options = onnxruntime.SessionOptions()
    options.optimized_model_filepath = str(tmp_path / "optimised.onnx")
    options.log_severity_level = 3  # it warns that the file is for this machine
    onnxruntime.InferenceSession(unet_files[INT8], options, providers=["CPUExecutionProvider"])
    kinds = [node.op_type for node in onnx.load(tmp_path / "optimised.onnx").graph.node]
    assert kinds.count("QLinearConv") == convolutions
    assert not {"Conv", "FusedConv", "ConvTranspose"} & set(kinds)


def test_the_kernels_of_this_machine_give_the_very_integers(unet_files: dict[str, Path], graph: onnx.GraphProto) -> None:
    """To the last bit what is worked out here in whole numbers: a golden answer of one machine is that of all."""
    session = onnxruntime.InferenceSession(unet_files[INT8], providers=["CPUExecutionProvider"])
    for image in rectangles(2, 78).images:
        (found,) = session.run(None, {"image": fed(image)})
        np.testing.assert_array_equal(found, in_whole_numbers(graph, fed(image)))


def in_whole_numbers(graph: onnx.GraphProto, image: np.ndarray) -> np.ndarray:
    """What a quantised graph answers: sums of integers, which float32 factors bring to the steps of the next layer."""
    constants = {one.name: numpy_helper.to_array(one) for one in graph.initializer} | {"image": image}
    made = {node.output[0]: node for node in graph.node}

    def steps(name: str) -> tuple[np.ndarray, np.ndarray]:
        """A tensor as integers, and how much one of them is: float32, or one for each of the channels that a convolution makes."""
        (given, step, zero) = made[name].input
        return rounded(given).astype(np.int64) - int(np.unique(constants[zero])[0]), constants[step]

    def moved(node: onnx.NodeProto) -> np.ndarray:
        """Bytes that only change their places."""
        given, how = [rounded(name) for name in node.input], {one.name: helper.get_attribute_value(one) for one in node.attribute}
        if node.op_type == "Transpose":
            return given[0].transpose(how["perm"])
        if node.op_type == "Concat":
            return np.concatenate(given, axis=how["axis"])
        if node.op_type == "Reshape":
            return given[0].reshape(given[1])
        assert node.op_type == "Slice"
        (begin,), (end,), (axis,) = given[1:]
        return given[0].take(range(begin, end), axis=axis)

    @functools.cache
    def rounded(name: str) -> np.ndarray:
        """A tensor in its bytes."""
        if name in constants:
            return constants[name]
        if made[name].op_type != "QuantizeLinear":
            return moved(made[name])
        (given, step, zero) = made[name].input
        node = made[given]
        if node.op_type == "Conv":
            (x, x_step), (weights, weight_steps), (bias, _) = map(steps, node.input)
            (stride, *_), (pad, *_) = (next(one.ints for one in node.attribute if one.name == key) for key in ("strides", "pads"))
            total = conv2d(*(torch.from_numpy(one).double() for one in (x, weights, bias)), stride, pad).numpy()  # exact: below 2**53
            found = total.astype(np.float32) * (x_step * weight_steps / constants[step])[:, None, None]
        elif node.op_type == "Concat":
            found = np.concatenate([x.astype(np.float32) * x_step / constants[step] for x, x_step in map(steps, node.input)], axis=1)
        else:
            (x, x_step) = steps(given if node.op_type == "DequantizeLinear" else node.input[0])
            assert node.op_type == "DequantizeLinear"
            found = x.astype(np.float32) * x_step / constants[step]
        return np.clip(np.rint(found) + constants[zero], 0, 255).astype(np.uint8)

    integers, step = steps("answer")
    return integers.astype(np.float32) * step


def test_the_input_is_bytes_in_steps_of_a_255th(graph: onnx.GraphProto) -> None:
    assert "ConvTranspose" not in {node.op_type for node in graph.node}
    assert [one.type.tensor_type.elem_type for one in graph.input] == [TensorProto.UINT8]
    constants = {one.name: numpy_helper.to_array(one) for one in graph.initializer}
    (first,) = [node for node in graph.node if "image" in node.input]
    assert first.op_type == "DequantizeLinear"
    assert constants[first.input[1]] == np.float32(1 / 255)
    assert constants[first.input[2]] == 0


def test_weights_are_bytes_and_fit_7_bits(graph: onnx.GraphProto) -> None:
    """Two products of 8 and 7 bits fit 16: on x86 without VNNI, more would be cut off."""
    constants = {one.name: numpy_helper.to_array(one) for one in graph.initializer}
    made = {node.output[0]: node for node in graph.node}
    weights = [constants[made[node.input[1]].input[0]] for node in graph.node if node.op_type == "Conv"]
    assert all(weight.dtype == np.int8 for weight in weights)
    largest = max(int(np.abs(weight.astype(int)).max()) for weight in weights)
    assert 60 < largest <= 64  # and the range is used
    assert 2 * 255 * largest < 2**15


def one_convolution(weights: np.ndarray) -> onnx.ModelProto:
    """(1, 2, 4, 4) -> (1, 3, 4, 4), 1 x 1."""
    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, (1, planes, 4, 4)) for name, planes in (("image", 2), ("answer", 3))]
    node = helper.make_node("Conv", ["image", "weights"], ["answer"], kernel_shape=[1, 1])
    graph = helper.make_graph([node], "one", ends[:1], ends[1:], [numpy_helper.from_array(weights[..., None, None], "weights")])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)])
    model.ir_version = 10
    return model


def test_one_convolution_is_off_by_no_more_than_its_steps() -> None:
    """By hand: half a step of each weight times what it is multiplied with, and half a step of the sum; rows of very unlike size each
    have a step of their own."""
    weights = np.array([(1.0, -0.6), (0.01, 0.02), (-30.0, 7.0)], dtype=np.float32)
    rng = np.random.default_rng(1)
    images = rng.integers(0, 256, (20, 2, 4, 4)).astype(np.uint8)
    images[0], images[1] = 0, 255
    exact = np.einsum("pc,ncij->npij", weights, images / 255)
    model = quantised(one_convolution(weights), "image", (images / 255).astype(np.float32))
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    found = np.concatenate([session.run(None, {"image": image[None]})[0] for image in images])
    weight_step = np.abs(weights).max(axis=1) / 64
    bound = weight_step[:, None, None] / 2 * (images / 255).sum(axis=1, keepdims=True) + (exact.max() - exact.min()) / 255 * 0.75
    assert (np.abs(found - exact) <= bound).all()
