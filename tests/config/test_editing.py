"""Values change, all else stays; what the text then says is what was meant."""

from __future__ import annotations

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from echogrid.config.editing import edited, written

TEXT = """# a car
vehicle = "test"  # ours

[[radar]]
name = "one"
yaw_deg = 45.0 # measured

# the other
[[radar]]
name = "#two"
yaw_deg = -45.0

[detections]
azimuth = { signal = "Azimuth_{k}", unit = "rad" }
range = { signal = "R", unit = "m", sign = 1 }
"""


def test_comments_stay_and_values_change() -> None:
    text = edited(
        TEXT, {("radar", 0, "yaw_deg"): 48.5, ("radar", 1, "id_offset"): 16, ("vehicle",): "other", ("motion", "wheel_scale"): 0.98}
    )
    assert text.splitlines()[:6] == ["# a car", 'vehicle = "other"  # ours', "", "[[radar]]", 'name = "one"', "yaw_deg = 48.5 # measured"]
    told = tomllib.loads(text)
    assert told["radar"] == [{"name": "one", "yaw_deg": 48.5}, {"name": "#two", "yaw_deg": -45.0, "id_offset": 16}]
    assert told["motion"] == {"wheel_scale": 0.98}
    assert "# the other" in text


def test_inside_inline_tables() -> None:
    text = edited(
        TEXT, {("detections", "azimuth", "sign"): -1, ("detections", "range", "sign"): -1, ("detections", "azimuth", "unit"): "deg"}
    )
    assert tomllib.loads(text)["detections"] == {
        "azimuth": {"signal": "Azimuth_{k}", "unit": "deg", "sign": -1},
        "range": {"signal": "R", "unit": "m", "sign": -1},
    }
    assert "# measured" in text


def test_what_lines_cannot_do_is_written_anew() -> None:
    """Tables that are written in another way give the right document all the same."""
    text = 'radar = [{ name = "one", yaw_deg = 1.0 }, { name = "two", yaw_deg = 2.0 }]\n[motion]\nbus = "b"\n'
    told = tomllib.loads(edited(text, {("radar", 1, "yaw_deg"): 7.0}))
    assert told == {"radar": [{"name": "one", "yaw_deg": 1.0}, {"name": "two", "yaw_deg": 7.0}], "motion": {"bus": "b"}}
    text = '[detections.azimuth]\nsignal = "A"\n'
    assert tomllib.loads(edited(text, {("detections", "azimuth", "sign"): -1})) == {"detections": {"azimuth": {"signal": "A", "sign": -1}}}


VALUES = st.one_of(st.booleans(), st.integers(-(2**40), 2**40), st.floats(allow_nan=False, allow_infinity=False), st.text(max_size=12))


@given(st.dictionaries(st.sampled_from("abcdef"), VALUES, max_size=4), st.dictionaries(st.sampled_from("xyz"), VALUES, max_size=3))
def test_what_is_written_is_read_back(table: dict[str, object], inner: dict[str, object]) -> None:
    document = {"plain": 1, "table": {**table, "inner": inner}, "list": [table or {"a": 1}, {"b": [1, 2]}]}
    assert tomllib.loads(written(document)) == document
