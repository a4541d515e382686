"""Bias, tool, lag and series stiffness against known truth: closed forms, coverage of the standard errors, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import InputError, RecordingError
from foretouch.identification import correct_recording, find_sensor_lag, fit_series_compliance, fit_tool_weight
from foretouch.quantities import Recording, SensorCalibration

GRAVITY = 9.80665
BIAS, TORQUE_BIAS = np.array([1.0, -2.0, 0.5]), np.array([0.03, 0.01, -0.02])
MASS, CENTRE = 0.4, np.array([0.004, -0.002, 0.05])
AXES = np.vstack((np.eye(3), -np.eye(3)))
STIFFNESS, LOST = 30e3, 10e-6


def wrenches(directions, seed=0, force_noise=0.02, torque_noise=5e-4):
    random = np.random.default_rng(seed)
    weight = MASS * GRAVITY * directions
    force = BIAS + weight + random.normal(0.0, force_noise, directions.shape)
    torque = TORQUE_BIAS + np.cross(CENTRE, weight) + random.normal(0.0, torque_noise, directions.shape)
    return force, torque


def test_without_noise_the_truth_comes_out():
    result = fit_tool_weight(AXES, *wrenches(AXES, 0, 0.0, 0.0))
    np.testing.assert_allclose(result.force_bias, BIAS, atol=1e-12)
    np.testing.assert_allclose(result.torque_bias, TORQUE_BIAS, atol=1e-12)
    np.testing.assert_allclose(result.centre_of_mass, CENTRE, atol=1e-12)
    assert result.mass == pytest.approx(MASS, abs=1e-12)
    assert result.mass_error < 1e-9
    assert result.poses == 6
    assert result.spread == pytest.approx([3**-0.5] * 3)


def test_standard_errors_are_those_of_the_closed_form():
    """Six poses along the axes: bias and mass are orthogonal, var b = s^2 / 6 and var m = s^2 / (6 g^2)."""
    result = fit_tool_weight(AXES, *wrenches(AXES, 3))
    variance = np.sum(result.force_residual**2) / (18 - 4)
    np.testing.assert_allclose(result.force_bias_error, np.sqrt(variance / 6.0))
    assert result.mass_error == pytest.approx(np.sqrt(variance / 6.0) / GRAVITY)
    # the moment h enters two components of every pose that is not along it: var h = s^2 / (4 g^2)
    variance = np.sum(result.torque_residual**2) / (18 - 6)
    moment_error = np.sqrt(variance / 4.0) / GRAVITY
    expected = np.hypot(moment_error, np.abs(result.centre_of_mass) * result.mass_error) / result.mass
    np.testing.assert_allclose(result.centre_of_mass_error, expected)


def test_the_truth_lies_within_three_standard_errors_as_often_as_it_should():
    """t with 14 and 12 degrees of freedom: within 3 in 99 %; within 1 in 66 %."""
    away = []
    for seed in range(200):
        result = fit_tool_weight(AXES, *wrenches(AXES, seed))
        away += [*(result.force_bias - BIAS) / result.force_bias_error, (result.mass - MASS) / result.mass_error]
        away += [*(result.torque_bias - TORQUE_BIAS) / result.torque_bias_error]
        away += [*(result.centre_of_mass - CENTRE) / result.centre_of_mass_error]
    away = np.abs(away)
    assert (away < 3.0).mean() > 0.98
    assert 0.6 < (away < 1.0).mean() < 0.72


@given(st.integers(0, 10_000), st.integers(6, 30))
def test_any_well_spread_poses_do(seed, count):
    random = np.random.default_rng(seed)
    directions = random.normal(size=(count, 3))
    directions = np.vstack((AXES, directions / np.linalg.norm(directions, axis=1, keepdims=True)))
    result = fit_tool_weight(directions, *wrenches(directions, seed))
    assert abs(result.mass - MASS) < 6.0 * result.mass_error
    assert np.all(np.abs(result.centre_of_mass - CENTRE) < 6.0 * result.centre_of_mass_error)


def test_without_torques_there_is_no_centre():
    result = fit_tool_weight(AXES, wrenches(AXES)[0])
    assert result.centre_of_mass is None
    assert result.torque_residual is None


def turned_about_x(count, widest):
    angles = np.linspace(-widest, widest, count)
    return np.column_stack((np.zeros(count), np.sin(angles), np.cos(angles)))


def test_poses_that_tell_nothing_are_refused_with_what_is_missing():
    narrow = turned_about_x(8, 0.5)
    with pytest.raises(InputError, match=r"hardly turns towards .*\(1\.00, 0\.00, 0\.00\).*add poses"):
        fit_tool_weight(narrow, *wrenches(narrow))
    one = np.tile([[0.0, 0.0, 1.0]], (8, 1))
    with pytest.raises(InputError, match="add poses"):
        fit_tool_weight(one, *wrenches(one))
    few = np.repeat(AXES[:5], 4, axis=0)
    with pytest.raises(InputError, match="5 poses that differ by more than 6 degrees: at least 6"):
        fit_tool_weight(few, *wrenches(few))


def test_a_half_circle_about_one_axis_is_enough():
    """Two directions of spread determine all: the third component of the bias follows from the mass."""
    wide = turned_about_x(8, 2.0)
    result = fit_tool_weight(wide, *wrenches(wide))
    assert result.spread[2] == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.abs(result.centre_of_mass - CENTRE) < 5.0 * result.centre_of_mass_error)


def test_bad_arrays_and_reactions_are_refused():
    force, torque = wrenches(AXES)
    with pytest.raises(InputError, match="change the sign"):
        fit_tool_weight(AXES, -force, -torque)
    with pytest.raises(InputError, match=r"force has shape \(5, 3\)"):
        fit_tool_weight(AXES, force[:5])
    force[2, 1] = np.nan
    with pytest.raises(InputError, match="force must be finite"):
        fit_tool_weight(AXES, force)


# --- series compliance and lag ----------------------------------------------------------------------------------------


def block(seed=0, noise=2e-6, force_noise=0.02, lag=0.0, offset=0.3, frequency=0.7, stiffness=STIFFNESS, lost=LOST):
    """Presses on a rigid block through a series spring with lost motion."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 6.0, 1e-3)
    wave = -np.cos(2.0 * np.pi * frequency * time)
    force = 12.0 * np.maximum(wave, 0.0)
    back = np.where(np.sin(2.0 * np.pi * frequency * time) > 0.0, -0.5, 0.5) * lost
    free = 5e-3 * np.minimum(wave, 0.0)
    position = 0.02 + free + np.where(force > 0.0, force / stiffness + back, 0.0)
    shown = np.interp(time - lag, time, force) + offset + random.normal(0.0, force_noise, time.size)
    return Recording(time, position + random.normal(0.0, noise, time.size), shown)


