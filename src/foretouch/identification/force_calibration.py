"""Calibration of a force sensor without contact: its zero from a recording; bias, tool mass and centre from poses.

A recording that does not show its zero is detected. Poses are static, and the tool is all that is beyond the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import InputError, plural
from foretouch.identification.conditioning.conditioner import require_columns
from foretouch.quantities import ByValue, Recording, cross_matrix, numbers_of

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

OFFSET_WINDOW = 0.05  # Length of the window whose lowest mean is the zero of the measured force [s]
THRESHOLD_SHARE = 0.05  # Contact threshold as a fraction of the 98th percentile of the measured force
OUTERMOST = 10.0  # Percentage of positions that are out of contact if the force is level there
TOUCH = 0.01  # Time over which the mean force must be above the threshold [s]; otherwise it is noise, and no contact

LOWEST, AIR = "lowest 50 ms mean", "level of free air"  # What a zero in hindsight is

LEVEL_SLOPE = 0.05  # Ratio of the slope over those positions to the slope in contact, up to which the force is level

REST_SLOPE = 0.25
"""Ratio of the force slope below the contact threshold to the slope above it, from which on a recording counts as never
out of contact. Measured files: foam and skin at most 0.1, preloaded springs at least 0.8."""

FEWEST_SAMPLES = 10  # Least number of samples in an offset window, unless most windows of the file hold fewer

BLOCK, OVERLAP = 1 << 18, 1 << 15
"""Number of samples whose means are taken at once, and how many of them overlap the previous block: more than a window
holds at any rate below 600 kHz. Shorter recordings are one block."""


def lowest_mean(time: ArrayLike, force: ArrayLike, window: float = OFFSET_WINDOW) -> float:
    """Lowest mean of the force over a time window: the sensor's zero, in hindsight.

    A window ends at each sample and reaches back by its length; it counts once the samples before it fill it, and
    if it holds 10 samples, or as many as most windows of the file do, so that one sample after a gap is no mean. At
    an even rate these are all runs of ``window / sample period`` samples. A file shorter than the window has one
    mean, that of all its samples.

    Args:
        time: Sample times [s], increasing, shape (n,).
        force: Measured force [N], shape (n,), n of at least 1.
        window: Length of the window [s].
    """
    clock, values = columns_of(time, force)
    period = median_period(clock)
    first = np.searchsorted(clock, clock - window + 1e-3 * period, side="right")
    last = np.arange(1, clock.size + 1)
    held = last - first
    full = clock - clock[0] >= window - 1.001 * period
    if not full.any():
        return float(values.mean())
    full &= held >= min(FEWEST_SAMPLES, float(np.median(held[full])))
    middle = values.mean()  # sums of small numbers lose fewer digits
    sums = np.concatenate(([0.0], np.cumsum(values - middle)))
    return float(((sums[last] - sums[first])[full] / held[full]).min() + middle)


def zero_in_hindsight(
    time: ArrayLike, force: ArrayLike, position: ArrayLike | None, contact_floor: float
) -> tuple[float, str]:
    """Zero of the force of a whole recording [N], and what it is: `lowest_mean`, or the level of free air.

    Free air is told apart where the force over the outermost tenth of positions does not follow the position, as it
    does in contact. Its median is the zero, for the lowest mean may be a pull, the friction of the mechanism on its way
    out, or a sensor that was not there at first. One zero holds for the whole recording: a drift of the sensor counts
    as an error.

    Args:
        time: Sample times [s], increasing, shape (n,), n of at least 1.
        force: Measured force [N], shape (n,).
        position: Probe position [m], shape (n,), or None.
        contact_floor: Least force that counts as contact [N].
    """
    lowest = lowest_mean(time, force)
    if position is None:
        return lowest, LOWEST
    values, point = columns_of(force, position)
    if not np.isfinite(point).all():
        return lowest, LOWEST
    outside = point <= np.percentile(point, OUTERMOST)
    middle = float(np.median(values[outside]))
    threshold = max(THRESHOLD_SHARE * (float(np.percentile(values, 98.0)) - middle), contact_floor)
    contact = _slope(point, values, values > middle + threshold)
    is_level = abs(_slope(point, values, outside)) <= LEVEL_SLOPE * contact
    return (middle, AIR) if is_level else (lowest, LOWEST)


def is_zero_unobservable(recording: Recording) -> bool:
    """Whether the probe never leaves contact: what `foretouch.report.score_prediction` calls ``offset_unobservable``.

    However long the recording is, this takes little memory beside it.

    Args:
        recording: Recording of presses; its `contact_floor` is the least force that counts as contact.
    """
    time, force = recording.time, recording.force
    # The force itself is tested instead of the force less its zero: no copy of it is made.
    zero = _lowest(time, force, 1.0, OFFSET_WINDOW)
    threshold = max(THRESHOLD_SHARE * (float(np.percentile(force, 98.0)) - zero), recording.contact_floor)
    in_contact = force > threshold + zero
    if not in_contact.any() or -_lowest(time, force, -1.0, TOUCH) - zero <= threshold:
        return False
    return never_leaves_contact(recording.position, force, in_contact)


def _lowest(time: Array, force: Array, sign: float, window: float) -> float:
    """`lowest_mean` of the force times a sign, block by block."""
    result, begin, end = np.inf, 0, 0
    while end < time.size:
        end = min(begin + BLOCK, time.size)
        result = min(result, lowest_mean(time[begin:end], sign * force[begin:end], window))
        begin = end - OVERLAP
    return float(result)


def never_leaves_contact(position: ArrayLike, force: Array, in_contact: Flags) -> bool:
    """Whether the force still follows the position below the contact threshold, as it does nowhere in free air."""
    (point, _) = columns_of(position, force)
    above = _slope(point, force, in_contact)
    below = _slope(point, force, ~in_contact)
    return above > 0.0 and below > REST_SLOPE * above


def _slope(position: Array, force: Array, chosen: Flags) -> float:
    """Least-squares slope of force over position [N/m] at the chosen samples, 0 where their position does not vary."""
    if np.count_nonzero(chosen) < 3:
        return 0.0
    middle, level = position.mean(where=chosen), force.mean(where=chosen)
    products = squares = 0.0
    for begin in range(0, position.size, BLOCK):
        part = slice(begin, begin + BLOCK)
        centred = position[part][chosen[part]] - middle
        products += float((centred * (force[part][chosen[part]] - level)).sum())
        squares += float((centred**2).sum())
    varies = position.max(where=chosen, initial=-np.inf) > position.min(where=chosen, initial=np.inf)
    return products / squares if varies else 0.0


def columns_of(*columns: ArrayLike) -> tuple[Array, ...]:
    """Columns as arrays of one shape (n,); `InputError` if their shapes differ or they are not numbers."""
    arrays = tuple(numbers_of("a column", column) for column in columns)
    require_columns("the columns", *arrays)
    return arrays


def median_period(clock: Array) -> float:
    """Median sample period [s], 0 for a single sample."""
    return float(np.median(np.diff(clock))) if clock.size > 1 else 0.0


FEWEST_POSES = 6  # Least number of orientations, which differ by more than `SAME_POSE`
SAME_POSE = 0.1  # Largest angle between gravity directions of the same pose [rad]

LEAST_SPREAD = 0.2
"""Least standard deviation of the gravity direction along the second of its principal axes [-]: a rotation about one
axis by +-17 degrees has this spread along one axis only."""


@dataclass(frozen=True, eq=False)
class ToolWeight(ByValue):
    """Weight of a tool and bias of the sensor from static poses. Arrays of three are in the sensor's frame.

    Attributes:
        force_bias: Bias of the force [N], shape (3,).
        force_bias_error: Standard error [N], shape (3,).
        mass: Mass of the tool [kg].
        mass_error: Standard error [kg].
        force_residual: Residuals of the forces [N], shape (n, 3).
        spread: Standard deviations of the gravity direction along its principal axes, largest first, shape (3,).
        poses: Number of different orientations.
        torque_bias: Bias of the torque [N m], shape (3,); None without torques.
        torque_bias_error: Standard error [N m], shape (3,), or None.
        centre_of_mass: From the sensor's origin [m], shape (3,), or None.
        centre_of_mass_error: Standard error [m], shape (3,), or None.
        torque_residual: Residuals of the torques [N m], shape (n, 3), or None.
    """

    force_bias: Array
    force_bias_error: Array
    mass: float
    mass_error: float
    force_residual: Array
    spread: Array
    poses: int
    torque_bias: Array | None = None
    torque_bias_error: Array | None = None
    centre_of_mass: Array | None = None
    centre_of_mass_error: Array | None = None
    torque_residual: Array | None = None


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
    weight, biases = gravity * d, np.tile(np.eye(3), (len(d), 1))
    result, variances, residual = least_squares(np.column_stack((biases, weight.ravel())), forces.ravel())
    errors = np.sqrt(variances)
    mass, mass_error = float(result[3]), float(errors[3])
    if not mass > 0.0:
        raise InputError(
            f"the tool's mass comes out as {mass:.4g} kg: forces must be the load on the sensor, positive along its "
            "axes; if yours are the reaction, change the sign of forces and torques"
        )
    known = (result[:3], errors[:3], mass, mass_error, residual.reshape(-1, 3), spread, poses)
    if torques is None:
        return ToolWeight(*known)
    moments = -np.vstack([cross_matrix(row) for row in weight])
    moment, variances, torque_residual = least_squares(np.column_stack((biases, moments)), torques.ravel())
    moment_errors, centre = np.sqrt(variances), moment[3:] / mass
    centre_error = np.hypot(moment_errors[3:], np.abs(centre) * mass_error) / mass
    return ToolWeight(*known, moment[:3], moment_errors[:3], centre, centre_error, torque_residual.reshape(-1, 3))


def _count_poses(directions: Array) -> int:
    """Number of different orientations, each compared with all that were counted before it."""
    kept = list[Array]()
    for direction in directions:
        if all(np.linalg.norm(one - direction) > SAME_POSE for one in kept):
            kept.append(direction)
    return len(kept)


def _require_directions(directions: Array, poses: int) -> Array:
    """Spread of the gravity direction, refused where weight and bias would not be separable."""
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


def least_squares(design: Array, values: Array) -> tuple[Array, Array, Array]:
    """Solution, its variances if the residuals are independent, and residual."""
    solution = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)
    residual = values - design @ solution
    variance = float(residual @ residual) / (values.size - design.shape[1])
    return solution, variance * np.diag(np.linalg.inv(design.T @ design)), residual
