#!/bin/sh
# onnxslim takes a vector that scales the columns of what a convolution gives for one of its channels where there are as many: other values.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnxslim==0.1.98 onnx==1.23.2 onnxruntime==1.32.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import onnx
import onnxruntime
import onnxslim
from onnx import TensorProto, helper, numpy_helper

onnxruntime.set_default_logger_severity(4)
random = np.random.default_rng(1)


def slimmed(kind, channels, side, shape):
    """What becomes of kind, 3 by 3 at the same size, and a Mul with a vector of this shape behind it, on a grid of side by side cells."""
    weights = random.normal(size=(channels, 2, 3, 3) if kind == "Conv" else (2, channels, 3, 3)).astype(np.float32)
    scale = np.arange(1, 1 + np.prod(shape), dtype=np.float32).reshape(shape)
    nodes = [helper.make_node(kind, ["x", "w"], ["t"], kernel_shape=[3, 3], pads=[1, 1, 1, 1]), helper.make_node("Mul", ["t", "s"], ["y"])]
    floats = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, count, side, side]) for name, count in (("x", 2), ("y", channels))]
    graph = helper.make_graph(nodes, "a", floats[:1], floats[1:], [numpy_helper.from_array(weights, "w"), numpy_helper.from_array(scale, "s")])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    values = random.normal(size=(1, 2, side, side)).astype(np.float32)
    slim = onnxslim.slim(model)
    found = [onnxruntime.InferenceSession(one.SerializeToString()).run(None, {"x": values})[0] for one in (model, slim)]
    return [node.op_type for node in slim.graph.node], bool(np.allclose(*found, rtol=1e-4, atol=1e-4))


cases = {
    "a factor a channel": ("Conv", 8, 8, (8, 1, 1)),
    "a factor a column, 8 channels, 8 by 8 cells": ("Conv", 8, 8, (8,)),
    "a factor a row, 8 channels, 8 by 8 cells": ("Conv", 8, 8, (8, 1)),
    "a factor a column behind ConvTranspose, 8 by 8 cells": ("ConvTranspose", 8, 8, (8,)),
    "a factor a column, 8 channels, 16 by 16 cells": ("Conv", 8, 16, (16,)),
}
seen = {name: slimmed(*case) for name, case in cases.items()}
for name, (left, same) in seen.items():
    print(f"onnxslim {version('onnxslim')}: {name}: {left}, {'the same values' if same else 'OTHER values'}")
assert [same for _, same in seen.values()] == [True, False, False, False, True]
PYTHON
