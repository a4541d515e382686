"""The newest contact model at the operator's own motion: what leader and offline prediction both run."""

from __future__ import annotations

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
    """

    __slots__ = ("_motion", "_state", "_time", "force", "model", "standard_deviation", "surface", "velocity")

    def __init__(self) -> None:
        self._motion = MotionFilter()
        self._state: ContactState = NO_STATE
        self._time = float("nan")
        self.model: ContactModel | None = None
        self.surface = 0.0
        self.velocity = 0.0
        self.force = 0.0
        self.standard_deviation = float("nan")

    def adopt(self, model: ContactModel | None, surface: float, state: ContactState = NO_STATE) -> None:
        """Predict from this model from now on; None means that no model is valid, and the force is zero."""
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
        if self.model is None or not period > 0.0:
            self.force = 0.0
            return 0.0
        self._state, self.force, self.standard_deviation = advance(
            self.model, self._state, position - self.surface, self.velocity, period
        )
        return self.force
