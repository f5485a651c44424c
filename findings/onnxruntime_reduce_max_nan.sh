#!/bin/sh
# onnxruntime's ReduceMax and ReduceMin of all of a tensor are NaN where the NaN is first, and pass over it elsewhere; onnx's reference gives NaN.
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


def models(kind: str):
    """Of onnxruntime, and the reference."""
    given, found = (helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in (("x", [3]), ("y", [])))
    graph = helper.make_graph([helper.make_node(kind, ["x"], ["y"], keepdims=0)], "graph", [given], [found])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    onnx.checker.check_model(model)
    return onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"]), ReferenceEvaluator(model)


nan, seen = float("nan"), {}
for kind in ("ReduceMax", "ReduceMin"):
    session, reference = models(kind)
    for row in ([nan, 1, 2], [1, nan, 2], [1, 2, nan]):
        values = {"x": np.array(row, np.float32)}
        seen[f"{kind} of {row}"] = [str(one.run(None, values)[0]) for one in (session, reference)]
print(f"onnxruntime {onnxruntime.__version__}, onnx {onnx.__version__}: {seen}")
assert [onnxruntimes for onnxruntimes, _ in seen.values()] == ["nan", "2.0", "2.0", "nan", "1.0", "1.0"]
assert {references for _, references in seen.values()} == {"nan"}
PYTHON
