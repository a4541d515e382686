"""A recorded session again: with sensors that failed and sides that began again, the session's own prediction."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from lap import Lap

from foretouch.identification import Learner, make_estimator, predict
from foretouch.messages import LeaderState, SessionLog
from foretouch.quantities import Recording
from foretouch.recordings import read_recording
from foretouch.report import score_prediction
from foretouch.session import mediate, replay


class FollowerView(Lap):
    def __init__(self, **changes: object) -> None:
        super().__init__(**changes)
        self.records: list[LeaderState] = []

    def keep(self) -> None:
        for one in self.leaders:
            self.records += one.records
            one.records = []

    def log(self) -> SessionLog:
        self.keep()
        return SessionLog.from_messages([*self.records, *self.telemetry], self.settings.as_text())


def own_error(lap: FollowerView) -> np.ndarray:
    log = lap.log()
    again = replay(log, Learner(lap.settings.make_estimator()), delay=lap.settings.force_delay)
    return again.predicted.force - log.longest().leader["predicted_force"]


@pytest.mark.long
def test_after_a_leader_began_again_all_that_the_follower_learnt_counts() -> None:
    lap = FollowerView.led(4.0)
    lap.keep()
    lap.leaders.clear()
    lap.run(1.0)
    lap.start_leader("anna", 12)
    lap.run(4.5)
    assert lap.log().longest().leader["epoch"][0] == 12
    assert np.abs(own_error(lap)).max() == 0.0


@pytest.mark.long
def test_after_a_follower_began_again_its_own_learning_counts() -> None:
    lap = FollowerView.led(4.0)
    lap.run(0.7, follows=False)
    lap.start_follower(2, robot=True)
    lap.run(10.0)
    assert lap.log().longest().follower["run"][0] == 2
    assert not lap.leaders[0].state.inherits
    error = np.abs(own_error(lap))
    # Before, the leader still had the model of the process that was gone; what that had told it of the delay lingers.
    assert error[-3000:].max() < 1e-3


@pytest.mark.parametrize(
    "kind", ["nan", "stuck", *(pytest.param(kind, marks=pytest.mark.long) for kind in ("spikes", "dropout"))]
)
@pytest.mark.first
def test_what_a_failing_sensor_showed_is_not_learnt(kind: str) -> None:
    from foretouch.robot import FaultySensor, SensorFault

    lap = FollowerView()
    lap.robot = FaultySensor(lap.robot, SensorFault(kind, 3.0, 4.0), seed=1)
    lap.start_leader("anna", 11)
    lap.run(4.2)
    lap.release = True
    lap.run(1.5)
    assert lap.log().follower["validity"].any()
    assert np.abs(own_error(lap)).max() == 0.0


# --- what mediation costs of a prediction on measured foam ------------------------------------------------------------


def learner() -> Learner:
    return Learner(make_estimator("contact-map", "bank"))


@pytest.mark.parametrize("name", ["tue/b-foam3", "tue/e-foam2"])
@pytest.mark.first
def test_mediation_costs_a_point_at_most_where_no_bound_is_active(name: str, measured: Callable[[str], Path]) -> None:
    recording = read_recording(measured(name))
    result = mediate(recording, learner(), delay=0.3)
    assert np.abs(result.step).max() <= 0.1
    window = {"contact_floor": recording.contact_floor, "score_from": 1.5}
    plain = score_prediction(recording.time, recording.force, result.predicted, result.predicted, **window)
    free = ~result.bounded
    allowed = np.where(result.bounded, result.predicted, result.mediated)
    mediated = score_prediction(recording.time, recording.force, allowed, result.predicted, **window)
    assert free[plain.in_contact].mean() > 0.5
    assert mediated.prediction_error_percent < plain.prediction_error_percent + 1.0
    everywhere = score_prediction(recording.time, recording.force, result.mediated, result.predicted, **window)
    assert everywhere.prediction_error_percent < plain.prediction_error_percent + 2.0


def test_the_prediction_is_that_of_predict() -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    position = 0.01 * np.sin(2.0 * np.pi * 0.7 * time - 0.5)
    recording = Recording(time, position, 400.0 * np.maximum(position, 0.0))
    result = mediate(recording, learner(), delay=0.1, model_rate=1000.0)
    np.testing.assert_allclose(result.predicted, predict(recording, learner(), delay=0.1).force, atol=1e-9)
