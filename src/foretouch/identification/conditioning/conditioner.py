"""From raw samples to depth, velocity and force in contact, causally; and how late the force is against the encoders.

The lag is estimated as far as contact itself can tell.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.core import Held, Kernel, Record, compiled
from foretouch.errors import InputError
from foretouch.errors.checks import require
from foretouch.identification.conditioning.kernel import (
    CONTACT_FLOOR,
    FIRST_CAPACITY,
    Conditioning,
    Memory,
    expect_zero,
    is_full,
    lose_surface,
    shift,
    take,
)
from foretouch.quantities import ByValue

Array = NDArray[np.float64]

MEMORY = 5.0  # Time in moving contact over which samples are remembered [s]
SLOWEST = 2e-3  # Least speed [m/s] at which the lag can be estimated


class Lag(Record):
    """State of `SensorLag`."""

    time: float  # in moving contact [s]
    weight: float  # the same, fading [s]
    place: float = math.nan  # origin of positions, so that what is squared stays small [m]; NaN before the first sample
    force: float = math.nan  # origin of forces [N]
    means: Annotated[Array, float, 3]  # of position, velocity, force
    products: Annotated[Array, float, 6]  # centred: xx, xv, vv, xF, vF, FF


@compiled
def clear(lags: NDArray[np.void]) -> None:
    """Forget all samples."""
    lag = lags[0]
    lag.time = lag.weight = 0.0
    lag.place = lag.force = math.nan
    lag.means[:] = 0.0
    lag.products[:] = 0.0


@compiled(error_model="numpy")
def take_lagged(lags: NDArray[np.void], position: float, velocity: float, force: float, period: float) -> None:
    """`SensorLag.update` on its state, in place."""
    if abs(velocity) < SLOWEST or not 0.0 < period < 1.0:
        return
    lag = lags[0]
    if math.isnan(lag.place):
        lag.place, lag.force = position, force
    fading = math.exp(-period / MEMORY)
    lag.time += period
    lag.weight = lag.weight * fading + period
    weight = period / lag.weight
    kept = 1.0 - weight
    means, products = lag.means, lag.products
    x = position - lag.place - means[0]
    v = velocity - means[1]
    f = force - lag.force - means[2]
    for index, away in enumerate((x, v, f)):
        means[index] += weight * away
    for index, product in enumerate((x * x, x * v, v * v, x * f, v * f, f * f)):
        products[index] = kept * (products[index] + weight * product)


LONGEST_LAG = 0.05  # Largest lag of a sensor [s]
LEAST_TIME = 0.2  # Least time of moving contact for an estimate [s]


_take_lagged = Kernel(take_lagged, "(Lag[::1], f8, f8, f8, f8)")


class SensorLag(Held):
    r"""The least lag that a passive material allows, from samples in moving contact.

    To first order a force that is felt :math:`\delta` late is

    .. math:: F = F_0 + K x + (B - K \delta) \dot x

    so that lag and damping cannot be told apart: only :math:`\tau = B / K - \delta` is seen. A material does not push
    itself along, B >= 0, hence :math:`\delta \ge -\tau`. On a spring that is the lag itself; where the material damps
    more than the sensor lags, the estimate is 0. F_0, K and the slope over velocity come from least squares that fade
    over 5 s of moving contact.

    Args:
        memory: Array of one `Lag` for the state, part of another record; None for one of its own.

    Attributes:
        time: Time in moving contact so far [s].
    """

    __slots__ = ("_take",)

    time: float

    def __init__(self, memory: NDArray[np.void] | None = None) -> None:
        super().__init__(Lag.new() if memory is None else memory)
        self._take = _take_lagged.entry

    def reset(self) -> None:
        """Forget all samples."""
        clear(self.records)

    def update(self, position: float, velocity: float, force: float, period: float) -> None:
        """Take one sample in contact.

        Args:
            position: Position [m].
            velocity: Velocity [m/s]; samples slower than 2 mm/s are left out.
            force: Force [N].
            period: Time since the previous sample [s].
        """
        self._take(self.records, position, velocity, force, period)

    @property
    def lag(self) -> float | None:
        """Least lag [s], 0 to 0.05; None while too little is known."""
        slopes = self._slopes()
        return None if slopes is None else min(max(-slopes[1] / slopes[0], 0.0), LONGEST_LAG)

    @property
    def standard_error(self) -> float | None:
        """Standard error of the lag [s], residuals taken as correlated over 20 ms; None while too little is known."""
        slopes = self._slopes()
        return None if slopes is None else slopes[2] / slopes[0]

    def _slopes(self) -> tuple[float, float, float] | None:
        """K [N/m], B - K delta [N s/m] and the standard error of that."""
        xx, xv, vv, xf, vf, ff = self.records[0].products.tolist()
        determinant = xx * vv - xv * xv
        if self.time < LEAST_TIME or not determinant > 1e-6 * xx * vv:
            return None
        stiffness, slope = (xf * vv - vf * xv) / determinant, (vf * xx - xf * xv) / determinant
        if not stiffness > 0.0:
            return None
        variance, independent = max(ff - stiffness * xf - slope * vf, 0.0), max(self.weight / 0.02, 1.0)
        return stiffness, slope, math.sqrt(variance * xx / determinant / independent)


class ContactSample(NamedTuple):
    """One conditioned sample.

    Attributes:
        time: Time of the sample [s].
        depth: Depth below the surface [m]; NaN before the surface is known.
        velocity: Velocity [m/s], positive while deepening.
        force: Force less the offset [N].
        in_contact: Whether the probe is judged to touch.
    """

    time: float
    depth: float
    velocity: float
    force: float
    in_contact: bool


def require_columns(names: str, *columns: NDArray[Any]) -> None:
    """Refuse columns of unlike shape, or of another than (n,), with an `InputError`."""
    shapes = [column.shape for column in columns]
    if len(set(shapes)) > 1 or len(shapes[0]) != 1:
        shown = ", ".join(map(str, shapes))
        raise InputError(f"{names} have the shapes {shown}: they must be columns of one length")


@dataclass(frozen=True, eq=False, init=False)
class ContactSamples(ByValue):
    """Conditioned samples of a recording, as columns of shape (n,).

    Args:
        time: [s].
        depth: Below the surface [m].
        velocity: Inwards [m/s].
        force: Less the offset [N].
        in_contact: None where the probe touches all the time.

    Raises:
        InputError: Columns of unlike shape.
    """

    time: Array
    depth: Array
    velocity: Array
    force: Array
    in_contact: NDArray[np.bool_]

    def __init__(
        self,
        time: ArrayLike,
        depth: ArrayLike,
        velocity: ArrayLike,
        force: ArrayLike,
        in_contact: ArrayLike | None = None,
    ) -> None:
        numbers = [np.ascontiguousarray(column, np.float64) for column in (time, depth, velocity, force)]
        touching = np.ones(numbers[0].shape, np.bool_) if in_contact is None else np.ascontiguousarray(in_contact, bool)
        require_columns("time, depth, velocity, force, in_contact", *numbers, touching)
        for name, column in zip(ContactSample._fields, (*numbers, touching), strict=True):
            object.__setattr__(self, name, column)

    @property
    def columns(self) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
        """Time, depth, velocity, force and contact, contiguous."""
        return self.time, self.depth, self.velocity, self.force, self.in_contact

    def __len__(self) -> int:
        return self.time.size

    def __iter__(self) -> Iterator[ContactSample]:
        columns = (column.tolist() for column in self.columns)
        return itertools.starmap(ContactSample, zip(*columns, strict=True))


class Conditioner(Held):
    r"""Estimates force offset, contact and surface as the samples come.

    - **Offset**: the lowest mean force over 50 ms so far, of the windows that are not much noisier than the
      quietest. Where a recording never leaves contact this is a convention; the data cannot determine it. A force that
      is one number at the beginning and noise after it begins with the noise.
    - **Free air**: a force that is level over 2 mm at the beginning is that of free air, as is one that was given with
      an error. From then on the force y of each stay outside, in the outer quarter of the way, is compared with it,

      .. math:: y = F_0 + d + c\, s, \quad \dot d = r

      by a Kalman filter of drift d, its rate r and the friction c of the mechanism, whose sign s goes with the motion.
      So nothing that pulls on the way out is taken for a lower offset. What has drifted is none of the material: forces
      are less the drift of their time. Friction is no contact: the thresholds below are for the force less c s, and a
      force above them that is level over 2 mm, where the first contact began or further out, is none. In contact the
      friction stays in the force, for the hand feels it.
    - **Contact** begins when the force rises above a threshold, the largest of the contact floor, eight times the
      spread of the quietest window so far, and 5 % of the largest force so far; it ends at half of it.
    - **Surface**: the last position, before the first contact, at which the force was below the threshold of ending.
      It moves outwards when contact is felt further out, and is found anew when the threshold has at least doubled
      since, for then the first contact was none.

    - **Lag**: where the force sensor is known to be late, positions wait for it, so that the two belong together.

    Args:
        surface: Position of the surface [m], or None to find it.
        force_offset: Force in free air [N], or None to find it.
        offset_error: Standard deviation of a given force in free air [N], not negative; 0 where it is exact and stays.
        contact_floor: Least force that counts as contact [N], by the noise of the origin; positive.
        sensor_lag: How late forces are against positions [s], not negative.

    Every number of the state (`foretouch.identification.conditioning.kernel.Conditioning`) is an attribute.

    Attributes:
        memory: The state and the rings of its newest samples, as compiled code takes them.
        surface: [m]; NaN before it is known.
        surface_error: Standard error of the surface [m]: contact began somewhere between the last position surely
            without and the first surely with it, and begins elsewhere at another press; 0 for one that was given.
        in_contact: The newest judgement.
    """

    memory: Memory
    surface: float
    surface_error: float
    in_contact: bool

    def __init__(
        self,
        *,
        surface: float | None = None,
        force_offset: float | None = None,
        offset_error: float = 0.0,
        contact_floor: float = CONTACT_FLOOR,
        sensor_lag: float = 0.0,
    ) -> None:
        require("offset_error", offset_error, at_least=0.0)
        require("contact_floor", contact_floor, above=0.0)
        require("sensor_lag", sensor_lag, at_least=0.0, at_most=LONGEST_LAG)
        given = {} if surface is None else {"surface": surface, "surface_error": 0.0, "surface_given": True}
        if force_offset is not None:
            given |= {"offset": force_offset, "zero": force_offset, "offset_error": offset_error}
        super().__init__(Conditioning.new(lag=sensor_lag, floor=contact_floor, **given))
        expect_zero(self.records[0])
        self.memory = self.records, np.zeros((5, FIRST_CAPACITY))
        self._take, self._shift = take.entry, shift.entry
        self.lose_surface()  # none is known yet: so that it is compiled before any loop

    @property
    def force_offset(self) -> float:
        """Force in free air at the newest sample [N]."""
        return self.zero  # type: ignore[no-any-return]

    def make_room(self) -> None:
        """Take rings of twice the length where 50 ms hold more samples than before."""
        if not is_full(self.memory):
            return
        (state,), rings = self.memory
        grown = np.zeros((5, 2 * rings.shape[1]))
        grown[:2, : rings.shape[1]] = np.roll(rings[:2], -state.quiet.first, axis=1)
        grown[2:, : rings.shape[1]] = np.roll(rings[2:], -state.late.first, axis=1)
        state.quiet.first = state.late.first = 0
        self.memory = self.records, grown

    def lose_surface(self) -> None:
        """Look for the surface again: the material has gone. One that was given stays."""
        lose_surface(self.memory)

    def shift(self, change: float) -> None:
        """Shift the surface with a material that moved by this [m], positive if deeper; a given surface stays."""
        self._shift(self.memory, change)

    def update(self, time: float, position: float, force: float, velocity: float | None = None) -> ContactSample:
        """Take one sample; a sample that is not finite is answered with "no contact" and changes nothing."""
        known = velocity is not None
        result = self._take(self.memory, time, position, force, 0.0 if velocity is None else velocity, known)
        depth, velocity, force, touching, full = result
        if full:
            self.make_room()
        return ContactSample(time, depth, velocity, force, touching)
