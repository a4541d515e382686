"""How a force sensor stands on what carries it, and which static pose does not belong to the others."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares as refine
from scipy.spatial.transform import Rotation

from foretouch.errors import InputError
from foretouch.identification.force_calibration import LEAST_SPREAD, fit_tool_weight
from foretouch.quantities import ByValue

Array = NDArray[np.float64]

NAMED_WITHIN = math.radians(20.0)
"""A frame is said in quarter turns where it is as near to one [rad]; between two there are 45 degrees at least."""

SURE = 3.0  # Number of standard errors from which a turn is one

OUTLYING = 8.0
"""A pose is another's where the others leave it so many times their own residual. With six poses left, whose residuals
have 14 degrees of freedom, noise alone does so in fewer than one table in a thousand."""

LEFT_OUT = 0.25  # Largest share of poses that may be left out


@dataclass(frozen=True, eq=False)
class SensorFrame(ByValue):
    """A sensor's frame against the one in which gravity was given.

    Attributes:
        turn: Rotation vector that turns vectors of the given frame into the sensor's [rad], shape (3,).
        turn_error: Standard error [rad], shape (3,).
    """

    turn: Array
    turn_error: Array

    @property
    def is_turned(self) -> bool:
        """Whether it is turned by more than its uncertainty."""
        return bool((np.abs(self.turn) > SURE * self.turn_error).any())

    @property
    def sentence(self) -> str:
        """How its axes stand, where they stand in quarter turns; else by which angle it is turned."""
        ours = Rotation.from_rotvec(self.turn)
        angle = math.degrees(ours.magnitude())
        for quarters in _quarter_turns():
            if (ours * quarters.inv()).magnitude() < NAMED_WITHIN and quarters.magnitude() > NAMED_WITHIN:
                # A row of the matrix is an axis of the sensor in the given frame.
                names = [_axis_name(row) for row in quarters.as_matrix()]
                inwards = "; if that is the flange's, its z axis points into the arm" if names[2] == "-z" else ""
                axes = ", ".join(names)
                return (
                    f"the sensor's x, y and z axes point along {axes} of the frame in which gravity is given{inwards}"
                )
        return f"the sensor is turned by {angle:.1f} degrees against the frame in which gravity is given"


def _quarter_turns() -> list[Rotation]:
    """The 24 rotations that bring the axes onto axes."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.diag(signs) @ np.eye(3)[list(order)]
            if np.linalg.det(matrix) > 0.0:
                found.append(Rotation.from_matrix(matrix))
    return found


def _axis_name(row: Array) -> str:
    axis = int(np.argmax(np.abs(row)))
    return f"{'-' if row[axis] < 0.0 else ''}{'xyz'[axis]}"


def fit_sensor_frame(gravity_direction: ArrayLike, force: ArrayLike, *, gravity: float = 9.80665) -> SensorFrame | None:
    r"""The sensor's frame from static poses.

    .. math:: F_i = b + m\, g\, R\, d_i

    with d gravity's direction in a frame that turns with the sensor, such as the flange's, and R the rotation from it
    to the sensor's. A first solution is linear in b and m R, whose nearest rotation is that of its polar decomposition;
    nonlinear least squares refine it, all poses of equal weight. Standard errors: residual variance over 3 n - 7
    degrees of freedom, times the inverse of the normal matrix.

    Args:
        gravity_direction: d, of length 1, shape (n, 3).
        force: F, the load on the sensor [N], shape (n, 3).
        gravity: g [m/s^2], positive.

    Returns:
        None where gravity does not turn along all three axes, which leaves the frame open.

    Raises:
        InputError: The forces are the reaction, or the axes left-handed: no rotation explains them.
    """
    d, forces = np.asarray(gravity_direction, np.float64), np.asarray(force, np.float64)
    begin = _first(d, forces, gravity)
    if begin is None:
        return None
    first, bias, mass = begin

    def residual(unknown: Array) -> Array:
        turned = (Rotation.from_rotvec(unknown[4:]) * first).apply(d)
        return np.asarray((unknown[:3] + unknown[3] * gravity * turned - forces).ravel(), np.float64)

    found = refine(residual, np.concatenate((bias, [mass], np.zeros(3))), x_scale="jac")
    variance = 2.0 * found.cost / max(forces.size - 7, 1)
    slopes = np.asarray(found.jac, np.float64)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(slopes.T @ slopes)))
    turn = (Rotation.from_rotvec(found.x[4:]) * first).as_rotvec()
    return SensorFrame(np.asarray(turn, np.float64), np.asarray(errors[4:], np.float64))


