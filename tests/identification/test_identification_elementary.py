"""Logarithm and exponential against extended precision, and compiled against interpreted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.core.compiling import interpreted
from foretouch.identification.linear import recursion as elementary
from foretouch.identification.linear.recursion import exponential, logarithm

POSITIVE = st.floats(2.2250738585072014e-308, 1.7976931348623157e308)


def units_apart(found: np.ndarray, exact: np.ndarray) -> float:
    """Largest error in units in the last place."""
    return float(np.max(np.abs((found - exact) / np.spacing(np.abs(found)))))


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 60, reason="no extended precision to compare with")
def test_both_are_within_one_unit_in_the_last_place() -> None:
    random = np.random.default_rng(0)
    arguments = np.concatenate(
        [np.exp(random.uniform(-700.0, 700.0, 20_000)), random.uniform(0.5, 2.0, 20_000), 1.0 + 1e-9 * np.arange(1, 99)]
    )
    result = np.array([logarithm(x) for x in arguments.tolist()])
    assert units_apart(result, np.log(arguments.astype(np.longdouble))) < 1.0
    arguments = np.concatenate([random.uniform(-700.0, 700.0, 20_000), random.uniform(-1.0, 1.0, 20_000)])
    result = np.array([exponential(x) for x in arguments.tolist()])
    assert units_apart(result, np.exp(arguments.astype(np.longdouble))) < 1.0


def test_where_they_are_exact() -> None:
    assert logarithm(1.0) == 0.0
    assert exponential(0.0) == exponential(-0.0) == 1.0
    assert [logarithm(2.0**k) for k in range(-1022, 1024)] == pytest.approx(
        [k * math.log(2.0) for k in range(-1022, 1024)], rel=2e-16
    )
    assert exponential(1e9) == exponential(math.inf) == exponential(708.0) == pytest.approx(math.exp(708.0))
    assert exponential(-math.inf) == exponential(-708.0) == pytest.approx(math.exp(-708.0))


@given(POSITIVE, st.floats(allow_nan=False))
def test_interpreted_they_have_the_same_bits(x: float, y: float) -> None:
    assert interpreted(logarithm)(x) == logarithm(x)
    assert interpreted(exponential)(y) == exponential(y)


@given(st.floats(1e-300, 1e300))
def test_one_undoes_the_other(x: float) -> None:
    assert exponential(logarithm(x)) == pytest.approx(x, rel=3e-13)
    assert elementary.number_of(elementary.bits_of(x)) == x
