"""The newest contact model at the operator's own motion, which leader and offline prediction both run.

Velocity and acceleration are taken from positions causally, the same at both ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.models.contact_model import LARGEST_DEPTH, LARGEST_SPEED, NO_STATE, ContactModel, ContactState, advance
from foretouch.quantities import brief_number, brief_text

VELOCITY_CUTOFF = 80.0
"""Cut-off of the velocity low-pass [Hz]: a 5 um encoder at 1 kHz leaves 0.5 mm/s of noise, and it lags by 2 ms."""

ACCELERATION_CUTOFF = 40.0  # Cut-off of the acceleration low-pass [Hz]


class MotionFilter:
    r"""Differences of position through first-order low-passes that allow for uneven sample times.

    .. math::
        v_k = v_{k-1} + \left(1 - e^{-2 \pi f_c T}\right)\left(\frac{x_k - x_{k-1}}{T} - v_{k-1}\right)

    and the same once more, with its own cut-off, from velocity to acceleration. Positions themselves are not
    filtered: that would smear impacts.

    Args:
        velocity_cutoff: f_c of the velocity [Hz], positive.
        acceleration_cutoff: f_c of the acceleration [Hz], positive.

    Attributes:
        velocity: Newest estimate [m/s]; 0 before the second sample.
        acceleration: Newest estimate [m/s^2]; 0 before the second sample.
    """

    __slots__ = ("_acceleration_rate", "_position", "_time", "_velocity_rate", "acceleration", "velocity")

    def __init__(
        self, velocity_cutoff: float = VELOCITY_CUTOFF, acceleration_cutoff: float = ACCELERATION_CUTOFF
    ) -> None:
        require("velocity_cutoff", velocity_cutoff, above=0.0)
        require("acceleration_cutoff", acceleration_cutoff, above=0.0)
        self._velocity_rate = 2.0 * math.pi * velocity_cutoff
        self._acceleration_rate = 2.0 * math.pi * acceleration_cutoff
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._time = math.nan
        self._position = math.nan
        self.velocity = 0.0
        self.acceleration = 0.0

    def shift(self, distance: float) -> None:
        """Shift the origin of positions: the point at x is from now on at x plus this distance [m]; nothing moved."""
        self._position += distance

    def update(self, time: float, position: float) -> float:
        """Take one sample and return the velocity [m/s].

        A sample that is not finite, or not later than the one before, is left out.
        """
        period = time - self._time
        if not period > 0.0 or not math.isfinite(position):
            if math.isnan(self._time) and math.isfinite(position) and math.isfinite(time):
                self._time, self._position = time, position
            return self.velocity
        before, acceleration = self.velocity, self.acceleration
        slope = (position - self._position) / period
        velocity = before + (1.0 - math.exp(-self._velocity_rate * period)) * (slope - before)
        change = (velocity - before) / period
        self.acceleration = acceleration + (1.0 - math.exp(-self._acceleration_rate * period)) * (change - acceleration)
        self.velocity, self._time, self._position = velocity, time, position
        return velocity

    def run(self, time: Iterable[float], position: Iterable[float]) -> NDArray[np.float64]:
        """Velocities [m/s] of a whole recording, sample by sample."""
        return np.array([self.update(t, x) for t, x in zip(time, position, strict=True)])


HISTORY = 8192  # Number of samples of its own motion that a predictor keeps

STATE_TOLERANCE = 2e-4
"""Largest difference at which an arriving state is taken for the predictor's own at that sample [m]: the robot is never
exactly where the operator was, and every state of the laws is a position."""

SLICE = 1000  # Number of samples of past motion that are run again in one tick, so that it stays short


_Arrived: TypeAlias = tuple[ContactModel, float, ContactState, int, int]
"""A model, its surface, its state after the sample of this number, and the number of its message."""


class Predictor:
    """Predicts the contact force of one motion from models that arrive now and then.

    Its only inputs are motion and models: no force goes in, so no force can come out late.

    A model comes with the state of the material at a past sample of the motion. From there on the state follows from
    the motion alone; so where that state equals the predictor's own at that sample, the predictor's present state is
    kept, and otherwise the motion since then is run again from it, in slices, while the former model predicts. A model
    that comes meanwhile waits, the newest only: given up for each newer one, a long run would never end.

    Attributes:
        model: The newest model, None before the first and while none is valid.
        surface: Surface of that model [m].
        velocity: Velocity of the motion [m/s].
        force: Force predicted at the newest sample [N].
        standard_deviation: Standard deviation of that force [N], NaN where the model has none.
        jump: Force at the newest sample less that of the former model, had it been kept [N]; no model counts as no
            force. 0 at every sample but the first that predicts with another model.
        position: Position of the newest sample [m]; 0 before the first.
        depth: Depth of the newest sample below the surface [m], within the bounds of `advance`.
        ticks: Number of samples; the first has number 1.
        message: Number that the caller gave to the model, 0 before the first.
    """

    __slots__ = (
        "_former",
        "_motion",
        "_newest",
        "_periods",
        "_positions",
        "_sliced",
        "_state",
        "_states",
        "_time",
        "_waiting",
        "depth",
        "force",
        "jump",
        "message",
        "model",
        "position",
        "standard_deviation",
        "surface",
        "ticks",
        "velocity",
    )

    def __init__(self) -> None:
        self._motion = MotionFilter()
        self._positions = np.zeros(HISTORY)
        self._periods = np.zeros(HISTORY)
        self._states: list[ContactState] = [NO_STATE] * HISTORY
        self._state: ContactState = NO_STATE
        self._time = math.nan
        self._former: tuple[ContactModel | None, ContactState, float] | None = None  # the model that predicted before
        self._waiting: _Arrived | None = None  # the model whose motion is being run again
        self._sliced = False  # whether a slice was run in this tick
        self._newest: _Arrived | None = None  # the model that came meanwhile
        self.model: ContactModel | None = None
        self.surface = 0.0
        self.position = 0.0
        self.depth = 0.0
        self.velocity = 0.0
        self.force = 0.0
        self.standard_deviation = math.nan
        self.jump = 0.0
        self.ticks = 0
        self.message = 0

    def __repr__(self) -> str:
        """Law, and its force at the newest sample."""
        law = None if self.model is None else self.model.law
        now = {name: brief_number(getattr(self, name)) for name in ("surface", "position", "force")}
        return brief_text("Predictor", {"law": law, "ticks": self.ticks, **now}.items())

    def adopt(
        self,
        model: ContactModel | None,
        surface: float,
        state: ContactState = NO_STATE,
        tick: int | None = None,
        message: int = 0,
    ) -> None:
        """Predict from this model from now on.

        Args:
            model: None means that no model is valid, and the force is zero.
            surface: Surface of the model [m].
            state: State of the material after the sample `tick`.
            tick: Number of that sample; None for the newest.
            message: Number that identifies the model.
        """
        if model is None or not state:
            self._waiting = self._newest = None
            self._begin(model, surface, state, message)
            return
        tick = self.ticks if tick is None else min(tick, self.ticks)
        own = self._states[tick % HISTORY] if tick > self.ticks - HISTORY else NO_STATE
        if len(own) == len(state) == len(self._state) and _alike(own, state):
            self._waiting = self._newest = None
            self._begin(model, surface, self._state, message)
            return
        arrived = (model, surface, state, tick, message)
        if self._waiting is not None:
            self._newest = arrived
            return
        self._waiting = arrived
        self._run_slice()

    def catch_up(self) -> None:
        """Run a slice of past motion for the model that waits; where it was not called, `update` does so.

        A caller that must know which model will predict at a position, before it sends the position, calls this first.
        """
        if self._waiting is not None and not self._sliced:
            self._sliced = True
            self._run_slice()

    def disown(self) -> None:
        """Forget the sender of the models: none waits any more, and the one that predicts goes on without a number."""
        self._waiting = self._newest = None
        self.message = 0

    def shift(self, distance: float) -> None:
        """Shift the motion from now on inwards by a distance [m], as a jump and not as motion.

        The velocity does not see it; the force does. A model that was adopted since the last sample is compared, for
        `jump`, with the former one at the position that this one would have had.
        """
        self._motion.shift(distance)
        if self._former is not None:
            model, state, surface = self._former
            self._former = (model, state, surface + distance)

    def local_slopes(self, reach: float) -> tuple[float, float]:
        """Local stiffness [N/m] and damping [N s/m] at the newest sample (`ContactModel.local_slopes`).

        Outside the surface, where there is no force, they are those at the surface, which is met next.
        """
        if self.model is None:
            return 0.0, 0.0
        velocity, depth = self.velocity, self.depth
        if not -LARGEST_SPEED <= velocity <= LARGEST_SPEED:
            velocity = min(max(velocity, -LARGEST_SPEED), LARGEST_SPEED)
        if depth < 0.0 and not self.force > 0.0:
            depth = 0.0
        return self.model.local_slopes(self._state, depth, velocity, reach)

    @property
    def state(self) -> ContactState:
        """What the material remembers at the newest sample."""
        return self._state

    def leaving_work(self, offset: float = 0.0, largest: float = math.inf) -> tuple[float, float]:
        """Work returned from the newest sample until leaving contact [J], and that distance [m] (`ContactModel`)."""
        return (0.0, 0.0) if self.model is None else self.model.leaving_work(self._state, self.depth, offset, largest)

    def update(self, time: float, position: float, velocity: float | None = None) -> float:
        """Predict the force at one sample of the motion.

        Args:
            time: Time of the sample [s].
            position: Position [m], in the frame of the surface.
            velocity: Measured velocity [m/s]; None estimates it causally from the positions.

        Returns:
            The predicted force [N]: finite, never negative, 0 without a model or outside the material.
        """
        if self._waiting is not None:
            self.catch_up()
        self._sliced = False
        period = time - self._time
        self._time = time
        self.ticks += 1
        if math.isfinite(position):
            self.position = position = float(position)
        else:  # no valid position: as before
            position = self.position
        index = self.ticks % HISTORY
        self._positions[index], self._periods[index] = position, period if period > 0.0 else 0.0  # the first has none
        self.velocity = velocity = self._motion.update(time, position) if velocity is None else velocity
        self.jump = 0.0
        depth = position - self.surface
        self.depth = depth if -LARGEST_DEPTH <= depth <= LARGEST_DEPTH else _bounded(depth)
        if not period > 0.0:
            self._states[index] = self._state
            self.force, self.standard_deviation = 0.0, math.nan
            return 0.0
        former, before = self._former, self._state
        state, force, self.standard_deviation = _run(self.model, before, depth, velocity, period)
        self._state = self._states[index] = state
        self.force = force
        if former is not None:
            self._former = None
            if former != (self.model, before, self.surface):  # if nothing changed it is not worth a second run
                model, before, surface = former
                self.jump = force - _run(model, before, position - surface, velocity, period)[1]
        return force

    def _begin(self, model: ContactModel | None, surface: float, state: ContactState, message: int) -> None:
        """Predict from a model in its present state."""
        if self._former is None:
            self._former = (self.model, self._state, self.surface)
        self.model, self.surface, self._state, self.message = model, surface, state, message
        self.depth = _bounded(self.position - surface)

    def _run_slice(self) -> None:
        """Run a slice of past motion through the memory of the model that waits; begin with it at the end."""
        assert self._waiting is not None
        model, surface, state, tick, message = self._waiting
        tick = max(tick, self.ticks - HISTORY)  # older samples are forgotten
        last = min(self.ticks, tick + SLICE)
        past = np.arange(tick + 1, last + 1) % HISTORY
        state = model.remember(state, self._positions[past] - surface, self._periods[past])
        if last < self.ticks:
            self._waiting = (model, surface, state, last, message)
            return
        self._begin(model, surface, state, message)
        self._waiting, self._newest = self._newest, None


def _bounded(depth: float) -> float:
    return min(max(depth, -LARGEST_DEPTH), LARGEST_DEPTH)


def _alike(own: ContactState, other: ContactState) -> bool:
    return all(abs(mine - theirs) <= STATE_TOLERANCE for mine, theirs in zip(own, other, strict=True))


def _run(
    model: ContactModel | None, state: ContactState, depth: float, velocity: float, period: float
) -> tuple[ContactState, float, float]:
    """Call `advance`; no model gives no force."""
    return (state, 0.0, math.nan) if model is None else advance(model, state, depth, velocity, period)
