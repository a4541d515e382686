"""How sure the surface is: of laws whose contact begins softly it is noticed too deep, and the error says so."""

from __future__ import annotations

import numpy as np
import pytest

from foretouch.identification import Learner, identify, make_estimator
from foretouch.identification.identify import unnoticed_depth
from foretouch.quantities import Recording

LAWS = {"linear": (2000.0, 10.0, 1.0), "1.35": (4500.0, 27_000.0, 1.35), "1.5": (20_000.0, 60_000.0, 1.5)}
NOISE = 0.05


def press(law: tuple[float, float, float], seed: int) -> Recording:
    """Ten seconds of presses to some 10 mm from a surface at 0, with noise of the force."""
    stiffness, damping, exponent = law
    time = np.arange(10_000) * 1e-3
    position = 0.0042 + 0.0048 * np.sin(np.pi * time - 1.5) + 0.0012 * np.sin(2.6 * np.pi * time)
    velocity = np.gradient(position, time)
    depth = np.maximum(position, 0.0)
    force = depth**exponent * (stiffness + (damping * velocity if exponent > 1.0 else 0.0))
    noise = np.random.default_rng(seed).normal(scale=NOISE, size=time.size)
    return Recording(time, position, np.maximum(force, 0.0) + noise)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_true_surface_lies_within_two_standard_errors(law: tuple[float, float, float]) -> None:
    for seed in range(4):
        result = identify(press(law, seed), Learner(make_estimator("contact-map", "bank")))
        assert result.surface > 0.0  # noticed too deep, always
        assert result.surface <= 2.0 * result.surface_error, seed
        assert result.surface_error < 1e-3, seed  # and not said of everything


def test_a_surface_that_is_given_has_no_error() -> None:
    result = identify(press(LAWS["1.35"], 0), Learner(make_estimator("contact-map", "bank"), surface=0.0))
    assert result.surface_error == 0.0


@pytest.mark.parametrize("name", [pytest.param("1.35", marks=pytest.mark.long), "1.5"])
def test_an_offline_law_lies_within_two_errors_that_hold_those_of_the_surface(name: str) -> None:
    """And not within five of those that take the surface, found too deep, for right."""
    result = identify(press(LAWS[name], 0), Learner(make_estimator("hunt-crossley", "offline")))
    given, alone, both = result.parameters, result.standard_errors, result.standard_errors_with_surface
    assert alone is not None
    assert both is not None
    for (key, value), true in zip(given.items(), LAWS[name], strict=True):
        assert value is not None
        assert abs(value - true) <= 2.0 * both[key], key
    assert abs(given["exponent"] - LAWS[name][2]) > 5.0 * alone["exponent"]


def test_errors_at_a_surface_that_is_given_are_those_of_the_law() -> None:
    result = identify(press(LAWS["1.35"], 0), Learner(make_estimator("hunt-crossley", "offline"), surface=0.0))
    assert result.standard_errors_with_surface == result.standard_errors
    assert result.parameters["exponent"] == pytest.approx(1.35, abs=0.01)


@pytest.mark.parametrize(("exponent", "ratio"), [(1.0, 3.0), (1.5, 1.5), (2.0, 1.0)])
def test_what_is_unnoticed_is_exact_at_the_exponent_two_and_more_than_enough_below(
    exponent: float, ratio: float
) -> None:
    offset, depth = 0.4e-3, np.linspace(-1e-3, 5e-3, 60_001)
    force = 3000.0 * np.maximum(depth + offset, 0.0) ** exponent
    threshold = 2.0 * 3000.0 * offset**exponent
    result = unnoticed_depth(depth, force, threshold)
    assert result >= offset * (0.9 if exponent == 2.0 else 1.0)
    assert result <= 1.1 * ratio * offset
    assert unnoticed_depth(depth[:10], force[:10], threshold) == 0.0
