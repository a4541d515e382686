"""From where an arm knows the contact force at its tip, a file for each way."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from foretouch.robot.arms.sensing.current import CurrentForce
from foretouch.robot.arms.sensing.tip_contact import TipContact
from foretouch.robot.arms.sensing.wrist import WristForce

Array = NDArray[np.float64]


class Sensing(Protocol):
    """How the contact force is known; made of a body and of the seed of its noise.

    Attributes:
        noise: Standard deviation of the force, on each axis [N].
        bandwidth: Cut-off [Hz].
        range: Largest force that it shows [N].
        largest_offset: Largest force that it shows with nothing on the probe [N].
        contact_floor: Largest force that it shows there while the arm moves, beside its offset [N].
        contact: Where on the tool the newest force acts; None where only a force is known.
        beside_tip: Whether something else of the tool than its tip touches.
    """

    noise: float
    bandwidth: float
    range: float
    largest_offset: float
    contact_floor: float
    contact: TipContact | None
    beside_tip: bool

    @property
    def force(self) -> Array:
        """As it was read last, on the probe, in the scene's frame [N], shape (3,)."""

    def step(self) -> None:
        """Behind a physics step: take what the sensors feel."""

    def positions(self, counted: Array) -> Array:
        """The joints as they are shown [rad], as late as the force, of those that the encoders count now."""

    def read(self) -> Array:
        """The force as it is shown at the end of a period [N]."""


SENSINGS: dict[str, Any] = {"wrist": WristForce, "current": CurrentForce}
