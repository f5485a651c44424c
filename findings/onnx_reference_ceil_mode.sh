#!/bin/sh
# onnx's reference evaluator moves the windows of a pooling with ceil_mode: a MaxPool that keeps the size makes the map larger, an AveragePool shifts it.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnx==1.23.2 onnxruntime==1.32.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper
from onnx.reference import ReferenceEvaluator

onnxruntime.set_default_logger_severity(4)
grid = np.arange(1, 57, dtype=np.float32).reshape(1, 1, 7, 8)


def pooled(kind, strides, pads, ceil_mode):
    """What a plain loop over the windows, onnxruntime and the reference evaluator make of 7 by 8 cells."""
    node = helper.make_node(kind, ["x"], ["y"], kernel_shape=[3, 3], strides=[strides] * 2, pads=[pads] * 4, ceil_mode=ceil_mode)
    values = [helper.make_tensor_value_info("x", TensorProto.FLOAT, grid.shape), helper.make_tensor_value_info("y", TensorProto.FLOAT, list("nchw"))]
    model = helper.make_model(helper.make_graph([node], "a", values[:1], values[1:]), opset_imports=[helper.make_opsetid("", 19)], ir_version=9)
    onnx.checker.check_model(model, full_check=True)
    around = np.full((7 + 2 * pads + strides, 8 + 2 * pads + strides), np.nan)
    around[pads : pads + 7, pads : pads + 8] = grid[0, 0]
    rows, columns = [int((np.ceil if ceil_mode else np.floor)((size + 2 * pads - 3) / strides)) + 1 for size in (7, 8)]
    best = np.nanmax if kind == "MaxPool" else np.nanmean
    plain = np.array([[best(around[r * strides : r * strides + 3, c * strides : c * strides + 3]) for c in range(columns)] for r in range(rows)])
    runtime = onnxruntime.InferenceSession(model.SerializeToString()).run(None, {"x": grid})[0][0, 0]
    return plain, runtime, ReferenceEvaluator(model).run(None, {"x": grid})[0][0, 0]


seen = {}
for kind, strides, pads in (("MaxPool", 1, 1), ("AveragePool", 3, 0)):
    for ceil_mode in (0, 1):
        plain, runtime, reference = pooled(kind, strides, pads, ceil_mode)
        assert np.allclose(plain, runtime)
        seen[kind, ceil_mode] = plain.shape, reference.shape, bool(plain.shape == reference.shape and np.allclose(plain, reference))
        print(
            f"onnx {version('onnx')}, {kind} 3 by 3, stride {strides}, pads {pads}, ceil_mode {ceil_mode}: onnxruntime {version('onnxruntime')} "
            f"and a loop {plain.shape} {plain[0, :3]}, the reference evaluator {reference.shape} {reference[0, :3]}"
        )
assert seen == {
    ("MaxPool", 0): ((7, 8), (7, 8), True),
    ("MaxPool", 1): ((7, 8), (9, 10), False),
    ("AveragePool", 0): ((2, 2), (2, 2), True),
    ("AveragePool", 1): ((3, 3), (3, 3), False),
}
PYTHON
