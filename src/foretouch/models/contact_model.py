"""What a contact model is: frozen numbers, a state, and one step."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]

LARGEST_DEPTH = 1.0  # Depths beyond this [m], on either side, count as this: no law is asked for forces that overflow
LARGEST_SPEED = 10.0  # Velocities beyond this [m/s] count as this
TICK = 1e-3  # Sample period where one is asked for and none passes [s]
SPEED_STEP = 2e-3  # Local damping is the slope over twice this [m/s]

EXIT_SPEED, SLICES = 0.05, 16
"""Speed [m/s] and slices of the path back to the surface, on which energy comes back."""

SLICES_BEYOND, SLICE_BEYOND = 20, 2.5e-4
"""Slices of the way beyond the surface, as long as there is a force, and the length of one [m]."""

ContactState: TypeAlias = tuple[float, ...]
"""What the material remembers (hysteresis, relaxation), as plain numbers; empty for the paper's laws."""

Advanced: TypeAlias = tuple[ContactState, float, float]
"""State after a sample, force [N], and its standard deviation [N], NaN where the model has none: see `advance`."""

NO_STATE: ContactState = ()
"""State of a law without memory."""


class ContactModel(ABC):
    """A contact law with its numbers. Leaves are frozen dataclasses whose fields are the parameters.

    Attributes:
        law: Name of the law, unique.
        parameter_names: Names of the parameters, in the order of `parameters`; a law without does not cross the wire.
    """

    __slots__ = ()
    law: ClassVar[str]
    parameter_names: ClassVar[tuple[str, ...]] = ()

    @property
    def parameters(self) -> tuple[float, ...]:
        """The law's numbers in the order of `parameter_names`, units as the leaf's docstring says."""
        return tuple(getattr(self, name) for name in self.parameter_names)

    def initial_state(self) -> ContactState:
        """State of a material that has not been touched."""
        return NO_STATE

    def remember(self, state: ContactState, depth: Array, sample_period: Array) -> ContactState:
        """State after a segment of motion, where motion alone determines it; laws without memory return it as it is.

        Args:
            state: Before the first sample.
            depth: [m], shape (n,).
            sample_period: Time since the sample before, for each [s], shape (n,).
        """
        return state

    def local_slopes(self, state: ContactState, depth: float, velocity: float, reach: float) -> tuple[float, float]:
        r"""Local stiffness and damping, as finite differences.

        .. math:: K = \max_\pm \frac{|F(x \pm h, \dot x) - F(x, \dot x)|}{h}, \quad
            B = \frac{F(x, \dot x + u) - F(x, \dot x - u)}{2 u}

        Args:
            state: What the material remembers now.
            depth: x [m].
            velocity: [m/s].
            reach: h [m], positive: as far as the probe gets before it is asked again.

        Returns:
            K [N/m] and B [N s/m], u = 2 mm/s.
        """
        here = self.advance(state, depth, velocity, TICK)[1]
        deeper = self.advance(state, depth + reach, velocity, TICK)[1]
        shallower = self.advance(state, depth - reach, velocity, TICK)[1]
        faster = self.advance(state, depth, velocity + SPEED_STEP, TICK)[1]
        slower = self.advance(state, depth, velocity - SPEED_STEP, TICK)[1]
        return max(abs(deeper - here), abs(here - shallower)) / reach, (faster - slower) / (2.0 * SPEED_STEP)

    def leaving_work(
        self, state: ContactState, depth: float, offset: float = 0.0, largest: float = math.inf
    ) -> tuple[float, float]:
        r"""Energy that the material gives back on the straight path back to the surface, and how long that path is.

        .. math:: W = \int_{-\infty}^x \max(\min(F(\xi, 0), L) + o,\; 0)\, d\xi

        Damping takes nothing of it, for nobody knows how slowly the probe will leave; what the material remembers
        passes as at 50 mm/s. A force that reaches beyond the surface is followed out for 5 mm.

        Args:
            state: What the material remembers now.
            depth: x [m].
            offset: o, a constant beside the force [N].
            largest: L, where more than that is not rendered [N].

        Returns:
            W [J], by the trapezoidal rule in 16 slices to the surface and 20 beyond it, and the way [m].
        """
        before = max(min(self.advance(state, depth, 0.0, TICK)[1], largest) + offset, 0.0)
        energy = way = 0.0
        for beyond, (count, length) in enumerate(((SLICES, max(depth, 0.0) / SLICES), (SLICES_BEYOND, SLICE_BEYOND))):
            for _ in range(count):
                if not length > 0.0 or (beyond and not before > 0.0):
                    break
                depth -= length
                state, force, _ = self.advance(state, depth, 0.0, length / EXIT_SPEED)
                after = max(min(force, largest) + offset, 0.0)
                energy += 0.5 * (before + after) * length
                way += length
                before = after
        return energy, way

    @abstractmethod
    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `advance`."""


def advance(model: ContactModel, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
    """Advance a contact model by one sample; follower and leader both call this and nothing else.

    Args:
        model: The law with its numbers.
        state: What the material remembers before this sample.
        depth: Penetration depth x [m], positive inside the surface; bounded to 1 m, and outside where it is no number.
        velocity: Penetration velocity [m/s], positive while deepening; bounded to 10 m/s, 0 where it is no number.
        sample_period: Time since the sample before [s], positive.

    Returns:
        The state after this sample; the force on the probe along the outward normal [N], finite, never negative,
        zero outside, both but for what pulls; and its standard deviation [N], NaN where the model
        has none.
    """
    if not (-LARGEST_DEPTH <= depth <= LARGEST_DEPTH and -LARGEST_SPEED <= velocity <= LARGEST_SPEED):
        depth = -LARGEST_DEPTH if math.isnan(depth) else min(max(depth, -LARGEST_DEPTH), LARGEST_DEPTH)
        velocity = 0.0 if math.isnan(velocity) else min(max(velocity, -LARGEST_SPEED), LARGEST_SPEED)
    return model.advance(state, depth, velocity, sample_period)
