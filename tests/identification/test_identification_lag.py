"""How late the force sensor is: estimated where contact can tell, and waited for where it is known."""

import math

import numpy as np
import pytest

from foretouch.errors import SettingError
from foretouch.identification import Conditioner, Learner, make_estimator
from foretouch.identification.conditioning.conditioner import SensorLag

STIFFNESS = 600.0
PERIOD = 1e-3


def feel(lag, damping=0.0, noise=0.0, duration=4.0):
    """A spring with a damper that is pressed to and fro, its force `lag` late."""
    estimate = SensorLag()
    random = np.random.default_rng(0)
    for index in range(round(duration / PERIOD)):
        now = index * PERIOD
        place, speed = 0.01 + 0.004 * math.sin(9.0 * now), 0.036 * math.cos(9.0 * now)
        late, late_speed = 0.01 + 0.004 * math.sin(9.0 * (now - lag)), 0.036 * math.cos(9.0 * (now - lag))
        force = STIFFNESS * late + damping * late_speed + random.normal(0.0, noise)
        estimate.update(place, speed, force, PERIOD)
    return estimate


@pytest.mark.parametrize("lag", [0.0, 0.001, 0.003, 0.01])
def test_on_a_spring_the_lag_itself_is_found(lag):
    result = feel(lag, noise=0.02)
    assert result.lag == pytest.approx(lag, abs=3e-4)
    assert result.standard_error < 1e-3


def test_damping_hides_it_and_no_lag_is_invented():
    assert feel(0.003, damping=10.0).lag == 0.0
    assert feel(0.003, damping=1.0).lag == pytest.approx(0.003 - 1.0 / STIFFNESS, abs=2e-4)


def test_nothing_is_said_before_there_was_motion_in_contact():
    assert SensorLag().lag is None
    assert SensorLag().standard_error is None
    still = SensorLag()
    for _ in range(1000):
        still.update(0.01, 0.0, 3.0, PERIOD)
    assert still.lag is None
    assert feel(0.003, duration=0.1).lag is None


def test_units_of_force_and_place_do_not_matter():
    one, far = SensorLag(), SensorLag()
    for index in range(3000):
        now = index * PERIOD
        place, speed = 0.004 * math.sin(9.0 * now), 0.036 * math.cos(9.0 * now)
        late = 0.004 * math.sin(9.0 * (now - 0.003))
        one.update(place, speed, STIFFNESS * late, PERIOD)
        far.update(place + 0.5, speed, 1e3 * STIFFNESS * late + 1e4, PERIOD)
    assert far.lag == pytest.approx(one.lag, rel=1e-6)


def test_positions_wait_for_a_force_that_is_known_to_be_late():
    conditioner = Conditioner(surface=0.0, force_offset=0.0, sensor_lag=0.0105)
    for index in range(100):
        now = index * PERIOD
        sample = conditioner.update(now, 0.2 * now, 1.0, 0.2)
    assert sample.depth == pytest.approx(0.2 * (now - 0.0105), abs=1e-12)
    assert sample.velocity == 0.2


def test_a_compensated_spring_has_no_lag_left():
    learner = Learner(make_estimator("contact-map", "bank"), surface=0.0, force_offset=0.0, sensor_lag=0.004)
    for index in range(3000):
        now = index * PERIOD
        late = 0.01 + 0.004 * math.sin(9.0 * (now - 0.004))
        learner.update(now, 0.01 + 0.004 * math.sin(9.0 * now), STIFFNESS * late)
    assert learner.lag.lag == pytest.approx(0.0, abs=5e-4)


@pytest.mark.parametrize("lag", [-0.001, 0.06, math.nan])
def test_a_lag_out_of_range_is_refused(lag):
    with pytest.raises(SettingError, match="sensor_lag"):
        Conditioner(sensor_lag=lag)


def presses(conditioner, onsets):
    """Free air, then a press that begins at each onset [m]; 20 N/mm once there."""
    time = 0.0
    for onset in onsets:
        for place in np.concatenate((np.linspace(0.0, 0.012, 400), np.linspace(0.012, 0.0, 400))):
            conditioner.update(time, float(place), 2e4 * max(float(place) - onset, 0.0))
            time += PERIOD
    return conditioner


def test_the_surface_carries_its_uncertainty():
    assert math.isnan(Conditioner().surface_error)
    assert Conditioner(surface=0.01).surface_error == 0.0
    same = presses(Conditioner(), [0.01] * 4)
    assert abs(same.surface - 0.01) < 2e-4
    assert 0.0 < same.surface_error < 1e-4
    apart = presses(Conditioner(), [0.010, 0.0104, 0.0097, 0.0102])
    assert apart.surface_error > 2.0 * same.surface_error
    assert abs(apart.surface - 0.01) < 3.0 * apart.surface_error
