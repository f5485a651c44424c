"""echogrid-training: drives for echogrid, generated or imported from public recordings, and what trains its network."""

import os

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read where onnxruntime is imported, as in echogrid.model.network
