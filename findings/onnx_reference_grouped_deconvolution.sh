#!/bin/sh
# onnx's reference evaluator raises at a ConvTranspose in groups, and at a bilinear GridSample as opset 16 to 19 have it.
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
from onnx import TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

onnxruntime.set_default_logger_severity(4)
random = np.random.default_rng(1)
grid = random.normal(size=(1, 4, 5, 6)).astype(np.float32)


def both(kind, constant, opset, **attributes):
    """What onnxruntime and the reference evaluator say of one node: the shape and whether they agree, or what was raised."""
    node = helper.make_node(kind, ["x", "w"], ["y"], **attributes)
    values = [helper.make_tensor_value_info("x", TensorProto.FLOAT, grid.shape), helper.make_tensor_value_info("y", TensorProto.FLOAT, list("nchw"))]
    graph = helper.make_graph([node], "a", values[:1], values[1:], [numpy_helper.from_array(constant.astype(np.float32), "w")])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    runtime = onnxruntime.InferenceSession(model.SerializeToString()).run(None, {"x": grid})[0]
    try:
        return runtime.shape, bool(np.allclose(runtime, ReferenceEvaluator(model).run(None, {"x": grid})[0], atol=1e-4))
    except (ValueError, RuntimeError) as error:
        return runtime.shape, f"{type(error).__name__}: {error}"


places = random.uniform(-1, 1, (1, 3, 3, 2))
seen = {
    "ConvTranspose, 1 group of 2": both("ConvTranspose", random.normal(size=(4, 2, 2, 2)), 17, group=1),
    "ConvTranspose, 2 groups of 1": both("ConvTranspose", random.normal(size=(4, 1, 2, 2)), 17, group=2),
    "ConvTranspose, 2 groups of 2": both("ConvTranspose", random.normal(size=(4, 2, 2, 2)), 17, group=2),
    "GridSample of opset 20, linear": both("GridSample", places, 20, mode="linear"),
    "GridSample of opset 16, bilinear": both("GridSample", places, 16, mode="bilinear"),
}
for name, (shape, found) in seen.items():
    print(f"{name}: onnxruntime {version('onnxruntime')} {shape}; the reference evaluator of onnx {version('onnx')}: {found if found is not True else 'the same'}")
assert [found is True for _, found in seen.values()] == [True, False, False, True, False]
assert seen["ConvTranspose, 2 groups of 1"][1].startswith("ValueError: cannot reshape")
assert seen["ConvTranspose, 2 groups of 2"][1].startswith("ValueError: could not broadcast")
assert seen["GridSample of opset 16, bilinear"][1].startswith("RuntimeError: GridSample interpolation only supports")
PYTHON