def _first(d: Array, forces: Array, gravity: float) -> tuple[Rotation, Array, float] | None:
    """The linear solution: the rotation nearest to m R, the bias and the mean of its singular values; see above."""
    if np.linalg.svd(d - d.mean(axis=0), compute_uv=False)[-1] / math.sqrt(len(d)) < LEAST_SPREAD:
        return None
    design = np.column_stack((gravity * d, np.ones(len(d))))
    linear = np.asarray(np.linalg.lstsq(design, forces, rcond=None)[0], np.float64)
    carried = np.asarray(linear[:3].T, np.float64)
    if np.linalg.det(carried) < 0.0:
        raise InputError(_mirrored(-carried))
    left, sizes, right = np.linalg.svd(carried)
    return Rotation.from_matrix(left @ right), linear[3], float(sizes.mean())


def _mirrored(carried: Array) -> str:
    """What to do where only a mirror image explains the forces; the reverse of them is given [kg]."""
    left, _, right = np.linalg.svd(carried)
    if Rotation.from_matrix(left @ right).magnitude() < 0.25 * math.pi:
        return (
            "the forces point against gravity: they must be the load on the sensor; if yours are the reaction, change "
            "the sign of forces and torques"
        )
    return (
        "the axes of the forces are left-handed against those of gravity: the sign of one axis is wrong, or two axes "
        "are exchanged, or, if the sensor gives the reaction, all signs are"
    )


def outlying_poses(gravity_direction: ArrayLike, force: ArrayLike, torque: ArrayLike | None = None) -> list[int]:
    """Numbers of the poses that do not belong to the others, such as one in which the tool touched something.

    The worst is left out, and so on, as long as the others still determine weight and bias and leave its force or its
    torque 8 times their own residual or more; a quarter of the poses at most.

    Args:
        gravity_direction: Of length 1, shape (n, 3).
        force: Load on the sensor [N], shape (n, 3).
        torque: Load about its origin [N m], shape (n, 3), or None. A light touch at the end of a long tool shows there.
    """
    d, forces = np.asarray(gravity_direction, np.float64), np.asarray(force, np.float64)
    torques = None if torque is None else np.asarray(torque, np.float64)
    there, out = list(range(len(d))), list[int]()
    while len(out) < int(LEFT_OUT * len(d)):
        others = {one: [other for other in there if other != one] for one in there}
        ratios = {one: _left_by_others(d, forces, torques, others[one], one) for one in there}
        worst = max(ratios, key=lambda one: ratios[one])
        if ratios[worst] < OUTLYING:
            break
        there.remove(worst)
        out.append(worst)
    return sorted(out)


def _left_by_others(d: Array, forces: Array, torques: Array | None, others: list[int], one: int) -> float:
    """Residual of a pose over that of the others, by what they say; 0 where they do not say it."""
    try:
        begin = _first(d[others], forces[others], 9.80665)  # near enough, and quick: there is one for each pose
        turned = d if begin is None else begin[0].apply(d)
        weight = fit_tool_weight(turned[others], forces[others], None if torques is None else torques[others])
    except InputError:
        return 0.0
    pull = weight.mass * 9.80665 * turned[one]
    ratio = _over(forces[one] - weight.force_bias - pull, weight.force_residual, 7)
    if torques is None or weight.torque_bias is None or weight.torque_residual is None:
        return ratio
    away = torques[one] - weight.torque_bias - np.cross(np.asarray(weight.centre_of_mass), pull)
    return max(ratio, _over(away, weight.torque_residual, 6))


def _over(away: Array, residual: Array, unknowns: int) -> float:
    """Length of a pose's residual over the usual one of others, of which so many unknowns were fitted."""
    usual = math.sqrt(float(np.square(residual).sum()) / (residual.size - unknowns))
    return float(np.linalg.norm(away)) / max(math.sqrt(3.0) * usual, 1e-9)
