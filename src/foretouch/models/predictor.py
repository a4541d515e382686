"""The newest contact model at the operator's own motion: what leader and offline prediction both run."""

from __future__ import annotations

import math

from foretouch.models.contact_model import NO_STATE, ContactModel, ContactState, advance
from foretouch.models.motion import MotionFilter

__all__ = ["Predictor"]


class Predictor:
    """Predicts the contact force of one motion from models that arrive now and then.

    Nothing but motion and models goes in: no force, so no force can come out late.

    Attributes:
        model: The newest model, None before the first and while none is valid.
        surface: Its surface [m].
        velocity: Of the motion [m/s].
        force: Predicted at the newest sample [N].
        standard_deviation: Of that force [N], NaN where the model carries no doubt.
        jump: Force at the newest sample less the force there of the model before, had it been kept [N]; no model counts
            as no force. 0 at every sample but the first that predicts after `adopt`.
    """

    __slots__ = (
        "_former",
        "_motion",
        "_state",
        "_time",
        "force",
        "jump",
        "model",
        "standard_deviation",
        "surface",
        "velocity",
    )

    def __init__(self) -> None:
        self._motion = MotionFilter()
        self._state: ContactState = NO_STATE
        self._time = math.nan
        self._former: tuple[ContactModel | None, ContactState, float] | None = None  # what predicted before `adopt`
        self.model: ContactModel | None = None
        self.surface = 0.0
        self.velocity = 0.0
        self.force = 0.0
        self.standard_deviation = math.nan
        self.jump = 0.0

    def adopt(self, model: ContactModel | None, surface: float, state: ContactState = NO_STATE) -> None:
        """Predict from this model from now on; None means that no model is valid, and the force is zero."""
        if self._former is None:
            self._former = (self.model, self._state, self.surface)
        self.model = model
        self.surface = surface
        self._state = state

    def update(self, time: float, position: float, velocity: float | None = None) -> float:
        """Predict the force at one sample of the motion.

        Args:
            time: Of the sample [s].
            position: [m], in the frame of the surface.
            velocity: Measured velocity [m/s]; None estimates it causally from the positions.

        Returns:
            The predicted force [N]: finite, never negative, 0 without a model or outside the surface.
        """
        period = time - self._time
        self._time = time
        self.velocity = self._motion.update(time, position) if velocity is None else velocity
        self.jump = 0.0
        if not period > 0.0:
            self.force, self.standard_deviation = 0.0, math.nan
            return 0.0
        former, self._former = self._former, None
        if former == (self.model, self._state, self.surface):
            former = None  # nothing changed: not worth a second run
        self._state, self.force, self.standard_deviation = _run(
            self.model, self._state, position - self.surface, self.velocity, period
        )
        if former is not None:
            model, state, surface = former
            self.jump = self.force - _run(model, state, position - surface, self.velocity, period)[1]
        return self.force


def _run(
    model: ContactModel | None, state: ContactState, depth: float, velocity: float, period: float
) -> tuple[ContactState, float, float]:
    """`advance`; no model gives no force."""
    return (state, 0.0, math.nan) if model is None else advance(model, state, depth, velocity, period)
