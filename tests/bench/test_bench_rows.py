"""Rows: what is reached, and what JSON and table say of it."""

from __future__ import annotations

import json
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from foretouch.bench import Row, render_table
from foretouch.bench.timing import HEADS, cells, spread

FIGURES = st.floats(allow_nan=False, allow_infinity=False)


@given(FIGURES, st.none() | FIGURES, st.booleans())
def test_reached_says_on_which_side_the_figure_is(figure: float, reach: float | None, at_least: bool) -> None:
    row = Row("what", figure, "us", reach, at_least)
    if reach is None:
        assert row.reached is None
    else:
        assert row.reached is (figure >= reach if at_least else figure <= reach)
    assert msgspec.json.decode(msgspec.json.encode([row]), type=list[Row]) == [row], "as it crosses processes"
    assert json.loads(json.dumps(row.as_row(), allow_nan=False)) == {
        "what": "what",
        "figure": figure,
        "unit": "us",
        "reach": reach,
        "reached": row.reached,
    }


def test_what_is_no_number_reaches_nothing() -> None:
    assert Row("what", math.nan, "us", 1.0).reached is False
    assert Row("what", math.nan, "us", 1.0, at_least=True).reached is False


def test_a_row_of_rounds_has_their_spread() -> None:
    row = Row.of("what", spread([4.0, 1.0, 2.0, 3.0, 5.0]), "us", 3.0)
    assert (row.figure, row.quartiles, row.rounds, row.reached) == (3.0, (2.0, 4.0), 5, True)
    assert Row.of("what", spread([4.0]), "us").quartiles is None


def test_the_table_shows_every_row_and_ratios_first() -> None:
    rows = [Row("time of a call", 1.5, "us", 1.0), Row("ratio to a peer", 250.0, "x", 200.0, True, (240.0, 260.0), 7)]
    console = Console(width=140, record=True, file=None, quiet=True)
    with console.capture() as captured:
        console.quiet = False
        console.print(render_table({"call": rows}))
    text = captured.get()
    assert all(head in text for head in HEADS)
    assert text.index("ratio to a peer") < text.index("time of a call")
    assert cells(rows[1]) == ("ratio to a peer", "250", "240 to 260", "7", "x", "≥ 200", "yes")
    assert cells(rows[0]) == ("time of a call", "1.5", "", "1", "us", "≤ 1", "no")


@pytest.mark.parametrize(("value", "said"), [(0.01234, "0.0123"), (12345.6, "12,346"), (99.6, "99.6")])
def test_figures_are_said_shortly(value: float, said: str) -> None:
    assert cells(Row("what", value, "us"))[1] == said
