"""The heights of a surface that becomes known, and their way over the network."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import DecodeError
from foretouch.models import ShapeField
from foretouch.models.shape_field import CORNER, LENGTH, PITCH, SIDE, SPREAD, basis, packed_shape

NODE = st.integers(0, SIDE - 1)
ROWS, COLUMNS = np.divmod(np.arange(SIDE * SIDE), SIDE)


def test_the_weights_of_a_place_are_one_together_and_a_plane_stays_a_plane() -> None:
    along = np.linspace(0.0, LENGTH, 101)
    assert basis(along).sum(axis=1) == pytest.approx(1.0)
    shape = ShapeField()
    shape.coefficients[:] = 0.1 * PITCH * (np.arange(SIDE) - 1)[:, None]
    points = np.column_stack([CORNER[0] + along, np.full(101, 0.013)])
    assert shape.heights_at(points)[0] == pytest.approx(0.1 * along, abs=1e-12)


def test_nothing_is_known_at_first() -> None:
    heights, deviations = ShapeField().heights_at([(0.075, 0.0), (1.0, -3.0)])
    assert heights.tolist() == [0.0, 0.0]
    assert deviations == pytest.approx(SPREAD)


@given(st.lists(st.tuples(NODE, NODE, st.floats(-0.05, 0.05), st.floats(0.0, 0.01)), max_size=30))
def test_what_is_packed_comes_out_again(nodes: list) -> None:
    shape, told = ShapeField(), {(i, j): (value, deviation) for i, j, value, deviation in nodes}
    i, j = (np.array([node[axis] for node in told], np.int64) for axis in (0, 1))
    value, deviation = (np.array([known[part] for known in told.values()]) for part in (0, 1))
    shape.take(packed_shape(i, j, value, deviation))
    assert shape.count == len(told)
    assert shape.coefficients[i, j] == pytest.approx(value, abs=2e-5)
    assert shape.deviations[i, j] == pytest.approx(deviation, abs=5e-6)


@given(st.binary(max_size=60))
def test_what_is_no_shape_is_refused_and_changes_nothing(content: bytes) -> None:
    shape = ShapeField()
    with pytest.raises(DecodeError, match="no shape of a surface"):
        shape.take(content)
    assert not shape.count


@pytest.mark.parametrize(
    ("node", "why"),
    [
        ((SIDE, 0, 0.0, 0.0), "beyond the"),
        ((0, 0, 0.2, 0.0), "a height beyond"),
        ((0, 0, np.nan, 0.0), "a height beyond"),
        ((0, 0, 0.0, -1e-3), "deviation"),
        ((0, 0, 0.0, np.inf), "deviation"),
    ],
)
def test_numbers_that_mean_nothing_are_refused(node: tuple, why: str) -> None:
    shape = ShapeField()
    with pytest.raises(DecodeError, match=why):
        shape.take(packed_shape(*([part] for part in node)))
    with pytest.raises(DecodeError, match="bytes for"):
        shape.take(packed_shape(ROWS, COLUMNS, 0.0 * ROWS, 0.0 * ROWS)[:-1])
    assert not shape.count
