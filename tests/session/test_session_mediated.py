"""What mediation costs of a prediction on measured foam."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from foretouch.identification import Learner, make_estimator, predict
from foretouch.quantities import Recording
from foretouch.recordings import read_recording
from foretouch.report import score_prediction
from foretouch.session import mediate


def learner() -> Learner:
    return Learner(make_estimator("contact-map", "bank"))


@pytest.mark.parametrize("name", ["tue/b-foam3", "tue/e-foam2"])
def test_mediation_costs_a_point_at_most_where_no_bound_is_active(name: str, measured: Callable[[str], Path]) -> None:
    recording = read_recording(measured(name))
    found = mediate(recording, learner(), delay=0.3)
    assert np.abs(found.step).max() <= 0.1
    window = {"contact_floor": recording.contact_floor, "score_from": 1.5}
    plain = score_prediction(recording.time, recording.force, found.predicted, found.predicted, **window)
    free = ~found.bounded
    allowed = np.where(found.bounded, found.predicted, found.mediated)
    mediated = score_prediction(recording.time, recording.force, allowed, found.predicted, **window)
    assert free[plain.in_contact].mean() > 0.5
    assert mediated.prediction_error_percent < plain.prediction_error_percent + 1.0
    everywhere = score_prediction(recording.time, recording.force, found.mediated, found.predicted, **window)
    assert everywhere.prediction_error_percent < plain.prediction_error_percent + 2.0


def test_the_prediction_is_that_of_predict() -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    position = 0.01 * np.sin(2.0 * np.pi * 0.7 * time - 0.5)
    recording = Recording(time, position, 400.0 * np.maximum(position, 0.0))
    found = mediate(recording, learner(), delay=0.1, model_rate=1000.0)
    np.testing.assert_allclose(found.predicted, predict(recording, learner(), delay=0.1).force, atol=1e-9)
