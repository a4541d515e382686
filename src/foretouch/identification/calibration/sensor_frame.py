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
from foretouch.quantities import FLANGE, ByValue

Array = NDArray[np.float64]

NAMED_WITHIN = math.radians(20.0)
"""A frame is said in quarter turns where it is as near to one [rad]; between two there are 45 degrees at least."""

SURE = 3.0  # Number of standard errors from which a turn is one

OUTLYING = 8.0
"""A pose is another's where the others leave it so many times their own residual. With six poses left, whose residuals
have 14 degrees of freedom, noise alone does so in fewer than one table in a thousand."""

GIVEN = f"the {FLANGE}, in whose frame gravity is given"  # The one of the two frames that is known

CLEARLY = 4.0
"""Ratio of residuals from which another frame is said to be the right one. Noise of 0.06 N on six poses of a tool of
0.1 kg gave it to a wrong one in none of 10,000 tables, and on five poses in 7."""

FEWEST = 6  # Poses from which frames are told apart by what they leave

UNEXPLAINED = 0.05
"""Least residual, as a share of what is to be explained, at which another frame is looked for: noise of 0.03 N is that
much of what turns with a tool of 0.1 kg."""

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
                inwards = ": its z axis points into the arm" if names[2] == "-z" else ""
                return f"the sensor's x, y and z axes point along {', '.join(names)} of {GIVEN}{inwards}"
        return f"the sensor is turned by {angle:.1f} degrees against {GIVEN}"


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
            "the sensor's forces point against gravity: they must be the load on the sensor; if yours are the "
            "reaction, change the sign of forces and torques; if z of the base points down, turn the orientations"
        )
    return (
        "the sensor's axes are left-handed against the flange's: the sign of one axis of the forces is wrong, or two "
        "axes are exchanged, or, if the sensor gives the reaction, all signs are"
    )


def check_orientations(orientation: ArrayLike, force: ArrayLike) -> None:
    r"""Refuse orientations that are not those of the flange in a base whose z axis points up.

    However a sensor is turned, its forces are linear in the direction of gravity in the flange's frame,
    :math:`F_i = b + A\, T_i^T u`, with u along z. Where that leaves much, and the inverse of the orientations or
    another axis u leaves clearly less, it is said. Poses that all turn about one axis cannot tell them apart.

    Args:
        orientation: T, which turns vectors of the flange into the base's frame, shape (n, 3, 3).
        force: F [N], shape (n, 3).

    Raises:
        InputError: Another frame explains the forces, and this one does not.
    """
    turns, forces = np.asarray(orientation, np.float64), np.asarray(force, np.float64)
    if len(forces) < FEWEST:
        return
    left = {
        (inverse, axis): _left(turns[:, :, axis] if inverse else turns[:, axis, :], forces)
        for inverse in (False, True)
        for axis in range(3)
    }
    given, (inverse, axis) = left[False, 2], min(left, key=lambda one: left[one])
    if given < UNEXPLAINED * _spread(forces) or given < CLEARLY * left[inverse, axis]:
        return
    known, turned = "the forces do not belong to these orientations of the flange in the base", "vectors of the flange"
    if axis == 2:
        raise InputError(f"{known}, but to their inverse: give what turns {turned} into the frame of the base")
    raise InputError(f"{known}: gravity pulls along its {'xyz'[axis]} axis; give them in a base whose z axis points up")


def check_torques(force: ArrayLike, torque: ArrayLike) -> None:
    r"""Refuse torques whose axes are not those of the forces.

    About its origin a sensor shows :math:`T_i = b + S F_i` with a skew S, the cross product with the centre of mass.
    Where that leaves much, and any S clearly less, the torques have other axes or signs.

    Args:
        force: F [N], shape (n, 3).
        torque: T [N m], shape (n, 3).

    Raises:
        InputError: No centre of mass explains the torques, and other axes would.
    """
    forces, torques = np.asarray(force, np.float64), np.asarray(torque, np.float64)
    if len(forces) < FEWEST:
        return
    skew = np.zeros((len(forces), 3, 6))  # T = b - F x c, by the three numbers of c and of b
    for axis in range(3):
        skew[:, :, axis] = -np.cross(forces, np.eye(3)[axis])
    skew[:, :, 3:] = np.eye(3)
    design, values = skew.reshape(-1, 6), torques.ravel()
    rest = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    given, free = math.sqrt(float(np.square(rest).sum()) / (values.size - 6)), _left(forces, torques)
    if given > UNEXPLAINED * _spread(torques) and given > CLEARLY * free:
        raise InputError(
            "no centre of mass explains the torques: their axes are not the sensor's, in which the forces are; the "
            "sign of one is wrong, or two are exchanged"
        )


def _left(inputs: Array, outputs: Array) -> float:
    """Standard deviation of what an affine map from the inputs leaves of the outputs; both of shape (n, 3)."""
    design = np.column_stack((inputs, np.ones(len(inputs))))
    rest = outputs - design @ np.linalg.lstsq(design, outputs, rcond=None)[0]
    return math.sqrt(float(np.square(rest).sum()) / (rest.size - 12))


def _spread(values: Array) -> float:
    """Standard deviation about the mean of each axis, over all of them."""
    return math.sqrt(float(np.square(values - values.mean(axis=0)).mean()))


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
