"""Distinct whole numbers, which the map's arithmetic asks for often."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from echogrid import core
from echogrid.core.kernels.cells import once


@given(st.lists(st.integers(-50, 50), max_size=60), st.sampled_from([np.int64, np.int32, np.int8]))
def test_each_is_there_once_and_in_order(values: list[int], kind: type[np.signedinteger]) -> None:
    found = once(np.array(values, kind))
    assert found.tolist() == sorted(set(values))
    assert found.dtype == kind


def test_the_arithmetic_asks_numpy_for_no_hash_table() -> None:
    """np.unique without counts or inverse: what a loop pays for at every update."""
    bare = [
        f"{path.name}:{node.lineno}"
        for path in Path(core.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "np.unique" and not node.keywords
    ]
    assert bare == []
