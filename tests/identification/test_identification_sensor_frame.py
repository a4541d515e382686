"""The frame of a force sensor from static poses against known turns, and poses that touch something."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from foretouch.errors import InputError
from foretouch.identification import check_orientations, fit_sensor_frame, fit_tool_weight, outlying_poses
from foretouch.identification.calibration import check_torques

GRAVITY = 9.80665
BIAS, MASS = np.array([1.0, -2.0, 0.5]), 0.3


def directions(count: int, seed: int) -> np.ndarray:
    """Directions of gravity over the whole sphere, of which six are along the axes."""
    random = np.random.default_rng(seed)
    more = random.normal(size=(count - 6, 3))
    more /= np.linalg.norm(more, axis=1, keepdims=True)
    return np.vstack((np.eye(3), -np.eye(3), more))


def forces(d: np.ndarray, turn: Rotation, seed: int, noise: float = 0.03) -> np.ndarray:
    return BIAS + MASS * GRAVITY * turn.apply(d) + np.random.default_rng(seed).normal(0.0, noise, d.shape)


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.floats(0.0, 3.1))
def test_any_turn_comes_out_exactly_without_noise(axis: tuple, angle: float) -> None:
    length = np.linalg.norm(axis)
    turn = Rotation.from_rotvec(angle * np.array(axis) / length if length > 1e-3 else (angle, 0.0, 0.0))
    d = directions(12, 0)
    found = fit_sensor_frame(d, forces(d, turn, 0, 0.0))
    assert (Rotation.from_rotvec(found.turn) * turn.inv()).magnitude() < 1e-6


def test_the_truth_lies_within_two_standard_errors_as_often_as_it_should() -> None:
    turn = Rotation.from_rotvec((0.05, -0.1, 0.3))
    away = []
    for seed in range(200):
        d = directions(12, seed)
        found = fit_sensor_frame(d, forces(d, turn, seed + 1000))
        left = (Rotation.from_rotvec(found.turn) * turn.inv()).as_rotvec()
        away += [*(np.abs(left) / found.turn_error)]
    assert 0.92 < np.mean(np.array(away) < 2.0) < 0.98


def test_the_weight_that_is_left_in_other_poses_is_small() -> None:
    """In any of 50 poses that were not calibrated with, turned sensor and noise: below 0.1 N."""
    turn = Rotation.from_euler("xyz", (4.0, -7.0, 90.0), degrees=True)
    for seed in range(10):
        d = directions(12, seed)
        found = fit_sensor_frame(d, forces(d, turn, seed))
        weight = fit_tool_weight(Rotation.from_rotvec(found.turn).apply(d), forces(d, turn, seed))
        new = directions(56, seed + 500)[6:]
        left = forces(new, turn, 0, 0.0) - weight.force_bias
        left -= weight.mass * GRAVITY * Rotation.from_rotvec(found.turn).apply(new)
        assert np.linalg.norm(left, axis=1).max() < 0.1


def test_a_quarter_turn_is_said_by_its_axes_and_a_small_one_by_its_angle() -> None:
    d = directions(12, 1)
    quarter = Rotation.from_euler("z", 90.0, degrees=True)  # gravity along the given x shows along the sensor's y
    found = fit_sensor_frame(d, forces(d, quarter, 1))
    assert found.is_turned
    assert found.sentence.startswith("the sensor's x, y and z axes point along -y, x, z of")
    half = Rotation.from_euler("x", 180.0, degrees=True)
    assert "along x, -y, -z of" in fit_sensor_frame(d, forces(d, half, 1)).sentence
    small = fit_sensor_frame(d, forces(d, Rotation.from_euler("z", 6.0, degrees=True), 1))
    assert "turned by 6." in small.sentence or "turned by 5." in small.sentence
    assert not fit_sensor_frame(d, forces(d, Rotation.identity(), 4)).is_turned


def test_a_wrong_sign_is_found_and_said() -> None:
    d = directions(12, 2)
    true = forces(d, Rotation.identity(), 2)
    with pytest.raises(InputError, match="change the sign of forces and torques"):
        fit_sensor_frame(d, -true)
    with pytest.raises(InputError, match="the sign of one axis of the forces is wrong"):
        fit_sensor_frame(d, true * (1.0, 1.0, -1.0))
    with pytest.raises(InputError, match="two axes are exchanged"):
        fit_sensor_frame(d, true[:, [1, 0, 2]])


def test_poses_about_one_axis_leave_the_frame_open() -> None:
    angles = np.linspace(0.0, 5.0, 10)
    d = np.column_stack((np.zeros(10), np.sin(angles), np.cos(angles)))
    assert fit_sensor_frame(d, forces(d, Rotation.identity(), 0)) is None


def test_a_pose_that_touches_something_is_left_out_and_the_others_never() -> None:
    turn = Rotation.from_rotvec((0.0, 0.1, 0.2))
    wrong = 0
    for seed in range(20):
        d = directions(10, seed)
        clean = forces(d, turn, seed)
        wrong += bool(outlying_poses(d, clean))
        touched = clean.copy()
        touched[3] += (0.0, 0.6, 1.0)
        assert outlying_poses(d, touched) == [3]
    assert wrong == 0


def orientations(count: int, seed: int) -> np.ndarray:
    return Rotation.random(count, rng=np.random.default_rng(seed)).as_matrix()


@pytest.mark.parametrize("count", [6, 8, 12])
def test_right_orientations_pass_and_the_inverse_never(count: int) -> None:
    """Whatever the poses are; the sensor is turned, and the noise is that of a wrist's."""
    turn, wrong = Rotation.from_rotvec((0.3, -0.4, 1.2)), 0
    for seed in range(200):
        matrices = orientations(count, seed)
        shown = forces(-matrices[:, 2, :], turn, seed)  # gravity along -z of the base, in the flange's frame
        check_orientations(matrices, shown)
        try:
            check_orientations(matrices.transpose(0, 2, 1), shown)
        except InputError as error:
            wrong += "inverse" in str(error)
    assert wrong >= 195


def test_poses_about_one_axis_tell_no_other_frame() -> None:
    """The inverse of turns about x is a sensor turned by half about z: both explain the forces."""
    matrices = Rotation.from_euler("x", np.linspace(0.0, 5.0, 10)[:, None]).as_matrix()
    shown = forces(-matrices[:, 2, :], Rotation.identity(), 3)
    check_orientations(matrices.transpose(0, 2, 1), shown)


def test_torques_of_a_turned_sensor_and_of_a_centre_to_the_side_pass() -> None:
    for seed in range(200):
        d = directions(8, seed)
        shown = forces(d, Rotation.from_rotvec((0.3, -0.4, 1.2)), seed)
        noise = np.random.default_rng(seed).normal(0.0, 8e-4, d.shape)
        centre = np.random.default_rng(seed).uniform(-0.1, 0.1, 3)
        torque = 0.05 + np.cross(centre, shown - BIAS) + noise
        check_torques(shown, torque)
        with pytest.raises(InputError, match="no centre of mass explains"):
            check_torques(shown, torque[:, [1, 0, 2]])
