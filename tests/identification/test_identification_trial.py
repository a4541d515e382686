"""A recording that is predicted by compiled code alone: the bits of `predict`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from foretouch.identification import ContactMap, Learner, predict
from foretouch.identification.contact_map import trial
from foretouch.recordings import read_recording

SPRING = Path(__file__).parents[2] / "docs" / "examples" / "spring.csv"


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.3])
@pytest.mark.long
def test_a_trial_gives_the_bits_of_a_prediction(delay: float) -> None:
    recording = read_recording(SPRING)
    learner = Learner(ContactMap(), contact_floor=recording.contact_floor)
    (conditioning, _), bank = learner.conditioner.memory, learner.estimator.states  # type: ignore[attr-defined]
    record, learnt, forces = trial.make_trial(conditioning, bank)[0], 0, []
    trial.expect(record, delay)
    rows = list(zip(recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), strict=True))
    for now, position, _ in rows:
        while learnt < len(rows) and rows[learnt][0] + delay <= now + 1e-7:
            trial.learn.entry(record, *rows[learnt])
            learnt += 1
        forces.append(trial.foretell.entry(record, now, position))
    expected = predict(recording, delay=delay).force
    assert np.array(forces).tobytes() == expected.tobytes()
    assert expected.max() > 10.0
