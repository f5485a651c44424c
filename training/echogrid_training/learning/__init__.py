"""How a network learns and is exported: data set, networks, loss, loop, ONNX, quantisation, calibration."""
