"""An operator that repeats a measured hand motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.devices.device import PEAK_SPEED_RATIO, Operator, minimum_jerk, quintic_move
from foretouch.errors import SettingError
from foretouch.errors.checks import require

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

KNOT_PERIOD = 0.01  # Spacing of the interpolated points [s]
SMOOTHING = 0.008  # Width of the Gaussian [s] (its cut-off is 17 Hz): encoder steps go, what a hand can do stays
JOIN_TIME, JOIN_SPEED = 0.3, 0.05
"""Shortest join [s], and the mean speed [m/s] that a longer one keeps in the recording's own scale."""
CLEARANCE = 0.003  # Height of the highest point of the motion above the surface [m]
APPROACH_TIME, APPROACH_SPEED = 1.0, 0.05
"""Shortest first approach [s] and its peak speed [m/s]."""
START_TIME = 0.5  # Time in which the recording's clock gathers speed, so that the hand starts from rest [s]


class RecordedOperator(Operator):
    """A recorded hand motion, repeated for ever.

    The motion loses its encoder steps (a Gaussian of 8 ms), is closed into a loop by a polynomial that meets position,
    velocity and acceleration at both ends, and is interpolated by a periodic cubic spline through a point every 10 ms.
    Offset and one scale bring its highest point into free air, 3 mm above the surface (half the way there if the
    surface is nearer than 6 mm), and its deepest to `press_depth` below it; time is not scaled. It begins at 0, comes
    to the loop's highest point by a minimum-jerk move of 1 s (or as much more as 50 mm/s needs), and starts from there
    with a clock that takes 0.5 s to run at full speed.

    Args:
        time: Times of the recording [s], increasing, at least 0.5 s of them.
        position: Positions of the hand [m], growing into the material; at least 0.1 mm between the extremes.
        surface: Position of the undeformed surface [m], 0.001 to 0.2.
        press_depth: Depth of the deepest point below the surface [m], 0.0005 to 0.1.

    Raises:
        SettingError: An argument out of range.
    """

    __slots__ = ("_approach_time", "_count", "_first", "_pieces")
    name: ClassVar[str] = "recorded"

    def __init__(
        self, time: NDArray[np.float64], position: NDArray[np.float64], surface: float, press_depth: float
    ) -> None:
        super().__init__()
        require("surface", surface, at_least=0.001, at_most=0.2)
        require("press_depth", press_depth, at_least=0.0005, at_most=0.1)
        loop = _loop(*_checked(time, position))
        loop = np.roll(loop, -int(np.argmin(loop)))
        spline = _periodic(loop)
        fine = spline(np.arange(0.0, len(loop) * KNOT_PERIOD, 0.001))
        top, bottom = float(fine.min()), float(fine.max())
        rest = surface - min(CLEARANCE, 0.5 * surface)
        spline = _periodic(rest + (loop - top) * (surface + press_depth - rest) / (bottom - top))
        self._first = float(spline(0.0))
        self._approach_time = max(APPROACH_TIME, PEAK_SPEED_RATIO * self._first / APPROACH_SPEED)
        self._pieces: list[list[float]] = spline.c.T.tolist()
        self._count = len(self._pieces)

    @property
    def period(self) -> float:
        """Time after which the motion repeats [s]."""
        return self._count * KNOT_PERIOD

    @property
    def loop(self) -> list[float]:
        """Positions of one period [m], one every 10 ms, from the highest on."""
        return [piece[-1] for piece in self._pieces]

    def position_at(self, time: float) -> float:
        """Position of the hand [m] at a time since the first `read` [s], which never goes back."""
        if time < self._approach_time:
            return self._first * minimum_jerk(time / self._approach_time)
        index, fraction = divmod(_eased(time - self._approach_time) / KNOT_PERIOD, 1.0)
        c3, c2, c1, c0 = self._pieces[int(index) % self._count]
        t = fraction * KNOT_PERIOD
        return c0 + t * (c1 + t * (c2 + t * c3))


def _eased(time: float) -> float:
    """Time of the recording [s] after `time` [s]: its rate is a minimum-jerk function, and 1 from `START_TIME` on."""
    tau = time / START_TIME
    if tau >= 1.0:
        return time - 0.5 * START_TIME
    return START_TIME * tau**4 * (2.5 + tau * (tau - 3.0))


def _checked(time: Any, position: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Both as arrays of numbers, or the rule that they break."""
    time, position = np.asarray(time, float), np.asarray(position, float)
    if time.ndim != 1 or time.shape != position.shape or len(time) < 4:
        raise SettingError("position", position.shape, f"one value for each of 4 or more times, got {time.shape} times")
    if not (np.isfinite(time).all() and np.isfinite(position).all()):
        raise SettingError("position", "not finite", "times and positions must be finite numbers")
    if not (np.diff(time) > 0).all():
        raise SettingError("time", float(time[np.argmin(np.diff(time)) + 1]), "times must increase")
    if time[-1] - time[0] < 0.5:
        raise SettingError("time", float(time[-1] - time[0]), "the motion must last at least 0.5 s")
    if np.ptp(position) < 1e-4:
        raise SettingError("position", float(np.ptp(position)), "the hand must move by at least 0.1 mm")
    return time, position


def _loop(time: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """The smoothed motion and a join from its end back to its start, a point every `KNOT_PERIOD`."""
    from scipy.interpolate import CubicSpline  # SciPy is slow to import: only when used
    from scipy.ndimage import gaussian_filter1d

    fine_period = 0.1 * KNOT_PERIOD
    fine = np.interp(np.arange(time[0], time[-1], fine_period), time, position)
    fine = gaussian_filter1d(fine, SMOOTHING / fine_period, mode="nearest")
    body = CubicSpline(np.arange(len(fine[::10])) * KNOT_PERIOD, fine[::10])
    last = (len(fine[::10]) - 1) * KNOT_PERIOD
    end, start = ([float(body(t, order)) for order in range(3)] for t in (last, 0.0))
    knots = round(max(JOIN_TIME, abs(start[0] - end[0]) / JOIN_SPEED) / KNOT_PERIOD)
    join = quintic_move(end, start, knots * KNOT_PERIOD)
    return np.concatenate([fine[::10], [join(i * KNOT_PERIOD) for i in range(1, knots)]])


def _periodic(loop: NDArray[np.float64]) -> CubicSpline:
    """Periodic cubic spline through the points."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(np.arange(len(loop) + 1) * KNOT_PERIOD, np.append(loop, loop[0]), bc_type="periodic")
