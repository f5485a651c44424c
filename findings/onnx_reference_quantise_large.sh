#!/bin/sh
# onnx's reference evaluator quantises what is above 2147483647 steps, infinity among it, to the least value; onnxruntime to the greatest.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnxruntime==1.32.0
"$folder/venv/bin/pip" install --quiet onnx==1.23.2 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper
from onnx.reference import ReferenceEvaluator

values = {"x": np.array([100, 1e9, 3e9, np.inf], np.float32), "scale": np.array(1, np.float32), "zero": np.array(0, np.uint8)}
inputs = [helper.make_tensor_value_info(name, helper.np_dtype_to_tensor_dtype(one.dtype), one.shape) for name, one in values.items()]
node = helper.make_node("QuantizeLinear", list(values), ["y"])
graph = helper.make_graph([node], "graph", inputs, [helper.make_tensor_value_info("y", TensorProto.UINT8, [4])])
model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 21)], ir_version=10)
onnx.checker.check_model(model)
session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
with np.errstate(invalid="ignore"):
    seen = {name: one.run(None, values)[0].tolist() for name, one in (("onnxruntime", session), ("reference", ReferenceEvaluator(model)))}
print(f"onnxruntime {onnxruntime.__version__}, onnx {onnx.__version__}: {values['x'].tolist()} in steps of 1 as uint8: {seen}")
assert seen == {"onnxruntime": [100, 255, 255, 255], "reference": [100, 255, 0, 0]}
PYTHON
