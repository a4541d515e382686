"""Offset, contact and surface, as the samples come."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from presses import press

from foretouch.identification import Conditioner, ContactSample
from foretouch.quantities import Recording


def run(recording: Recording, conditioner: Conditioner | None = None) -> tuple[Conditioner, list[ContactSample]]:
    conditioner = conditioner or Conditioner()
    samples = zip(recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), strict=True)
    return conditioner, [conditioner.update(*sample) for sample in samples]


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_offset_and_surface_are_found(noise: float) -> None:
    conditioner, samples = run(press(noise=noise))
    assert conditioner.force_offset == pytest.approx(0.3, abs=0.02)
    assert conditioner.surface == pytest.approx(0.01, abs=1.5e-3)
    before = [sample for sample in samples if sample.time < 0.99]
    assert sum(sample.in_contact for sample in before) <= 2
    assert any(sample.in_contact for sample in samples)


@pytest.mark.parametrize("every", [0.2, 0.3])
def test_gaps_between_samples_do_not_make_the_noise_small(every: float) -> None:
    """The few samples after a gap are alike by chance: what is as loud as ever is no contact."""
    time = np.arange(0.0, 20.0, 1e-3)
    time = time[time % every > 0.06]
    force = 0.02 * np.random.default_rng(0).standard_normal(time.size)
    _, samples = run(Recording(time, 1e-3 * time, force))
    assert not any(sample.in_contact for sample in samples if sample.time > 0.5)


def test_given_values_are_kept() -> None:
    conditioner, samples = run(press(), Conditioner(surface=0.009, force_offset=0.25))
    assert (conditioner.surface, conditioner.force_offset) == (0.009, 0.25)
    assert samples[0].depth == pytest.approx(press().position[0] - 0.009)


def test_a_jerk_below_zero_does_not_move_the_offset() -> None:
    """A tool that is jerked shows less than nothing for a moment; that is no free air."""
    recording = press(noise=0.02)
    force = recording.force.copy()
    force[500:540] += 3.0 * np.sin(np.linspace(0, 2 * np.pi, 40)) - 1.0
    conditioner, _ = run(Recording(recording.time, recording.position, force))
    assert conditioner.force_offset == pytest.approx(0.3, abs=0.03)


def test_friction_in_free_air_is_not_taken_for_the_surface_for_long() -> None:
    """A false first contact is forgotten once real forces have shown how small it was."""
    recording = press(duration=8.0)
    friction = np.where((recording.time > 0.3) & (recording.time < 0.4), 0.05, 0.0)
    conditioner, _ = run(
        Recording(recording.time, recording.position - 0.002 * (friction > 0), recording.force + friction)
    )
    assert conditioner.surface == pytest.approx(0.01, abs=2e-3)


def test_nothing_comes_from_the_future() -> None:
    recording = press(noise=0.02)
    _, whole = run(recording)
    cut = 3000
    force, position = recording.force.copy(), recording.position.copy()
    force[cut:] = -5.0
    position[cut:] = 0.5
    _, changed = run(Recording(recording.time, position, force))
    assert [*map(repr, changed[:cut])] == [*map(repr, whole[:cut])]


finite = st.floats(-1e3, 1e3)


@given(st.lists(st.tuples(st.floats(), st.floats()), min_size=1, max_size=60))
def test_no_sample_makes_it_raise_or_lose_its_numbers(samples: list[tuple[float, float]]) -> None:
    conditioner = Conditioner()
    for index, (position, force) in enumerate(samples):
        bounded = [max(-1e6, min(1e6, value)) if not math.isnan(value) else value for value in (position, force)]
        result = conditioner.update(index * 1e-3, *bounded)
        assert math.isfinite(result.velocity)
        assert math.isfinite(result.force)
        if result.in_contact:
            assert result.depth >= 0.0
    assert math.isfinite(conditioner.force_offset)


@given(st.floats(-20.0, 20.0), st.floats(-0.5, 0.5))
def test_a_shift_of_force_or_position_shifts_what_is_found(force_shift: float, position_shift: float) -> None:
    recording = press(duration=2.0)
    moved = Recording(recording.time, recording.position + position_shift, recording.force + force_shift)
    plain, shifted = run(recording)[0], run(moved)[0]
    assert shifted.force_offset == pytest.approx(plain.force_offset + force_shift, abs=1e-6)
    assert shifted.surface == pytest.approx(plain.surface + position_shift, abs=1e-5)
