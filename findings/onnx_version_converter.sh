#!/bin/sh
# onnx's version converter changes what Hardmax and a linear Resize or Upsample give in onnxruntime, and makes a GroupNormalization that does not load.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnx==1.23.2 onnxruntime==1.32.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper, version_converter

onnxruntime.set_default_logger_severity(4)
values = np.arange(16, dtype=np.float32).reshape(1, 4, 2, 2) ** 2 % 7


def outcome(model):
    try:
        return onnxruntime.InferenceSession(model.SerializeToString()).run(None, {"x": values})[0]
    except Exception:  # onnxruntime's own classes
        return None


def converted(opset, to, kind, constants, **attributes):
    node = helper.make_node(kind, ["x", *constants], ["y"], **attributes)
    floats = [helper.make_tensor_value_info("x", TensorProto.FLOAT, list(values.shape))], [helper.make_tensor_value_info("y", TensorProto.FLOAT, None)]
    graph = helper.make_graph([node], "a", *floats, [numpy_helper.from_array(np.asarray(one, np.float32), name) for name, one in constants.items()])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    before, after = outcome(model), outcome(version_converter.convert_version(model, to))
    if after is None:
        return "does not load"
    return "the same" if np.allclose(before, after, atol=1e-5) else f"other values, by up to {np.abs(before - after).max():.2f}"


seen = {
    "Softmax 11 to 13": converted(11, 13, "Softmax", {}, axis=1),
    "Hardmax 11 to 13": converted(11, 13, "Hardmax", {}, axis=1),
    "Resize, nearest, 10 to 11": converted(10, 11, "Resize", {"s": [1, 1, 2, 2]}, mode="nearest"),
    "Resize, linear, 10 to 11": converted(10, 11, "Resize", {"s": [1, 1, 2, 2]}, mode="linear"),
    "Upsample, linear, 9 to 11": converted(9, 11, "Upsample", {"s": [1, 1, 2, 2]}, mode="linear"),
    "GroupNormalization 18 to 21, 4 channels in 2 groups": converted(18, 21, "GroupNormalization", {"s": [1, 2], "b": [0, 1]}, num_groups=2),
    "GroupNormalization 18 to 21, 4 channels in 4 groups": converted(18, 21, "GroupNormalization", {"s": [1, 2, 3, 4], "b": [0, 1, 2, 3]}, num_groups=4),
}
for name, said in seen.items():
    print(f"onnx {onnx.__version__}, onnxruntime {onnxruntime.__version__}: {name}: {said}")
words = [said.split(",")[0] for said in seen.values()]
assert words == ["the same", "other values", "the same", "other values", "other values", "does not load", "the same"]
PYTHON
