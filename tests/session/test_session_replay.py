"""A recorded session again: with sensors that failed and sides that began again, the session's own prediction."""

from __future__ import annotations

import numpy as np
import pytest
from lap import Lap

from foretouch.identification import Learner
from foretouch.messages import LeaderState, SessionLog
from foretouch.session import replay


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
    """What the replay of the longest segment predicts less what its leader did [N]."""
    log = lap.log()
    again = replay(log, Learner(lap.settings.make_estimator()), delay=lap.settings.force_delay)
    return again.predicted.force - log.longest().leader["predicted_force"]


def test_after_a_leader_began_again_all_that_the_follower_learnt_counts() -> None:
    lap = FollowerView()
    lap.start_leader("anna", 11)
    lap.run(4.0)
    lap.keep()
    lap.leaders.clear()
    lap.run(1.0)
    lap.start_leader("anna", 12)
    lap.run(4.5)
    assert lap.log().longest().leader["epoch"][0] == 12
    assert np.abs(own_error(lap)).max() == 0.0


def test_after_a_follower_began_again_its_own_learning_counts() -> None:
    lap = FollowerView()
    lap.start_leader("anna", 11)
    lap.run(4.0)
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
