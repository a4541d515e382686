"""How sure the surface is, and the laws that count from it, against presses of which both are known."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from foretouch.identification import Identification, Learner, identify, make_estimator
from foretouch.identification.offline import find_foot
from foretouch.models import advance
from foretouch.quantities import Recording

Array = NDArray[np.float64]
Law = tuple[float, float, float]

LAWS: dict[str, Law] = {"linear": (2000.0, 10.0, 1.0), "1.35": (4500.0, 27_000.0, 1.35), "1.5": (4500.0, 27_000.0, 1.5)}
NOISE = 0.05
OFFSET = 0.3
FAR = 1e-4  # Largest error of a surface [m]


def force_of(law: Law, depth: Array, velocity: Array) -> Array:
    stiffness, damping, exponent = law
    inside = np.maximum(depth, 0.0)
    return np.maximum(inside**exponent * (stiffness + damping * velocity), 0.0) * (depth > 0.0)


def press(
    law: Law,
    seed: int,
    *,
    noise: float = NOISE,
    speed: float = 1.0,
    surface: float | Array = 0.0,
    force: Callable[[Law, Array, Array], Array] = force_of,
    position: Array | None = None,
) -> Recording:
    """Twenty seconds of presses to some 8 mm, 3 mm out of contact between them, with noise of the force."""
    time = np.arange(20_000) * 1e-3
    t = speed * time
    away = 0.55 * (1 - np.cos(0.8 * np.pi * t)) + 0.25 * (1 - np.cos(1.8 * np.pi * t + 0.4)) - 0.2
    moved = -0.003 + 0.009 * np.maximum(away, 0.0) if position is None else position
    noises = np.random.default_rng(seed).normal(scale=noise, size=time.size)
    return Recording(time, moved, force(law, moved - surface, np.gradient(moved, time)) + noises + OFFSET)


def found(recording: Recording, model: str = "contact-map", estimator: str = "bank", **known: float) -> Identification:
    return identify(recording, Learner(make_estimator(model, estimator), **known))


def errors_of(result: Identification, law: Law) -> dict[str, float]:
    """Each parameter's error in its standard errors, that of the surface too."""
    true = dict(zip(("stiffness", "damping", "exponent", "switching"), (*law, 0.0), strict=True))
    errors = result.standard_errors_with_surface
    assert errors is not None
    values = {name: (value, errors[name]) for name, value in result.parameters.items()}
    return {"surface": abs(result.surface) / result.surface_error} | {
        name: abs(value - true[name]) / error
        for name, (value, error) in values.items()
        if value is not None and error is not None
    }


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))])
@pytest.mark.first
def test_the_true_surface_lies_within_two_standard_errors(law: Law, seed: int) -> None:
    result = found(press(law, seed))
    assert abs(result.surface) <= 2.0 * result.surface_error
    assert 0.0 < abs(result.surface) < FAR
    assert result.surface_error < FAR  # and not said of everything
    assert result.force_offset == pytest.approx(OFFSET, abs=5e-3)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(st.floats(1.0, 1.6), st.floats(0.0, 8.0), st.floats(0.01, 0.08), st.floats(0.7, 2.0), st.floats(-0.2, 0.2))
def test_a_foot_is_found_at_any_exponent_damping_noise_speed_and_place(
    exponent: float, damping: float, noise: float, speed: float, place: float
) -> None:
    law = (2.0 * 0.004**-exponent, damping * 2.0 * 0.004**-exponent, exponent)  # 2 N at 4 mm
    recording = press(law, 2, noise=noise, speed=speed)
    velocity = np.gradient(recording.position, recording.time)
    foot = find_foot(recording.position + place, velocity, recording.force, (place + 4e-4, 0.25), (False, False))
    assert foot is not None
    surface_error, offset_error = np.sqrt(np.diag(foot.covariance))
    assert abs(foot.surface - place) < 3.0 * surface_error < 3e-4
    assert abs(foot.offset - OFFSET) < 4.0 * offset_error < 0.015


@pytest.mark.parametrize(
    ("model", "estimator"),
    [
        ("hunt-crossley", "offline"),
        pytest.param("continuous-switching", "offline", marks=pytest.mark.long),
        ("hunt-crossley", "exact"),
    ],
)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.first
def test_a_law_and_its_surface_lie_within_two_standard_errors(model: str, estimator: str, seed: int) -> None:
    result = found(press(LAWS["1.35"], seed), model, estimator)
    assert max(errors_of(result, LAWS["1.35"]).values()) <= 2.0
    assert result.parameters["exponent"] == pytest.approx(1.35, abs=0.03)


