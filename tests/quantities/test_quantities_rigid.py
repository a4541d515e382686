"""Plain-number poses against the array ones."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from foretouch.quantities import Pose
from foretouch.quantities.pose import RigidMotion, add, dot, norm, scaled, subtract

number = st.floats(-1.0, 1.0)
vector = st.tuples(number, number, number)
angle = st.sampled_from([1e-9, 1e-5, 9.9e-5, 1.1e-4, 0.1, 3.0])


@given(vector, vector, angle, vector)
def test_it_moves_points_as_a_pose_does(place: tuple, axis: tuple, size: float, point: tuple) -> None:
    length = norm(axis)
    turn = scaled(axis, size / length) if length > 1e-3 else (0.0, 0.0, 0.0)
    motion, pose = RigidMotion.from_numbers((*place, *turn)), Pose.from_rotation_vector(turn, place)
    np.testing.assert_allclose(motion.apply(point), pose.apply(point), atol=1e-14)
    np.testing.assert_allclose(motion.apply_back(point), pose.inverse().apply(point), atol=1e-14)
    np.testing.assert_allclose(motion.rotate_back(motion.rotate(point)), point, atol=1e-14)


@given(vector, vector)
def test_vectors_are_numpys(a: tuple, b: tuple) -> None:
    first, second = np.array(a), np.array(b)
    np.testing.assert_allclose(add(a, b), first + second)
    np.testing.assert_allclose(subtract(a, b), first - second)
    assert math.isclose(dot(a, b), float(first @ second), abs_tol=1e-15)
    assert math.isclose(norm(a), float(np.linalg.norm(first)), abs_tol=1e-15)
