from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from foretouch.errors import SettingError
from foretouch.quantities import Pose, cross_matrix

numbers = st.floats(-0.9, 0.9, allow_subnormal=False)
twists = st.lists(numbers, min_size=6, max_size=6).map(np.array)


@given(twists)
def test_exp_is_the_exponential_of_the_matrix_and_log_undoes_it(twist: np.ndarray) -> None:
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = cross_matrix(twist[3:]), twist[:3]
    exact, pose = expm(generator), Pose.exp(twist)
    assert pose.rotation == pytest.approx(exact[:3, :3], abs=1e-9)
    assert pose.translation == pytest.approx(exact[:3, 3], abs=1e-9)
    assert pose.log() == pytest.approx(twist, abs=1e-7)


@given(twists, twists, twists)
def test_poses_are_a_group(first: np.ndarray, second: np.ndarray, third: np.ndarray) -> None:
    a, b, c = Pose.exp(first), Pose.exp(second), Pose.exp(third)
    point = np.array([0.1, -0.2, 0.3])
    assert ((a @ b) @ c).apply(point) == pytest.approx(a.apply(b.apply(c.apply(point))), abs=1e-9)
    assert (a @ a.inverse()).apply(point) == pytest.approx(point, abs=1e-9)


@pytest.mark.parametrize(
    ("rotation", "translation"),
    [(np.eye(3) * 1.1, np.zeros(3)), (np.diag([1.0, 1.0, -1.0]), np.zeros(3)), (np.eye(3), np.array([0, 0, np.nan]))],
)
def test_what_is_no_pose_is_refused(rotation: np.ndarray, translation: np.ndarray) -> None:
    with pytest.raises(SettingError):
        Pose(rotation, translation)
