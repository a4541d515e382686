"""A session over a material that pulls."""

from __future__ import annotations

import numpy as np
import pytest

from foretouch import SessionSettings, simulate
from foretouch.report import session_figures


@pytest.mark.long
def test_a_session_predicts_and_renders_what_pulls_and_takes_no_sensor_for_faulty() -> None:
    session = simulate(SessionSettings(material="adhesive", grip="normal", jitter=0.0), duration=12.0)
    figures = session_figures(session.log, score_from=4.0)
    leader, follower = session.log.leader, session.log.follower
    assert follower["exact_force"].min() < -0.9
    assert not figures["safety"]["statuses"]
    assert figures["prediction_error_percent"] < 10.0
    assert leader["predicted_force"].min() == pytest.approx(-1.0, abs=0.1)
    assert leader["rendered_force"].min() < -0.5
    assert figures["stable"]
    assert figures["hand"]["certificate_holds"]
    assert figures["hand"]["energy_agrees"]
    went_in = np.diff(leader["hand_position"], prepend=leader["hand_position"][0]) > 0.0
    drawn = went_in & (leader["rendered_force"] < -0.1)
    assert (leader["energy"][drawn] > 0.0).all()  # by what it has paid


def test_what_never_pulls_is_rendered_as_ever() -> None:
    leader = simulate(SessionSettings(material="foam-measured", grip="normal"), duration=6.0).log.leader
    assert leader["predicted_force"].min() == leader["rendered_force"].min() == 0.0