def test_series_stiffness_and_lost_motion_come_out():
    exact = fit_series_compliance(block(noise=0.0, force_noise=0.0))
    assert exact.stiffness == pytest.approx(STIFFNESS, rel=1e-3)
    assert exact.lost_motion == pytest.approx(LOST, rel=1e-2)
    assert exact.position == pytest.approx(0.02, abs=1e-6)
    assert exact.force_offset == pytest.approx(0.3, abs=1e-9)


def test_their_standard_errors_cover_the_truth():
    result = [fit_series_compliance(block(seed)) for seed in range(12)]
    away = np.abs([(one.stiffness - STIFFNESS) / one.stiffness_error for one in result])
    assert (away < 3.0).all()
    assert (away < 1.0).sum() >= 4
    lost = np.abs([(one.lost_motion - LOST) / one.lost_motion_error for one in result])
    assert (lost < 3.0).all()


def test_a_known_lag_is_not_taken_for_lost_motion():
    late = block(lag=3e-3, frequency=1.5)
    assert fit_series_compliance(late).lost_motion < LOST - 5e-6
    mended = fit_series_compliance(late, sensor_lag=3e-3)
    assert mended.lost_motion == pytest.approx(LOST, abs=2e-6)
    assert mended.stiffness == pytest.approx(STIFFNESS, rel=0.01)


def test_presses_that_tell_no_stiffness_are_refused():
    time = np.arange(0.0, 2.0, 1e-3)
    noise = np.random.default_rng(0).normal(0.0, 0.01, time.size)
    with pytest.raises(RecordingError, match="samples while loading above"):
        fit_series_compliance(Recording(time, 1e-3 * time, noise + 0.3))
    with pytest.raises(RecordingError, match="press harder, or more often"):
        fit_series_compliance(block(noise=5e-3))


@pytest.mark.parametrize("lag", [0.0, 1e-3, 3e-3])
def test_the_lag_is_found_from_presses_and_from_taps(lag):
    time = np.arange(0.0, 4.0, 1e-3)
    for speed, least in ((9.0, 0.0), (40.0, 0.85)):  # presses, and taps of some 25 ms

        def felt(now, speed=speed, least=least):
            return 600.0 * 0.01 * np.maximum(np.sin(speed * now) - least, 0.0)

        noise = np.random.default_rng(1).normal(0.0, 0.005, time.size)
        recording = Recording(time, 0.02 + 0.01 * np.sin(speed * time), felt(time - lag) + noise)
        result, error = find_sensor_lag(recording)
        assert result == pytest.approx(lag, abs=4e-4)
        assert error < 1e-3


def test_a_recording_without_contact_tells_no_lag():
    time = np.arange(0.0, 2.0, 1e-3)
    with pytest.raises(RecordingError, match=r"0\.00 s of motion in contact tell no lag"):
        find_sensor_lag(Recording(time, 0.01 * np.sin(time), np.zeros(time.size)))


def test_positions_are_corrected_by_the_force_over_the_series_stiffness():
    recording = block(lag=2e-3, noise=0.0, force_noise=0.0, lost=0.0)
    calibration = SensorCalibration(
        force_bias=(0.1, 0.2, -1.3), tool_mass=0.1, approach_gravity=10.0, sensor_lag=2e-3, series_stiffness=STIFFNESS
    )
    assert calibration.force_offset == pytest.approx(1.3 - 1.0)
    corrected = correct_recording(recording, calibration)
    wave = -np.cos(2.0 * np.pi * 0.7 * recording.time)
    expected = 0.02 + 5e-3 * np.minimum(wave, 0.0)  # the block does not give way
    np.testing.assert_allclose(corrected.position[:-2], expected[:-2], atol=3e-7)
    np.testing.assert_array_equal(corrected.force, recording.force)
    assert correct_recording(recording, SensorCalibration()) is recording
    alone = correct_recording(recording, SensorCalibration(series_stiffness=STIFFNESS))
    np.testing.assert_allclose(alone.position[:-2], expected[:-2], atol=4e-6)  # what changes in 2 ms
