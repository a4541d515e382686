"""The simulated recordings: what they promise, and their truth."""

from __future__ import annotations

import numpy as np
import pytest

from foretouch.comparison import SIMULATED, simulate
from foretouch.comparison.cases import CHANGES, ENCODER_STEP, FORCE_NOISE
from foretouch.errors import UnknownNameError
from foretouch.models import KelvinVoigt

IN_SHORT = "continuous-switching", "sudden-change", "foam"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in IN_SHORT else pytest.mark.long) for name in SIMULATED]
)
def test_a_simulated_recording_keeps_its_promises(name: str) -> None:
    made = simulate(name)
    recording, truth = made.recording, made.truth
    assert np.diff(recording.time) == pytest.approx(1e-3)
    assert recording.velocity is None
    steps = recording.position / ENCODER_STEP
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    noise = recording.force - truth.force
    offset = float(noise.mean())
    assert 1e-3 < abs(offset) < 0.6
    assert float(noise.std()) == pytest.approx(FORCE_NOISE, rel=0.05)
    surface = float(np.median(recording.position - truth.depth))
    assert np.abs(recording.position - surface - truth.depth).max() <= ENCODER_STEP
    air = recording.time < 1.0
    assert (truth.depth[air] < 0.0).all()
    assert (truth.force[air] == 0.0).all()
    later = recording.time > 3.0
    assert float((truth.force[later] > 0.05).mean()) > 0.2
    assert 1.0 < truth.force.max() < 100.0
    assert np.abs(np.diff(truth.depth)).max() < 0.1e-3  # slower than 0.1 m/s


def test_the_same_name_and_seed_give_the_same_samples() -> None:
    first, again, other = simulate("tapping"), simulate("tapping"), simulate("tapping", seed=1)
    assert np.array_equal(first.recording.force, again.recording.force)
    assert not np.array_equal(first.recording.force, other.recording.force)


def test_surface_and_offset_differ_between_recordings() -> None:
    surfaces = {
        round(float(np.median(made.recording.position - made.truth.depth)), 4)
        for made in map(simulate, ("kelvin-voigt", "hunt-crossley", "tapping"))
    }
    assert len(surfaces) == 3


def test_the_truth_of_a_law_alone_is_that_law() -> None:
    truth = simulate("kelvin-voigt").truth
    assert isinstance(truth.law, KelvinVoigt)
    velocity = np.gradient(truth.depth, 1e-3)
    assert truth.force == pytest.approx(truth.law.force(truth.depth, velocity), abs=1e-9)


def test_the_sudden_changes_are_in_contact_and_are_felt() -> None:
    made = simulate("sudden-change")
    assert made.truth.changes == tuple(1.0 + change for change in CHANGES)
    for change in made.truth.changes:
        at = int(np.searchsorted(made.recording.time, change - 1e-9))
        assert made.truth.depth[at] > 0.002
        assert made.truth.force[at] > 1.3 * made.truth.force[at - 1]


def test_the_gradual_change_ends_as_kelvin_voigt() -> None:
    law = simulate("gradual-change").truth.law
    assert law is not None
    assert law.general_form == pytest.approx((6000.0, 500.0, 0.0, 1.0), abs=0.2)


def test_taps_leave_contact_again_and_again() -> None:
    inside = simulate("tapping").truth.depth > 0.0
    assert 15 < int(np.count_nonzero(np.diff(inside.astype(int)) > 0)) < 30


def test_materials_are_none_of_the_laws() -> None:
    assert simulate("sponge").truth.law is None


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="tapping"):
        simulate("jelly")
