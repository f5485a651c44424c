#!/bin/sh
# onnx-tool counts a transposed convolution as a convolution of its output: with a stride of 2, four times what it multiplies.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnx-tool==1.0.1 onnx==1.23.2 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import contextlib
import io
from importlib.metadata import version

import numpy as np
import onnx_tool
from onnx import TensorProto, helper, numpy_helper, shape_inference


def counted(kind, stride):
    """Multiplications that onnx-tool counts: 16 channels of 32 by 32 cells to 16, by a kernel of stride by stride and that stride."""
    weights = numpy_helper.from_array(np.zeros((16, 16, stride, stride), np.float32), "w")
    node = helper.make_node(kind, ["x", "w"], ["y"], kernel_shape=[stride, stride], strides=[stride, stride])
    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in (("x", [1, 16, 32, 32]), ("y", None))]
    model = helper.make_model(helper.make_graph([node], "a", ends[:1], ends[1:], [weights]), opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    with contextlib.redirect_stdout(io.StringIO()):
        graph = onnx_tool.Model(shape_inference.infer_shapes(model)).graph
        graph.shape_infer({"x": np.zeros((1, 16, 32, 32), np.float32)})
        graph.profile()
    return int(graph.macs[0])


seen, least = {}, {}
for stride in (1, 2, 4):
    # a convolution has each output cell once, a transposed one each input cell once, with 16 * 16 * stride * stride factors
    seen[stride] = counted("Conv", stride), counted("ConvTranspose", stride)
    least[stride] = (32 // stride) ** 2 * 256 * stride**2, 32**2 * 256 * stride**2
    print(f"onnx-tool {version('onnx-tool')}, stride {stride}: (Conv, ConvTranspose) {seen[stride]}, multiplied {least[stride]}")
assert all(seen[stride][0] == least[stride][0] and seen[stride][1] == least[stride][1] * stride**2 for stride in seen)
PYTHON
