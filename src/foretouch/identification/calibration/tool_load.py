"""Bias, tool and frame of a wrist's sensor together, from static poses, of which some may have touched something."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares as refine
from scipy.spatial.transform import Rotation

from foretouch.errors import InputError
from foretouch.identification.calibration.sensor_frame import (
    SensorFrame,
    check_torques,
    fit_sensor_frame,
    outlying_poses,
)
from foretouch.identification.force_calibration import ToolWeight, fit_tool_weight
from foretouch.quantities import ByValue, ToolLoad

Array = NDArray[np.float64]

SURE = 3.0  # Number of standard errors from which a centre of mass is on a side

LEAST_NOISE = 1e-9  # of residuals that are exactly 0, as weights need one


@dataclass(frozen=True, eq=False)
class ToolLoadFit(ByValue):
    """What static poses say of a sensor and its tool.

    Attributes:
        weight: Bias, mass and centre of mass in the sensor's frame, with standard errors and residuals of the poses
            that were taken.
        frame: The sensor's frame against the one in which gravity was given; None where gravity does not turn along all
            three axes, and the two frames were taken for one.
        left_out: Numbers, from 0, of the poses that the others do not explain.
        force_noise: Standard deviation of the force's residuals [N].
        torque_noise: Standard deviation of the torque's [N m], or None.
        condition: Condition number of the design, its columns scaled to length 1: 1 where the poses tell all apart, and
            beyond some 30 where they hardly do.
    """

    weight: ToolWeight
    frame: SensorFrame | None
    left_out: list[int]
    force_noise: float
    torque_noise: float | None
    condition: float

    @property
    def is_behind(self) -> bool:
        """Whether the centre of mass lies on the arm's side of the sensor, by the flange's z: as of a wrong sign."""
        centre, error = self.weight.centre_of_mass, self.weight.centre_of_mass_error
        if centre is None or error is None:
            return False
        turn = Rotation.identity() if self.frame is None else Rotation.from_rotvec(self.frame.turn)
        return float(turn.inv().apply(centre)[2]) < -SURE * float(np.max(error))

    @property
    def load(self) -> ToolLoad | None:
        """Bias and tool in six axes; None without torques."""
        weight = self.weight
        if weight.torque_bias is None or weight.centre_of_mass is None:
            return None
        bias = (*weight.force_bias.tolist(), *weight.torque_bias.tolist())
        turn = np.zeros(3) if self.frame is None else self.frame.turn
        return ToolLoad(bias, weight.mass, tuple(weight.centre_of_mass.tolist()), tuple(turn.tolist()))


def fit_tool_load(
    gravity_direction: ArrayLike, force: ArrayLike, torque: ArrayLike | None = None, *, gravity: float = 9.80665
) -> ToolLoadFit:
    r"""Bias, mass, centre of mass and sensor frame by weighted least squares over static poses.

    .. math:: F_i = b_F + m\, g\, R\, d_i, \qquad T_i = b_T + h \times g\, R\, d_i, \qquad h = m c

    F and T are the load on the sensor, d is gravity's direction in a frame that turns with it, such as the flange's,
    and R the rotation from there to the sensor's. Poses that the others do not explain are left out first
    (`outlying_poses`). Forces alone give a first R (`fit_sensor_frame`), then all is linear (`fit_tool_weight`), and
    nonlinear least squares over a small turn of R refine everything at once, forces and torques weighted by their
    residuals. Standard errors come from the inverse of the weighted normal matrix: they know that an error of R is one
    of the centre of mass, too.

    Two directions of gravity that are not parallel fix R, and the size of the forces the mass, if the sensor's own
    scale is right. Where gravity turns along two axes only, R stays open and is taken for the identity.

    Args:
        gravity_direction: d, of length 1, shape (n, 3).
        force: F [N], shape (n, 3).
        torque: T [N m], shape (n, 3), or None.
        gravity: g [m/s^2], positive.

    Raises:
        InputError: As `fit_tool_weight`, `fit_sensor_frame` and `check_torques`.
    """
    d, forces = np.asarray(gravity_direction, np.float64), np.asarray(force, np.float64)
    torques = None if torque is None else np.asarray(torque, np.float64)
    _require_shapes(d, forces, torques)
    left_out = outlying_poses(d, forces, torques)
    d, forces = np.delete(d, left_out, axis=0), np.delete(forces, left_out, axis=0)
    torques = None if torques is None else np.delete(torques, left_out, axis=0)
    frame = fit_sensor_frame(d, forces, gravity=gravity)
    if torques is not None:
        check_torques(forces, torques)
    first = Rotation.identity() if frame is None else Rotation.from_rotvec(frame.turn)
    weight = fit_tool_weight(first.apply(d), forces, torques, gravity=gravity)
    problem = _Problem(gravity * d, forces, torques, first, weight, turns=frame is not None)
    return problem.solved(left_out)


def _require_shapes(d: Array, forces: Array, torques: Array | None) -> None:
    for name, values in (("gravity_direction", d), ("force", forces), ("torque", torques)):
        if values is not None and (values.ndim != 2 or values.shape != (d.shape[0], 3)):
            raise InputError(f"{name} has shape {values.shape}: give (n, 3), the same n for all")
        if values is not None and not np.isfinite(values).all():
            raise InputError(f"{name} must be finite in every pose")


class _Problem:
    """The unknowns: b_F, m, a turn of R if it is open, and with torques b_T and h."""

    def __init__(
        self, pull: Array, forces: Array, torques: Array | None, first: Rotation, weight: ToolWeight, *, turns: bool
    ) -> None:
        self.pull, self.forces, self.torques, self.first, self.weight = pull, forces, torques, first, weight
        self.turn = slice(4, 7 if turns else 4)
        self.moment = slice(self.turn.stop, self.turn.stop + 6)
        begin = [*weight.force_bias, weight.mass, *np.zeros(self.turn.stop - 4)]
        self.force_noise = _noise(weight.force_residual, self.turn.stop)
        self.torque_noise = None
        if weight.torque_bias is not None and weight.centre_of_mass is not None:
            assert weight.torque_residual is not None
            begin += [*weight.torque_bias, *(weight.mass * weight.centre_of_mass)]
            self.torque_noise = _noise(weight.torque_residual, 6)
        self.begin = np.asarray(begin)

    def rotation(self, unknown: Array) -> Rotation:
        turn = unknown[self.turn]
        return Rotation.from_rotvec(turn) * self.first if turn.size else self.first

    def residuals(self, unknown: Array) -> tuple[Array, Array | None]:
        """Measured less fitted forces and torques."""
        pull = self.rotation(unknown).apply(self.pull)
        force = self.forces - unknown[:3] - unknown[3] * pull
        if self.torques is None:
            return force, None
        moment = unknown[self.moment]
        return force, self.torques - moment[:3] - np.cross(moment[3:], pull)

    def weighted(self, unknown: Array) -> Array:
        force, torque = self.residuals(unknown)
        parts = [force.ravel() / self.force_noise]
        if torque is not None and self.torque_noise is not None:
            parts.append(torque.ravel() / self.torque_noise)
        return np.concatenate(parts)

    def solved(self, left_out: list[int]) -> ToolLoadFit:
        found = refine(self.weighted, self.begin, x_scale="jac")
        slopes = np.asarray(found.jac, np.float64)
        covariance = np.asarray(np.linalg.inv(slopes.T @ slopes), np.float64)
        condition = float(np.linalg.cond(slopes / np.linalg.norm(slopes, axis=0)))
        unknown, errors = np.asarray(found.x, np.float64), np.sqrt(np.diag(covariance))
        force, torque = self.residuals(unknown)
        weight = replace(
            self.weight,
            force_bias=unknown[:3],
            force_bias_error=errors[:3],
            mass=float(unknown[3]),
            mass_error=float(errors[3]),
            force_residual=force,
        )
        if torque is not None:
            weight = self._with_torque(weight, unknown, covariance, torque)
        frame = None
        if self.turn.stop > self.turn.start:
            turn = np.asarray(self.rotation(unknown).as_rotvec(), np.float64)
            frame = SensorFrame(turn, errors[self.turn])
        return ToolLoadFit(weight, frame, left_out, self.force_noise, self.torque_noise, condition)

    def _with_torque(self, weight: ToolWeight, unknown: Array, covariance: Array, torque: Array) -> ToolWeight:
        """The rest of the solution: c = h / m, by the slopes of it over h and m."""
        moment = np.arange(self.moment.start, self.moment.stop)
        centre = unknown[moment[3:]] / unknown[3]
        slopes = np.column_stack((np.eye(3), -centre)) / unknown[3]
        both = np.append(moment[3:], 3)
        spread = slopes @ covariance[np.ix_(both, both)] @ slopes.T
        return replace(
            weight,
            torque_bias=unknown[moment[:3]],
            torque_bias_error=np.sqrt(np.diag(covariance))[moment[:3]],
            centre_of_mass=centre,
            centre_of_mass_error=np.sqrt(np.diag(spread)),
            torque_residual=torque,
        )


def _noise(residual: Array, unknowns: int) -> float:
    """Standard deviation of residuals of which so many unknowns were fitted."""
    return max(math.sqrt(float(np.square(residual).sum()) / (residual.size - unknowns)), LEAST_NOISE)
