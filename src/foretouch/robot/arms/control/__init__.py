"""How an arm's joints are driven from command to command, a file for each way, and the way of the tip between two.

They are compiled, and loaded where an arm is made: Numba is slow to import.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from foretouch.robot.robot import Vector

if TYPE_CHECKING:
    from foretouch.robot.arms.control.links import LinkWatch

Array = NDArray[np.float64]


class Control(Protocol):
    """How the joints of an arm are driven.

    Attributes:
        commanded: What the joints are told: torques [N m] of an impedance, speeds [rad/s] of a servo.
        links: Notices what the links meet.
    """

    commanded: Array
    links: LinkWatch

    def begin(self, place: Vector, force: Array, beside_tip: bool) -> None:
        """Begin a period of the controller.

        Args:
            place: Where the tip is commanded to be, in the scene [m].
            force: Measured contact force [N], shape (3,).
            beside_tip: Whether something else of the tool than its tip touches.
        """

    def turn(self, rotation: Array) -> None:
        """Hold the tool turned from its orientation at home by a rotation matrix in the scene's axes, shape (3, 3)."""

    def torques(self) -> Array:
        """The motors' torques for the next physics step [N m], shape (n,)."""
