"""A status document as lines: nothing in it harms a terminal, and less than all of it is shown."""

from __future__ import annotations

import pytest
from tests.support.status import status

from echogrid.errors import EchogridError
from echogrid.watching.status_text import lines


def test_what_comes_moves_no_cursor() -> None:
    shown = lines(status("ok\x1b[2J", "radar \r\x07x: \x9b1m"), "car")
    assert shown[:2] == [[("car", "bold"), (" is ", ""), ("ok?[2J", "bold red")], [("  radar ??x: ?1m", "red")]]
    assert all(text.isprintable() for line in shown for text, _ in line)


def test_a_status_that_says_less_is_shown_and_what_is_none_is_one_sentence() -> None:
    assert lines({"state": "ok"}, "car")[1] == [("map       ", "dim"), ("- updates/s, epoch -", "")]
    with pytest.raises(EchogridError, match="^vehicle 'car': this version of echogrid cannot read the status: Expected `str`, got `int`"):
        lines({"state": 3}, "car")
