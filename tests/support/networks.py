"""Networks small enough to work out by hand, as ONNX files with a contract: the paper's kind, and the folded one of bytes."""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper

from echogrid.core.evidence.history import Detections, Looks, Surroundings
from echogrid.core.evidence.history_raster import CHANNELS

PLANES = len(CHANNELS)
SHARES = (0.6, 0.35, 0.05)  # of the classes where a network learned, as its contract may tell them
# (3, 12): logits of free, unknown and occupied from each plane / 255. Much seen and nothing there is free; what was hit is occupied.
CLASSES = np.zeros((3, PLANES))
CLASSES[2, CHANNELS.index("count_15m")] = 20.0
CLASSES[0, CHANNELS.index("looks_15m")] = 4.0
BIAS = np.array((-1.0, 0.5, -1.0))  # what they are where no plane says anything: unknown


def paper(cells: int = 16, cell: float = 0.5, **change: Any) -> tuple[onnx.GraphProto, dict[str, Any]]:
    """log-odds = 3 x + 0.5: graph and contract."""
    ends = [
        helper.make_tensor_value_info("image", TensorProto.FLOAT, (1, 1, cells, cells)),
        helper.make_tensor_value_info("answer", TensorProto.FLOAT, (1, cells, cells)),
    ]
    nodes = [
        helper.make_node("Mul", ["image", "three"], ["tripled"]),
        helper.make_node("Add", ["tripled", "half"], ["sum"]),
        helper.make_node("Squeeze", ["sum", "axis"], ["answer"]),
    ]
    constants = [helper.make_tensor(name, TensorProto.FLOAT, [], [value]) for name, value in (("three", 3.0), ("half", 0.5))]
    constants.append(helper.make_tensor("axis", TensorProto.INT64, [1], [1]))
    image = (np.random.default_rng(1).uniform(size=(1, cells, cells)) < 0.1).astype(np.uint8)
    golden = held(image, 3.0 * (2.0 * image - 1.0) + 0.5)
    return helper.make_graph(nodes, "paper", ends[:1], ends[1:], constants), said(cells, cell, ["detections"], "log-odds", golden) | change


def default(cells: int = 16, cell: float = 0.5, **change: Any) -> tuple[onnx.GraphProto, dict[str, Any]]:
    """Class logits = CLASSES @ planes / 255 + BIAS, cell by cell: graph and contract."""
    half = cells // 2
    ends = [
        helper.make_tensor_value_info("image", TensorProto.UINT8, (1, 4 * PLANES, half, half)),
        helper.make_tensor_value_info("answer", TensorProto.FLOAT, (1, 12, half, half)),
    ]
    nodes = [
        helper.make_node("Cast", ["image"], ["numbers"], to=TensorProto.FLOAT),
        helper.make_node("Conv", ["numbers", "weights", "bias"], ["answer"], kernel_shape=[1, 1]),
    ]
    weights = np.zeros((12, 4 * PLANES, 1, 1), dtype=np.float32)
    for place in range(4):  # of a cell within its block of 2 x 2: each stays where it is
        weights[place::4, place::4, 0, 0] = CLASSES / 255
    constants = [onnx.numpy_helper.from_array(weights, "weights"), onnx.numpy_helper.from_array(np.repeat(BIAS, 4).astype("f4"), "bias")]
    image = np.random.default_rng(2).integers(0, 256, (PLANES, cells, cells)).astype(np.uint8)
    golden = held(image, logits(image))
    contract = said(cells, cell, list(CHANNELS), "class-logits", golden) | {"fusion": "looks", "calibration": {"offset": -0.25}}
    return helper.make_graph(nodes, "default", ends[:1], ends[1:], constants), contract | change


def logits(image: np.ndarray) -> np.ndarray:
    """(3, H, W) that the default network gives, without folding."""
    return np.tensordot(CLASSES, image / 255, axes=1) + BIAS[:, None, None]


def held(image: np.ndarray, answer: np.ndarray) -> dict[str, str]:
    """An image and the means of its answer's blocks of 8 x 8 cells, as a contract holds them."""
    planes, side = len(answer), answer.shape[1] // 8
    means = answer.reshape(planes, side, 8, side, 8).mean(axis=(2, 4)).astype("<f4")
    return {"image": base64.b64encode(zlib.compress(image.tobytes())).decode(), "coarse": base64.b64encode(means.tobytes()).decode()}


def said(cells: int, cell: float, channels: list[str], output: str, golden: dict[str, str]) -> dict[str, Any]:
    return {
        "version": 2,
        "cells": cells,
        "cell": cell,
        "channels": channels,
        "output": output,
        "precision": "float",
        "fusion": "sum",
        "calibration": {},
        "golden": [golden],
    }


def around(seed: int = 3) -> Surroundings:
    """Forty detections within 5 m of a car whose radar `front_left` alone is heard; the newest ten are of now."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-5, 5, (40, 2))
    past = Detections(points, np.zeros_like(points), rng.uniform(-20, 20, 40), np.zeros(40))
    newest = np.arange(40) >= 30
    looks = Looks.of([], [])
    now = past.taken(np.flatnonzero(newest))
    return Surroundings(now, past, np.where(newest, 0.0, 4.0), newest.astype(np.int64), looks, ["front_left"])


def write(path: Path, graph: onnx.GraphProto, contract: object) -> Path:
    """`contract`: what JSON is made of, text as it is, or None for a file without."""
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)])
    model.ir_version = 10
    if contract is not None:
        helper.set_model_props(model, {"echogrid": contract if isinstance(contract, str) else json.dumps(contract)})
    onnx.save(model, path)
    return path
