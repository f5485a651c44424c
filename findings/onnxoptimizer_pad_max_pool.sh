#!/bin/sh
# onnxoptimizer folds a Pad with zeros into the MaxPool behind it, whose padding never wins: cells at the edge come out negative, not 0.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnxoptimizer==0.4.2 onnx==1.23.2 onnxruntime==1.32.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import onnx
import onnxoptimizer
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

onnxruntime.set_default_logger_severity(4)


def model(kind):
    """One row and column of zeros around the input, then pooling of 3 by 3 cells."""
    nodes = [helper.make_node("Pad", ["x", "p"], ["t"]), helper.make_node(kind, ["t"], ["y"], kernel_shape=[3, 3])]
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 1, 4, 4]) for name in "xy"]
    pads = numpy_helper.from_array(np.array([0, 0, 1, 1, 0, 0, 1, 1], np.int64), "p")
    graph = helper.make_graph(nodes, "a", values[:1], values[1:], [pads])
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(made, full_check=True)
    return made


logits = np.full((1, 1, 4, 4), -2.0, np.float32)  # surely free, everywhere
seen = {}
for kind in ("MaxPool", "AveragePool"):
    whole = model(kind)
    small = onnxoptimizer.optimize(whole)
    corner = [float(onnxruntime.InferenceSession(one.SerializeToString()).run(None, {"x": logits})[0][0, 0, 0, 0]) for one in (whole, small)]
    seen[kind] = [node.op_type for node in small.graph.node], [round(value, 3) for value in corner]
    print(f"onnxoptimizer {version('onnxoptimizer')}: Pad and {kind} become {seen[kind][0]}; the corner was {corner[0]:.3f}, is {corner[1]:.3f}")
assert seen["MaxPool"] == (["MaxPool"], [0.0, -2.0])
assert seen["AveragePool"][1][0] == seen["AveragePool"][1][1] == -0.889
PYTHON
