"""The int8 files against the float one, and what a processor is given to do in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper, numpy_helper
from tests.support.rectangles import rectangles

from echogrid.core.evidence.raster import GridSpec
from echogrid.model.network import OnnxSensorModel
from echogrid_training.learning.quantise import TARGETS, Target, quantised

INT8 = ("default.x86.onnx", "default.arm.onnx")


@pytest.fixture(scope="module")
def answers(unet_files: dict[str, Path]) -> dict[str, np.ndarray]:
    """(N, 3, H, W) class logits of every file for rooms that nothing was learned or calibrated with."""
    images = rectangles(6, 77).images
    models = {name: OnnxSensorModel(path, GridSpec(), {}) for name, path in unet_files.items()}
    return {name: np.stack([model.run(image) for image in images]) for name, model in models.items()}


@pytest.mark.parametrize("name", INT8)
def test_int8_agrees_with_float_on_images_that_it_was_not_calibrated_with(answers: dict[str, np.ndarray], name: str) -> None:
    """Within a few tenths of a logit where the classes compete, and in nearly all cells about which class it is."""
    exact, rounded = answers["default.onnx"], answers[name]
    off = np.abs(rounded - exact)
    spread = exact.max() - exact.min()
    assert np.sqrt((off**2).mean()) < 0.02 * spread
    assert np.sqrt((off**2).mean()) < 0.3
    assert (exact.argmax(axis=1) == rounded.argmax(axis=1)).mean() > 0.98
    assert off.max() > 1e-4  # it is another file


def test_the_x86_file_is_worked_in_integers(unet_files: dict[str, Path], tmp_path: Path) -> None:
    """As onnxruntime rewrites it for this machine: every convolution on bytes, none left in float."""
    convolutions = [node.op_type for node in onnx.load(unet_files["default.onnx"]).graph.node].count("Conv")
    assert convolutions > 10
    options = onnxruntime.SessionOptions()
    options.optimized_model_filepath = str(tmp_path / "optimised.onnx")
    options.log_severity_level = 3  # it warns that the file is for this machine
    onnxruntime.InferenceSession(unet_files["default.x86.onnx"], options, providers=["CPUExecutionProvider"])
    kinds = [node.op_type for node in onnx.load(tmp_path / "optimised.onnx").graph.node]
    assert kinds.count("QLinearConv") == convolutions
    assert not {"Conv", "FusedConv", "ConvTranspose"} & set(kinds)


@pytest.mark.parametrize("name", INT8)
def test_the_input_is_bytes_in_steps_of_a_255th(unet_files: dict[str, Path], name: str) -> None:
    proto = onnx.load(unet_files[name])
    assert "ConvTranspose" not in {node.op_type for node in proto.graph.node}
    assert [one.type.tensor_type.elem_type for one in proto.graph.input] == [TensorProto.UINT8]
    constants = {one.name: numpy_helper.to_array(one) for one in proto.graph.initializer}
    (first,) = [node for node in proto.graph.node if "image" in node.input]
    assert first.op_type == "DequantizeLinear"
    assert constants[first.input[1]] == np.float32(1 / 255)
    assert constants[first.input[2]] == 0


@pytest.mark.parametrize("name", INT8)
def test_weights_are_bytes_and_fit_7_bits_on_x86(unet_files: dict[str, Path], name: str) -> None:
    """Two products of 8 and 7 bits fit 16: without VNNI, more would be cut off."""
    proto = onnx.load(unet_files[name])
    constants = {one.name: numpy_helper.to_array(one) for one in proto.graph.initializer}
    made = {node.output[0]: node for node in proto.graph.node}
    weights = [constants[made[node.input[1]].input[0]] for node in proto.graph.node if node.op_type == "Conv"]
    assert all(weight.dtype == np.int8 for weight in weights)
    largest = max(int(np.abs(weight.astype(int)).max()) for weight in weights)
    assert largest <= (64 if "x86" in name else 127)
    assert largest > (60 if "x86" in name else 120)  # and the range is used
    if "x86" in name:
        assert 2 * 255 * largest < 2**15


def one_convolution(weights: np.ndarray) -> onnx.ModelProto:
    """(1, 2, 4, 4) -> (1, 3, 4, 4), 1 x 1."""
    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, (1, planes, 4, 4)) for name, planes in (("image", 2), ("answer", 3))]
    node = helper.make_node("Conv", ["image", "weights"], ["answer"], kernel_shape=[1, 1])
    graph = helper.make_graph([node], "one", ends[:1], ends[1:], [numpy_helper.from_array(weights[..., None, None], "weights")])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)])
    model.ir_version = 10
    return model


@pytest.mark.parametrize("target", TARGETS)
def test_one_convolution_is_off_by_no_more_than_its_steps(target: Target) -> None:
    """By hand: half a step of each weight times what it is multiplied with, and half a step of the sum; rows of very unlike size each
    have a step of their own."""
    weights = np.array([(1.0, -0.6), (0.01, 0.02), (-30.0, 7.0)], dtype=np.float32)
    rng = np.random.default_rng(1)
    images = rng.integers(0, 256, (20, 2, 4, 4)).astype(np.uint8)
    images[0], images[1] = 0, 255
    exact = np.einsum("pc,ncij->npij", weights, images / 255)
    model = quantised(one_convolution(weights), "image", (images / 255).astype(np.float32), target)
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    found = np.concatenate([session.run(None, {"image": image[None]})[0] for image in images])
    weight_step = np.abs(weights).max(axis=1) / (64 if target == "x86" else 127)
    bound = weight_step[:, None, None] / 2 * (images / 255).sum(axis=1, keepdims=True) + (exact.max() - exact.min()) / 255 * 0.75
    assert (np.abs(found - exact) <= bound).all()
