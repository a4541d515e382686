"""The newest contact model at the operator's own motion, which leader and offline prediction both run.

The velocity is taken from positions causally, the same at both ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.core.records import Held
from foretouch.errors.checks import require
from foretouch.models.contact_map.model import UNTOUCHED, ContactMapModel
from foretouch.models.contact_model import NO_STATE, Advanced, ContactModel, ContactState, advance
from foretouch.quantities import brief_number, brief_text

if TYPE_CHECKING:
    from foretouch.core import Kernel

VELOCITY_CUTOFF = 80.0
"""Cut-off of the velocity low-pass [Hz]: a 5 um encoder at 1 kHz leaves 0.5 mm/s of noise, and it lags by 2 ms."""


class MotionFilter(Held):
    r"""Differences of position through a first-order low-pass that allows for uneven sample times.

    .. math::
        v_k = v_{k-1} + \left(1 - e^{-2 \pi f_c T}\right)\left(\frac{x_k - x_{k-1}}{T} - v_{k-1}\right)

    Positions themselves are not filtered: that would smear impacts. Another one, of the velocity, is an acceleration.

    Args:
        velocity_cutoff: f_c [Hz], positive.

    Attributes:
        velocity: Newest estimate [m/s]; 0 before the second sample.
    """

    __slots__ = ()

    velocity: float

    def __init__(self, velocity_cutoff: float = VELOCITY_CUTOFF) -> None:
        require("velocity_cutoff", velocity_cutoff, above=0.0)
        super().__init__(_compiled().Motion.new(velocity_rate=2.0 * math.pi * velocity_cutoff))

    def reset(self) -> None:
        """Forget all samples."""
        self.time = self.position = math.nan
        self.velocity = 0.0

    def update(self, time: float, position: float) -> float:
        """Take one sample and return the velocity [m/s].

        A sample that is not finite, or not later than the one before, is left out.
        """
        return _compiled().move_entry.entry(self.records[0], time, position)  # type: ignore[no-any-return]

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


class Predictor(Held):
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
        "_foreign",
        "_former",
        "_models",
        "_newest",
        "_serial",
        "_sliced",
        "_state_outside",
        "_states_outside",
        "_update",
        "_waiting",
        "_waits",
        "model",
    )

    surface: float
    velocity: float
    force: float
    standard_deviation: float
    jump: float
    position: float
    depth: float
    ticks: int
    changed: int
    former_surface: float
    message: int
    serial: int

    def __init__(self) -> None:
        kernel = _compiled()
        super().__init__(kernel.Prediction.new())
        self._update = kernel.update.entry
        self._former: tuple[ContactModel | None, ContactState] = None, NO_STATE  # what predicted before
        self._foreign = False  # whether a law that is not compiled is asked at the next sample
        self._state_outside: ContactState = NO_STATE  # of its material
        self._states_outside: dict[int, ContactState] = {}  # and after each of the newest samples
        self._waiting: _Arrived | None = None  # a model of such a law whose motion is being run again
        self._sliced = -1  # the newest sample after which a slice was run for it
        self._newest: _Arrived | None = None  # the model of such a law that came meanwhile
        self._waits = False  # whether one that is compiled waits
        self._models: dict[int, ContactModel | None] = {}  # those by their serial numbers that may yet predict
        self._serial = 0  # of the newest
        self.model: ContactModel | None = None

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
        tick = self.ticks if tick is None else min(tick, self.ticks)
        if model is None or not _is_foreign(model):
            kernel = _compiled()
            self._waiting = self._newest = None
            self._serial += 1
            self._models[self._serial] = model
            usable, tick = (state, tick) if len(state) == len(UNTOUCHED) else (UNTOUCHED, tick if state else -1)
            form = kernel.law_kernel.form_of(model)
            self._take(kernel.adopt, *form, usable, surface, tick, message, self._serial)
            return
        self._waits = False
        _compiled().none_waits_entry.entry(self.records[0])
        if not state or self._agrees(state, tick):
            self._waiting = self._newest = None
            self._begin(model, surface, self._state_outside if state else state, message)
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
        if self._waits:
            self._take(_compiled().catch_up)
        elif self._waiting is not None and self._sliced != self.ticks:
            self._sliced = self.ticks
            self._run_slice()

    def change_place(self) -> None:
        """Let what the law's scale comes to at the next sample count as a change of the model, for `jump`."""
        if _compiled().keep_entry.entry(self.records):
            self._former = self.model, self._state_outside

    def disown(self) -> None:
        """Forget the sender of the models: none waits any more, and the one that predicts goes on without a number."""
        self._waiting = self._newest = None
        self._waits = False
        _compiled().disown_entry.entry(self.records[0])

    def shift(self, distance: float) -> None:
        """Shift the motion from now on inwards by a distance [m], as a jump and not as motion.

        The velocity does not see it; the force does. A model that was adopted since the last sample is compared, for
        `jump`, with the former one at the position that this one would have had.
        """
        _compiled().shift_entry.entry(self.records[0], distance)

    def local_slopes(self, reach: float) -> tuple[float, float]:
        """Local stiffness [N/m] and damping [N s/m] at the newest sample (`ContactModel.local_slopes`).

        Outside the surface, where there is no force, they are those at the surface, which is met next.
        """
        if self.model is None:
            return 0.0, 0.0
        if not self.foreign:
            return _compiled().slopes_entry.entry(self.records[0], reach)  # type: ignore[no-any-return]
        depth, velocity = _compiled().asked_at_entry.entry(self.records[0])
        stiffness, damping = self.model.local_slopes(self.state, depth, velocity, reach)
        return self.scale * stiffness, self.scale * damping

    def leaving_work(self, offset: float = 0.0, largest: float = math.inf) -> tuple[float, float]:
        """Work returned from the newest sample until leaving contact [J], and that distance [m] (`ContactModel`)."""
        if self.model is None:
            return 0.0, 0.0
        if not self.foreign:
            return _compiled().work_entry.entry(self.records[0], offset, largest)  # type: ignore[no-any-return]
        scale = self.scale
        work, way = self.model.leaving_work(self.state, self.depth, offset / scale, largest / scale)
        return scale * work, way

    def update(self, time: float, position: float, velocity: float | None = None) -> float:
        """Predict the force at one sample of the motion.

        Args:
            time: Time of the sample [s].
            position: Position [m], in the frame of the surface.
            velocity: Measured velocity [m/s]; None, or not a number, estimates it causally from the positions.

        Returns:
            The predicted force [N]: finite, 0 without a model or outside the material, negative where that pulls.
        """
        self.catch_up()
        velocity = math.nan if velocity is None else velocity
        return (self._update_outside if self.foreign else self._update)(self.records, time, position, velocity)

    @property
    def needs_python(self) -> bool:
        """Whether Python comes before the next sample: a law of its own, or past motion that is run again."""
        return self._foreign or self._waits or self._waiting is not None

    @property
    def scale(self) -> float:
        """Scale of the law's force at the place that is touched."""
        return float(self.records["law"]["scale"][0])

    @property
    def foreign(self) -> bool:
        """Whether a law that is not compiled is asked at the next sample; then another tick of rendering is used."""
        return self._foreign

    @property
    def state(self) -> ContactState:
        """What the material remembers at the newest sample, of the length that the law has."""
        if _is_foreign(self.model):
            return self._state_outside
        return tuple(self.records["memory"][0].tolist()) if isinstance(self.model, ContactMapModel) else NO_STATE

    def _take(self, adopting: Kernel[..., bool], *arguments: Any) -> None:
        """Call what may begin with a compiled model, and take note of it."""
        before, outside, first = self.model, self._state_outside, self.changed == 0
        self._waits = adopting.entry(self.records, *arguments)
        serial = self.serial
        if serial not in self._models:
            return
        self.model, self._state_outside = self._models.pop(serial), NO_STATE
        self._models = {later: model for later, model in self._models.items() if later > serial} if self._waits else {}
        if first:
            self._former = before, outside
        self._foreign = _is_foreign(self._former[0])

    def _agrees(self, state: ContactState, tick: int) -> bool:
        """Whether an arrived state is that of the present law's material after a sample; both are not compiled."""
        own = self._states_outside.get(tick, NO_STATE) if _is_foreign(self.model) else NO_STATE
        alike = all(abs(mine - theirs) <= STATE_TOLERANCE for mine, theirs in zip(own, state, strict=False))
        return alike and len(own) == len(state) == len(self._state_outside)

    def _update_outside(self, records: NDArray[np.void], time: float, position: float, velocity: float) -> float:
        """One sample where the model, or the one before it, is not compiled."""
        model, period = self.model, _compiled().observe_entry.entry(records[0], time, position, velocity)
        self._foreign = _is_foreign(model)
        if period > 0.0:
            state, force, deviation = _run(model, self.state, self.depth, self.velocity, period)
            self.force, self.standard_deviation = self.scale * force, self.scale * deviation
            if self.changed:
                (former, before), depth = self._former, self.position - self.former_surface
                before = before if _is_foreign(former) else tuple(records["former_memory"][0].tolist())
                felt = _run(former, before, depth, self.velocity, period)[1]
                self.jump, self.changed = self.force - float(records["former_law"]["scale"][0]) * felt, 0
            if self._foreign:
                self._state_outside = state
            elif state:
                records["memory"][0] = state
        if self._foreign:
            self._states_outside[self.ticks] = self._state_outside
            self._states_outside.pop(self.ticks - HISTORY, None)
        records["past"]["memories"][0, self.ticks % HISTORY] = records["memory"][0]
        return self.force

    def _begin(self, model: ContactModel | None, surface: float, state: ContactState, message: int) -> None:
        """Predict from a model that is not compiled, in its present state."""
        before, outside, first = self.model, self._state_outside, self.changed == 0
        kernel = _compiled()
        kernel.adopt.entry(self.records, *kernel.law_kernel.form_of(None), UNTOUCHED, surface, -1, message, 0)
        if first:
            self._former = before, outside
        self.model, self._state_outside, self._foreign, self._models = model, state, True, {}

    def _run_slice(self) -> None:
        """Run a slice of past motion through the memory of the model that waits; begin with it at the end."""
        assert self._waiting is not None
        model, surface, state, tick, message = self._waiting
        tick = max(tick, self.ticks - HISTORY)  # older samples are forgotten
        last = min(self.ticks, tick + SLICE)
        past = np.arange(tick + 1, last + 1) % HISTORY
        depths = self.records["past"]["positions"][0, past] - surface
        state = model.remember(state, depths, self.records["past"]["periods"][0, past])
        if last < self.ticks:
            self._waiting = (model, surface, state, last, message)
            return
        self._begin(model, surface, state, message)
        self._waiting, self._newest = self._newest, None


def _is_foreign(model: ContactModel | None) -> bool:
    """Whether a model's law is not compiled."""
    return model is not None and type(model) not in _compiled().law_kernel.KINDS


def _run(model: ContactModel | None, state: ContactState, depth: float, velocity: float, period: float) -> Advanced:
    """Call `advance`; no model gives no force."""
    return (state, 0.0, math.nan) if model is None else advance(model, state, depth, velocity, period)


@cache
def _compiled() -> ModuleType:
    """The compiled code, loaded when it is needed."""
    return import_module("foretouch.models.predictor_kernel")