@pytest.mark.long
@pytest.mark.parametrize("model", ["hunt-crossley", "continuous-switching"])
@pytest.mark.parametrize(("noise", "speed"), [(0.05, 1.0), (0.02, 1.0), (0.1, 1.0), (0.05, 0.5), (0.05, 2.0)])
def test_nineteen_of_twenty_laws_lie_within_two_standard_errors(model: str, noise: float, speed: float) -> None:
    results = [found(press(LAWS["1.35"], seed, noise=noise, speed=speed), model, "offline") for seed in range(100, 120)]
    errors = [errors_of(result, LAWS["1.35"]) for result in results]
    for name in errors[0]:
        assert sum(error[name] <= 2.0 for error in errors) >= 19, name
    assert np.mean([error["surface"] for error in errors]) > 0.2  # and no error is said to be larger than it is


def test_a_law_that_does_not_hold_deep_in_leaves_the_surface_where_it_is() -> None:
    """A material that bottoms out: the foot is fitted less deep."""

    def bottoms_out(law: Law, depth: Array, velocity: Array) -> Array:
        return force_of(law, depth, velocity) + 4e5 * np.maximum(depth - 0.004, 0.0) ** 2.0

    result = found(press(LAWS["1.35"], 0, force=bottoms_out))
    assert abs(result.surface) <= 2.0 * result.surface_error < 4e-4


def test_a_surface_that_differs_from_press_to_press_is_less_sure() -> None:
    one = press(LAWS["1.35"], 0)
    press_index = np.cumsum(np.diff(one.position > -0.002, prepend=False).astype(int)) // 2
    places = np.random.default_rng(0).normal(scale=3e-4, size=press_index.max() + 1)
    assert press_index.max() >= 5
    result = found(press(LAWS["1.35"], 0, surface=places[press_index]))
    assert result.surface_error > 3.0 * found(one).surface_error
    assert abs(result.surface - places.mean()) <= 3.0 * result.surface_error


@pytest.mark.long
def test_what_is_given_stays_and_has_no_error() -> None:
    recording, law = press(LAWS["1.35"], 0), LAWS["1.35"]
    both = found(recording, "hunt-crossley", "offline", surface=0.0, force_offset=OFFSET)
    assert (both.surface, both.surface_error, both.force_offset) == (0.0, 0.0, OFFSET)
    assert both.standard_errors_with_surface == both.standard_errors
    assert both.parameters["exponent"] == pytest.approx(1.35, abs=3e-3)
    place = found(recording, "hunt-crossley", "offline", surface=0.0)
    assert (place.surface, place.surface_error) == (0.0, 0.0)
    assert place.force_offset == pytest.approx(OFFSET, abs=5e-3)
    assert place.standard_errors is not None
    assert place.standard_errors_with_surface is not None
    assert place.standard_errors_with_surface["exponent"] > place.standard_errors["exponent"]
    offset = found(recording, "hunt-crossley", "offline", force_offset=OFFSET)
    assert offset.force_offset == OFFSET
    assert max(errors_of(offset, law).values()) <= 2.0


def test_a_recording_that_never_leaves_contact_does_not_tell() -> None:
    time = np.arange(10_000) * 1e-3
    position = 0.005 + 0.003 * np.sin(np.pi * time)
    result = found(Recording(time, position, 2000.0 * position + 0.01 * np.sin(700.0 * time)))
    assert math.isnan(result.surface_error)


def test_a_map_stays_where_it_is() -> None:
    """Its force at each place is that of the map learnt sample by sample, counted from elsewhere."""
    recording, learner = press(LAWS["1.35"], 0), Learner(make_estimator("contact-map", "bank"))
    result = identify(recording, learner)
    plain = Learner(make_estimator("contact-map", "bank"))
    plain.run(recording.time, recording.position, recording.force)
    learnt = plain.learnt()
    assert learnt.model is not None
    assert abs(learnt.surface - result.surface) > FAR
    assert learner.learnt().surface == result.surface
    for place in (-1e-3, 1e-3, 4e-3, 7e-3):
        before = advance(learnt.model, (), place - learnt.surface, 0.01, 1e-3)[1] + plain.conditioner.force_offset
        after = advance(result.model, (), place - result.surface, 0.01, 1e-3)[1] + result.force_offset
        assert after == pytest.approx(before, abs=0.03)  # the offset has changed by as much
