"""Which network answers: the contract in an ONNX file, and the choice of file for this processor."""
