#!/bin/sh
# onnxconverter-common's float16 makes models that onnxruntime refuses: of unnamed nodes, of a Cast, of a Constant with value_float, of QuantizeLinear.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnxconverter-common==1.16.0 onnx==1.23.2 onnxruntime==1.32.0 numpy==2.4.6
cd "$folder"
venv/bin/python -W ignore - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from onnxconverter_common.float16 import convert_float_to_float16

onnxruntime.set_default_logger_severity(4)


def converted(nodes, **constants):
    """Whether the model of these nodes runs as float16 with float32 at its ends, or what onnxruntime says."""
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [4]) for name in "xy"]
    graph = helper.make_graph(nodes, "a", values[:1], values[1:], [numpy_helper.from_array(one, name) for name, one in constants.items()])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    given = {"x": np.array([-1.5, 0.25, 1.0, 2.0], np.float32)}
    want = onnxruntime.InferenceSession(model.SerializeToString()).run(None, given)[0]
    try:
        half = convert_float_to_float16(model, keep_io_types=True).SerializeToString()
        return bool(np.allclose(onnxruntime.InferenceSession(half).run(None, given)[0], want, atol=1e-2))
    except Exception as error:  # of onnxruntime, by its kind of failure
        return str(error)


node = helper.make_node
twice = [("Relu", ["x"], ["a"]), ("Neg", ["x"], ["b"]), ("Add", ["a", "b"], ["y"])]
seen = {
    "named nodes": converted([node(kind, into, out, name=kind) for kind, into, out in twice]),
    "the same without names": converted([node(*one) for one in twice]),
    "Constant with value_float": converted([node("Constant", [], ["a"], name="c", value_float=2.0), node("Mul", ["x", "a"], ["y"], name="m")]),
    "Cast to int32 and back": converted([node("Cast", ["x"], ["a"], name="c", to=TensorProto.INT32), node("Cast", ["a"], ["y"], name="d", to=TensorProto.FLOAT)]),
    "quantised": converted(
        [node("QuantizeLinear", ["x", "s", "z"], ["a"], name="q"), node("DequantizeLinear", ["a", "s", "z"], ["y"], name="d")],
        s=np.float32(0.05),
        z=np.uint8(128),
    ),
}
for name, found in seen.items():
    print(f"onnxconverter-common {version('onnxconverter-common')}, {name}: {'runs' if found is True else found}")
assert seen["named nodes"] is True
assert "two nodes with same node name" in seen["the same without names"]
assert all("Type" in str(seen[name]) for name in list(seen)[2:])
PYTHON
