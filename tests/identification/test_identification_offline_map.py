"""The contact map fitted to a whole recording: what it leaves, and what must not matter to it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.identification import ContactSample, Learner, OfflineContactMap, Status, make_estimator, predict
from foretouch.identification import estimator as room
from foretouch.models import ContactMapModel, HuntCrossley, Predictor
from foretouch.quantities import Recording

RADIUS = 3e-4


def palpation(*, noise: float = 0.01) -> tuple[Recording, np.ndarray]:
    """Presses of a material that is none of the laws: a plateau that densifies, with hysteresis; and its true force."""
    time = np.arange(0.0, 8.0, 2e-3)
    t = np.maximum(time - 1.0, 0.0)
    depth = 0.008 * (np.sin(2 * np.pi * 0.8 * t) * (0.7 + 0.3 * np.sin(2 * np.pi * 0.31 * t)) - 0.05)
    play, force = depth[0], []
    for x in depth:
        play = min(max(play, x - RADIUS), x + RADIUS)
        elastic = 2.0 * math.tanh(max(x, 0.0) / 1e-3) + 4.0 * (max(x, 0.0) / 8e-3) ** 5
        force.append(max(0.0, elastic + 0.3 * math.tanh(max(x, 0.0) / 1e-3) * (x - play) / RADIUS))
    felt = np.array(force)
    noisy = felt + 0.3 + np.random.default_rng(0).normal(0.0, noise, time.size)
    return Recording(time, depth + 0.01, noisy), felt


def fitted(recording: Recording, estimator: OfflineContactMap, **options: float) -> Learner:
    learner = Learner(estimator, **options)
    for row in zip(recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), strict=True):
        learner.update(*row)
    estimator.finish()
    return learner


def force_of(recording: Recording, learner: Learner) -> np.ndarray:
    learnt, predictor = learner.learnt(), Predictor()
    predictor.adopt(learnt.model, learnt.surface)
    return np.array([predictor.update(*row) for row in zip(recording.time, recording.position, strict=True)])


def error(force: np.ndarray, true: np.ndarray) -> float:
    inside = true > 0.05
    return float(100.0 * np.sqrt(np.mean((force - true)[inside] ** 2) / np.mean(true[inside] ** 2)))


def test_it_fits_what_no_law_can_and_no_estimator_is_better() -> None:
    recording, true = palpation()
    floor = error(force_of(recording, fitted(recording, OfflineContactMap())), true)
    law = error(force_of(recording, fitted(recording, make_estimator("continuous-switching", "offline"))), true)
    late = error(predict(recording, Learner(make_estimator("contact-map", "bank")), delay=0.3).force, true)
    assert floor < 3.0
    assert law > 4.0 * floor
    assert late > floor


def test_a_law_is_found_as_that_law() -> None:
    recording, _ = palpation()
    law = HuntCrossley(3000.0, 300.0, 1.4)
    depth = recording.position - 0.01
    true = law.force(depth, np.gradient(depth, recording.time))
    noise = np.random.default_rng(1).normal(0.0, 0.02, true.size)
    learner = fitted(Recording(recording.time, recording.position, true + noise), OfflineContactMap(), surface=0.01)
    model = learner.estimator.model
    assert isinstance(model, ContactMapModel)
    assert model.shares[0] > 0.1
    assert model.exponent + model.switching == pytest.approx(1.4, abs=0.02)
    assert learner.estimator.standard_errors is not None
    assert learner.estimator.standard_errors.keys() == learner.estimator.parameters.keys()


def test_the_unit_of_force_does_not_matter() -> None:
    recording, _ = palpation()
    ten = Recording(recording.time, recording.position, 10.0 * recording.force)
    plain = force_of(recording, fitted(recording, OfflineContactMap(), contact_floor=0.05))
    larger = force_of(ten, fitted(ten, OfflineContactMap(), contact_floor=0.5))
    assert larger == pytest.approx(10.0 * plain, rel=1e-3, abs=1e-3)


def test_where_the_frame_begins_does_not_matter() -> None:
    recording, _ = palpation()
    moved = Recording(recording.time, recording.position - 0.25, recording.force - 3.0)
    plain = force_of(recording, fitted(recording, OfflineContactMap()))
    assert force_of(moved, fitted(moved, OfflineContactMap())) == pytest.approx(plain, abs=0.03)


def test_a_long_recording_is_fitted_on_fewer_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    recording, true = palpation()
    whole = error(force_of(recording, fitted(recording, OfflineContactMap())), true)
    monkeypatch.setattr(room, "LARGEST_BUFFER", 600)
    thinned = OfflineContactMap()
    learner = fitted(recording, thinned)
    assert len(thinned._rows) < 600
    assert error(force_of(recording, learner), true) == pytest.approx(whole, abs=1.0)


def test_nothing_is_known_before_there_is_contact_and_bad_numbers_change_nothing() -> None:
    estimator = OfflineContactMap()
    for index in range(100):
        assert estimator.update(ContactSample(0.01 * index, -1e-3, 0.0, 0.0, False)) is Status.FREE_AIR
    estimator.finish()
    assert estimator.model is None
    for bad in (math.nan, math.inf):
        assert estimator.update(ContactSample(2.0, 1e-3, bad, 1.0, True)) is Status.UNUSABLE
    assert estimator.updates == 0
    recording, _ = palpation()
    learner = fitted(recording, estimator, surface=0.01)
    before = learner.estimator.model
    assert before is not None
    estimator.reset()
    assert estimator.model is None
    assert estimator.standard_errors is None
