"""Model files: a small network made by hand, and every way in which a file is not what it should be."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from echogrid.core.raster import GridSpec
from echogrid.errors import EchogridError
from echogrid.io.model import OnnxSensorModel

SPEC = GridSpec(cells=16, cell=0.5)


def golden(occupied: list[int], means: list[float]) -> dict[str, str]:
    """An image and the means of its four blocks of 8 x 8 cells, as a contract holds them."""
    arrays = (np.array(occupied, dtype="<u2"), np.array(means, dtype="<f4"))
    return {name: base64.b64encode(array.tobytes()).decode() for name, array in zip(("occupied", "coarse"), arrays, strict=True)}


EMPTY = -2.5  # what the network below answers to an empty image, everywhere
CONTRACT: dict[str, Any] = {
    "version": 1,
    "cells": 16,
    "cell": 0.5,
    "channels": ["detections"],
    "input_range": [-1.0, 1.0],
    "output": "log-odds",
    "golden": [golden([17, 200], [EMPTY + 6 / 64, EMPTY, EMPTY, EMPTY + 6 / 64])],  # cell 200 is in row 12, column 8
}


def write(path: Path, contract: object = CONTRACT, shape: tuple[int, ...] = (1, 1, 16, 16)) -> Path:
    """The network 3 x + 0.5, with a contract."""
    nodes = [helper.make_node("Mul", ["image", "three"], ["tripled"]), helper.make_node("Add", ["tripled", "half"], ["logits"])]
    constants = [helper.make_tensor(name, TensorProto.FLOAT, [], [value]) for name, value in (("three", 3.0), ("half", 0.5))]
    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name in ("image", "logits")]
    model = helper.make_model(helper.make_graph(nodes, "net", ends[:1], ends[1:], constants), opset_imports=[helper.make_opsetid("", 18)])
    model.ir_version = 10
    if contract is not None:
        helper.set_model_props(model, {"echogrid": contract if isinstance(contract, str) else json.dumps(contract)})
    onnx.save(model, path)
    return path


def test_log_odds_are_the_networks_output(tmp_path: Path) -> None:
    infer = OnnxSensorModel(write(tmp_path / "net.onnx"), SPEC)
    image = np.random.default_rng(1).choice((-1.0, 1.0), (1, 16, 16)).astype(np.float32)
    np.testing.assert_allclose(infer(image), 3.0 * image[0] + 0.5, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"version": 2}, "was made for version = 2, expected 1"),
        ({"cells": 32}, "was made for cells = 32, expected 16"),
        ({"cell": 0.25}, "was made for cell = 0.25 m, expected 0.5 m"),
        ({"channels": ["detections", "rcs"]}, "was made for channels = ('detections', 'rcs')"),
        ({"input_range": [0.0, 1.0]}, "was made for input_range = (0.0, 1.0), expected (-1.0, 1.0)"),
        ({"output": "probability"}, "was made for output = probability, expected log-odds"),
        ({"golden": []}, "hold no golden answers"),
        ({"golden": [golden([], [EMPTY, EMPTY, EMPTY, 3.0])]}, "golden answer 0 is off by 5.5"),
        ({"golden": [golden([], [EMPTY, EMPTY, EMPTY, math.nan])]}, "golden answer 0 is off by nan"),
        ({"golden": [golden([256], [EMPTY] * 4)]}, "golden answer 0 names cell 256, expected below 256"),
        ({"golden": [golden([], [EMPTY] * 3)]}, "golden answer 0 is not of 2 x 2 blocks"),
        ({"golden": [{"occupied": "?", "coarse": ""}]}, "metadata 'echogrid': "),
        ({"input_range": [1.0]}, "metadata 'echogrid': Expected `array` of length 2"),
    ],
)
def test_a_model_that_was_made_for_something_else_is_refused(tmp_path: Path, change: dict[str, Any], complaint: str) -> None:
    path = write(tmp_path / "net.onnx", CONTRACT | change)
    with pytest.raises(EchogridError) as caught:
        OnnxSensorModel(path, SPEC)
    assert str(caught.value).startswith(f"{path}: ")
    assert complaint in str(caught.value)


def test_what_is_no_model_of_ours_is_refused(tmp_path: Path) -> None:
    for content, complaint in ((None, "has no metadata 'echogrid'"), ("{", "metadata 'echogrid'")):
        with pytest.raises(EchogridError, match=complaint):
            OnnxSensorModel(write(tmp_path / "net.onnx", content), SPEC)
    with pytest.raises(EchogridError, match="takes an input of shape"):
        OnnxSensorModel(write(tmp_path / "net.onnx", shape=(1, 2, 16, 16)), SPEC)
    (tmp_path / "noise.onnx").write_bytes(b"noise")
    with pytest.raises(EchogridError, match="is no ONNX model that onnxruntime reads"):
        OnnxSensorModel(tmp_path / "noise.onnx", SPEC)
    with pytest.raises(EchogridError, match="cannot be read: No such file"):
        OnnxSensorModel(tmp_path / "none.onnx", SPEC)
