"""Series compliance of arm, sensor and tip between encoder and contact, from presses on a rigid block."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, plural
from foretouch.errors.checks import require
from foretouch.identification.conditioning.conditioner import LONGEST_LAG, Conditioner, SensorLag
from foretouch.identification.force_calibration import least_squares
from foretouch.identification.offline import likeness_of
from foretouch.quantities import ByValue, Recording, SensorCalibration

FLOOR_SHARE = 0.1  # Least force that is used, as a fraction of the largest: below it the contact still seats itself
SMOOTHING = 0.02  # Time over which the force is averaged to tell loading from unloading [s]
SLOWEST_SHARE = 0.05  # Least rate of that mean in loading or unloading, as a fraction of its largest rate
FEWEST_SAMPLES = 50  # Least number of samples in loading, and in unloading
LARGEST_ERROR = 0.1  # Largest standard error of a stiffness, as a fraction of it; a less certain one is refused

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SeriesCompliance(ByValue):
    """Series compliance estimated from presses on a rigid block.

    Attributes:
        stiffness: Stiffness of all that is in series [N/m].
        stiffness_error: Standard error [N/m].
        lost_motion: Distance by which unloading is deeper than loading at equal force [m].
        lost_motion_error: Standard error [m].
        position: Position at force zero of the line, amid loading and unloading [m].
        contact_floor: Least force that was used [N].
        force_offset: Force in free air [N].
        force: Forces of the samples used, less the offset [N], shape (n,).
        deflection: Their positions less `position` [m], shape (n,).
        loading: Whether each of them is in loading, shape (n,).
        residual: Residuals of their positions [m], shape (n,).
    """

    stiffness: float
    stiffness_error: float
    lost_motion: float
    lost_motion_error: float
    position: float
    contact_floor: float
    force_offset: float
    force: Array
    deflection: Array
    loading: NDArray[np.bool_]
    residual: Array


def fit_series_compliance(recording: Recording, *, sensor_lag: float = 0.0) -> SeriesCompliance:
    r"""A line through loading and another through unloading, of one slope.

    .. math:: x_i = x_0 + F_i / k \mp w / 2

    minus while loading, w being the lost motion. Positions are fitted over forces and not the other way: on a rigid
    block the encoder's count is the larger noise, and noise of the regressor flattens a slope. Standard errors are of
    least squares, correlated residuals counted as fewer: by (1 + r) / (1 - r), r the correlation of successive ones;
    that of k is k^2 times that of 1/k.

    Args:
        recording: Presses on a rigid block that also leave it, so that the force has a zero.
        sensor_lag: Lag of forces behind positions [s], 0 to 0.05: a lag looks like lost motion.

    Raises:
        RecordingError: No contact, too little loading or unloading, or a slope that is not distinguishable from noise.
    """
    require("sensor_lag", sensor_lag, at_least=0.0, at_most=LONGEST_LAG)
    if sensor_lag > 0.0:
        late = np.interp(recording.time - sensor_lag, recording.time, recording.position)
        recording = replace(recording, position=late)
    offset = _free_air(recording)
    force = recording.force - offset
    floor = max(recording.contact_floor, FLOOR_SHARE * float(np.quantile(force, 0.999)))
    rate = _rate(recording.time, force)
    moving = np.abs(rate) > SLOWEST_SHARE * float(np.quantile(np.abs(rate), 0.99))
    taken = (force > floor) & moving
    loading = rate > 0.0
    for name, part in (("loading", taken & loading), ("unloading", taken & ~loading)):
        if int(part.sum()) < FEWEST_SAMPLES:
            raise RecordingError(
                recording.name,
                f"{plural(int(part.sum()), 'sample')} while {name} above {floor:.3g} N, not {FEWEST_SAMPLES} or more: "
                "press the block slowly, several times, and leave it in between",
            )
    felt, position, loads = force[taken], recording.position[taken], loading[taken]
    design = np.column_stack((np.ones(felt.size), felt, np.where(loads, -0.5, 0.5)))
    zero = float(position.mean())
    solution, variances, residual = least_squares(design, position - zero)
    likeness = likeness_of(residual)
    start, compliance, lost_motion = solution.tolist()
    _, error, lost_motion_error = np.sqrt(variances * (1.0 + likeness) / (1.0 - likeness)).tolist()
    if not compliance > 0.0 or error > LARGEST_ERROR * compliance:
        raise RecordingError(
            recording.name,
            f"position grows by {1e6 * compliance:.3g} +- {1e6 * error:.2g} um/N: that tells no stiffness to "
            f"{100.0 * LARGEST_ERROR:g} %; press harder, or more often",
        )
    return SeriesCompliance(
        1.0 / compliance,
        error / compliance**2,
        lost_motion,
        lost_motion_error,
        zero + start,
        floor,
        offset,
        felt,
        position - zero - start,
        loads,
        residual,
    )


def find_sensor_lag(recording: Recording) -> tuple[float, float]:
    """Lag of the force sensor and its standard error [s], from motion in contact or from taps: see `SensorLag`.

    A spring or a rigid block shows the lag itself; a material that damps, less, and so does lost motion: by half of it
    over the speed, so press quickly.

    Raises:
        RecordingError: Less than 0.2 s of motion in contact.
    """
    conditioner, estimate = Conditioner(contact_floor=recording.contact_floor), SensorLag()
    before = float(recording.time[0])
    for time, position, force in _samples(recording):
        sample = conditioner.update(time, position, force)
        if sample.in_contact:
            estimate.update(position, sample.velocity, force, time - before)
        before = time
    lag, error = estimate.lag, estimate.standard_error
    if lag is None or error is None:
        raise RecordingError(
            recording.name,
            f"{estimate.time:.2f} s of motion in contact tell no lag: press a spring or a block to and fro for a "
            "second, or tap it until the taps last 0.2 s together",
        )
    return lag, error


def correct_recording(
    recording: Recording, calibration: SensorCalibration, *, force_offset: float | None = None
) -> Recording:
    r"""Convert the positions of a recording from the encoder to the contact.

    .. math:: p(t) = x(t) - F(t + \delta) / k

    x being the position, F the force less its offset, delta the sensor's lag and k the series stiffness, so that depth
    is x - surface - F / k. The force itself and its lag stay: a learner takes offset and lag. Without a series
    stiffness the recording is returned as it is. A measured velocity is dropped, for it is that of the encoder. This
    looks delta ahead, and at the force itself: it is for identification, not for prediction.

    Args:
        recording: Recording as measured.
        calibration: Calibration of the sensor.
        force_offset: Force in free air [N]; None for that of the calibration, or else for the one estimated from the
            recording. A wrong one shifts all positions alike.
    """
    if calibration.series_stiffness is None:
        return recording
    offset = calibration.force_offset if force_offset is None else force_offset
    ahead = recording.time + (calibration.sensor_lag or 0.0)
    force = np.interp(ahead, recording.time, recording.force) - (_free_air(recording) if offset is None else offset)
    return replace(recording, position=recording.position - force / calibration.series_stiffness, velocity=None)


def _free_air(recording: Recording) -> float:
    """Force in free air, estimated from the whole recording [N]."""
    conditioner = Conditioner(contact_floor=recording.contact_floor)
    for sample in _samples(recording):
        conditioner.update(*sample)
    return float(conditioner.offset)


def _samples(recording: Recording) -> Iterable[tuple[float, float, float]]:
    return zip(recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), strict=True)


def _rate(time: Array, force: Array) -> Array:
    """Rate of the force's mean over 20 ms [N/s], from both sides."""
    half = 0.5 * SMOOTHING
    sums = np.concatenate(([0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(time))))
    later, sooner = np.minimum(time + half, time[-1]), np.maximum(time - half, time[0])
    means = (np.interp(later, time, sums) - np.interp(sooner, time, sums)) / (later - sooner)
    rate: Array = np.gradient(means, time)
    return rate
