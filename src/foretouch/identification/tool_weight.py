"""Bias of a force sensor, mass and centre of mass of the tool beyond it, from static poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import InputError, plural
from foretouch.quantities import ByValue

__all__ = ["FEWEST_POSES", "LEAST_SPREAD", "ToolWeight", "fit_tool_weight"]

FEWEST_POSES = 6
"""At least so many orientations, which differ by more than `SAME_POSE`."""

SAME_POSE = 0.1
"""Gravity directions nearer to each other than this [rad] are of the same pose."""

LEAST_SPREAD = 0.2
"""Standard deviation of the gravity direction along the second of its principal axes, at least: a rotation about one
axis by +-17 degrees has this spread along one axis only."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ToolWeight(ByValue):
    """What static poses tell. Arrays of three are in the sensor's frame.

    Attributes:
        force_bias: [N], shape (3,).
        force_bias_error: Standard error [N], shape (3,).
        mass: [kg].
        mass_error: [kg].
        torque_bias: [N m], shape (3,); None without torques.
        torque_bias_error: [N m], shape (3,), or None.
        centre_of_mass: From the sensor's origin [m], shape (3,), or None.
        centre_of_mass_error: [m], shape (3,), or None.
        force_residual: [N], shape (n, 3).
        torque_residual: [N m], shape (n, 3), or None.
        spread: Standard deviations of the gravity direction along its principal axes, largest first, shape (3,).
        poses: Orientations that differ.
    """

    force_bias: Array
    force_bias_error: Array
    mass: float
    mass_error: float
    torque_bias: Array | None
    torque_bias_error: Array | None
    centre_of_mass: Array | None
    centre_of_mass_error: Array | None
    force_residual: Array
    torque_residual: Array | None
    spread: Array
    poses: int


def fit_tool_weight(
    gravity_direction: ArrayLike, force: ArrayLike, torque: ArrayLike | None = None, *, gravity: float = 9.80665
) -> ToolWeight:
    r"""Linear least squares over static poses, all of equal weight.

    .. math:: F_i = b_F + m\, g\, d_i, \qquad T_i = b_T + h \times g\, d_i, \qquad h = m c

    F and T are the load on the sensor and d gravity's direction, in the sensor's frame; b are the biases, m the mass
    and c the centre of mass. Standard errors: residual variance over its degrees of freedom, 3 n - 4 and 3 n - 6, times
    the inverse of the normal matrix; that of c from those of h and m, which come from independent noise. It is the
    usual identification of a payload at rest (Atkeson, An and Hollerbach, 1986, Estimation of inertial parameters of
    manipulator loads and links, International Journal of Robotics Research 5(3)), with biases.

    Args:
        gravity_direction: d, of length 1, shape (n, 3).
        force: F [N], shape (n, 3).
        torque: T [N m], shape (n, 3), or None.
        gravity: g [m/s^2], positive.

    Raises:
        InputError: Arrays of other shapes or not finite, fewer than 6 poses that differ, gravity along too few
            directions of the sensor's frame, or a mass that is not positive; the message says what to add.
    """
    d, forces = np.asarray(gravity_direction, dtype=np.float64), np.asarray(force, dtype=np.float64)
    torques = None if torque is None else np.asarray(torque, dtype=np.float64)
    for name, values in (("gravity_direction", d), ("force", forces), ("torque", torques)):
        if values is not None and (values.ndim != 2 or values.shape != (d.shape[0], 3)):
            raise InputError(f"{name} has shape {values.shape}: give (n, 3), the same n for all")
        if values is not None and not np.isfinite(values).all():
            raise InputError(f"{name} must be finite in every pose")
    poses = _count_poses(d)
    spread = _require_directions(d, poses)
    weight = gravity * d
    design = np.zeros((d.size, 4))
    design[:, :3] = np.tile(np.eye(3), (len(d), 1))
    design[:, 3] = weight.ravel()
    found, errors, residual = _least_squares(design, forces.ravel())
    mass, mass_error = float(found[3]), float(errors[3])
    if not mass > 0.0:
        raise InputError(
            f"the tool's mass comes out as {mass:.4g} kg: forces must be the load on the sensor, positive along its "
            "axes; if yours are the reaction, change the sign of forces and torques"
        )
    first = (found[:3], errors[:3], mass, mass_error)
    if torques is None:
        return ToolWeight(*first, None, None, None, None, residual.reshape(-1, 3), None, spread, poses)
    design = np.zeros((d.size, 6))
    design[:, :3] = np.tile(np.eye(3), (len(d), 1))
    design[:, 3:] = -_cross_matrices(weight).reshape(-1, 3)
    moment, moment_errors, torque_residual = _least_squares(design, torques.ravel())
    centre = moment[3:] / mass
    centre_error = np.hypot(moment_errors[3:], np.abs(centre) * mass_error) / mass
    return ToolWeight(
        *first,
        moment[:3],
        moment_errors[:3],
        centre,
        centre_error,
        residual.reshape(-1, 3),
        torque_residual.reshape(-1, 3),
        spread,
        poses,
    )


def _count_poses(directions: Array) -> int:
    """Orientations that differ, each from all that were counted before it."""
    kept = np.empty((0, 3))
    for direction in directions:
        if len(kept) == 0 or float(np.linalg.norm(kept - direction, axis=1).min()) > SAME_POSE:
            kept = np.vstack((kept, direction))
    return len(kept)


def _require_directions(directions: Array, poses: int) -> Array:
    """Spread of the gravity direction, refused where weight and bias could not be told apart."""
    away = directions - directions.mean(axis=0)
    variances, axes = np.linalg.eigh(away.T @ away / max(len(directions), 1))
    spread = np.asarray(np.sqrt(np.maximum(variances[::-1], 0.0)), dtype=np.float64)
    lacking = axes[:, ::-1].T[spread < LEAST_SPREAD]
    missing = " and ".join(f"({', '.join(f'{value + 0.0:.2f}' for value in axis)})" for axis in lacking)
    if spread[1] < LEAST_SPREAD:
        raise InputError(
            f"gravity hardly turns towards {missing} of the sensor's frame (spread {spread[1]:.2f} along the second "
            f"axis, at least {LEAST_SPREAD:g} is needed): add poses with the sensor tilted so that gravity pulls both "
            "ways along these"
        )
    if poses < FEWEST_POSES:
        more = f"; so far gravity hardly turns towards {missing}" if missing else ""
        there = f"{plural(poses, 'pose')} that differ by more than 6 degrees"
        raise InputError(f"{there}: at least {FEWEST_POSES} are needed{more}")
    return spread


def _least_squares(design: Array, values: Array) -> tuple[Array, Array, Array]:
    """Solution, standard errors, residual."""
    solution = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)
    residual = np.asarray(values - design @ solution, dtype=np.float64)
    variance = float(residual @ residual) / (values.size - design.shape[1])
    errors = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    return solution, np.asarray(errors, dtype=np.float64), residual


def _cross_matrices(vectors: Array) -> Array:
    """Matrices [v] with [v] h = v x h, shape (n, 3, 3)."""
    x, y, z = vectors.T
    nothing = np.zeros_like(x)
    return np.stack([np.stack(row, axis=1) for row in ((nothing, -z, y), (z, nothing, -x), (-y, x, nothing))], axis=1)
