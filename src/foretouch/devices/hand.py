"""A hand that holds a force-feedback device."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from foretouch.devices.device import Device, limit_force
from foretouch.devices.grips import Grip
from foretouch.devices.held_force import HeldForce
from foretouch.devices.specification import DeviceSpecification
from foretouch.errors import SettingError

__all__ = ["Hand"]

LONGEST_GAP = 1.0
"""A gap between two ticks counts as at most so long [s]: what lasts longer is no late tick."""


class Hand(Device):
    r"""A hand with mass, damping and stiffness holds a device; the rendered force moves both.

    .. math::

        (m_h + m_d) \ddot x = k (x_d - x) + b (\dot x_d - \dot x) - b_d \dot x - F_C \operatorname{sign} \dot x - f

    x grows into the material. x_d is where the hand wants to be: what another device, open loop, gives, in a straight
    line from tick to tick. f is the rendered force, held from one `render` to the next (sample and hold), a delay of
    the device later, and no longer than its watchdog lets it (`HeldForce`); a positive one pushes the
    hand out. At rest the device sticks, without any motion at all, until what pulls exceeds F_C. Between starts, stops
    and ticks the motion is solved by its power series, to all digits.

    The first `read` finds the hand at rest at its intention. A gap between ticks of more than 1 s counts as 1 s, with
    the whole way of the intention in it: the hand is simulated late, never in jerks.

    Args:
        intention: What the hand wants, an open-loop operator; its own `render` is not called.
        grip: How the hand holds the device, for example one of `GRIPS`.
        specification: The device.
        clutch: When the hand holds the clutch: (start, end) in seconds since the first `read`, start included, end not.

    Raises:
        SettingError: An intention that feels something itself, or a time of the clutch that is negative or ends before
            it starts.
    """

    closed_loop = True

    def __init__(
        self,
        intention: Device,
        grip: Grip,
        specification: DeviceSpecification,
        clutch: Sequence[tuple[float, float]] = (),
    ) -> None:
        if intention.closed_loop:
            raise SettingError("intention", intention.name, "must be an operator that feels nothing itself (open loop)")
        for start, end in clutch:
            if not 0.0 <= start < end < math.inf:
                raise SettingError("clutch", (start, end), "must be 0 <= start < end, in seconds from the first tick")
        # Imported here: it brings a compiler along, which open-loop operators do without.
        from foretouch.devices.hand_kernel import move

        self._move = move
        self._intention = intention
        self._grip = grip
        self._specification = specification
        self._clutch = tuple(clutch)
        self._constants = np.array(
            [
                grip.mass + specification.mass,
                grip.damping + specification.damping,
                grip.damping,
                grip.stiffness,
                specification.friction,
            ]
        )
        move(np.zeros(2), self._constants, 0.0, 0.0, 0.0, 1e-6)  # compiled here, not in the first tick
        self._state = np.zeros(2)
        self._aim = math.nan
        self._held = HeldForce(0.0, specification.delay, specification.watchdog)
        self._start_ns: int | None = None
        self._now_ns = 0

    @property
    def name(self) -> str:  # type: ignore[override]  # of the class elsewhere; a hand has its operator's
        """Name of the intention."""
        return self._intention.name

    @property
    def intention_device(self) -> Device:
        """The operator whose intention this hand has."""
        return self._intention

    @property
    def grip(self) -> Grip:
        """How the hand holds the device."""
        return self._grip

    @property
    def specification(self) -> DeviceSpecification:
        """The device that the hand holds."""
        return self._specification

    @property
    def intention(self) -> float:
        """Where the hand wants to be [m], at the newest `read`; NaN before the first."""
        return self._aim

    @property
    def exact_position(self) -> float:
        """Where the hand is [m] at the newest `read`, not rounded; NaN before the first."""
        return math.nan if self._start_ns is None else float(self._state[0])

    @property
    def exact_velocity(self) -> float:
        """Its velocity [m/s]."""
        return math.nan if self._start_ns is None else float(self._state[1])

    @property
    def clutched(self) -> bool:
        """Whether the hand holds the clutch at the newest `read`, by its own times or as the intention says."""
        if self._clutch and self._start_ns is not None:
            time = (self._now_ns - self._start_ns) * 1e-9
            if any(start <= time < end for start, end in self._clutch):
                return True
        return self._intention.clutched

    @property
    def fresh(self) -> bool:
        """Whether nothing was read yet."""
        return self._start_ns is None and self._intention.fresh

    def read(self, now_ns: int) -> float:
        """Position of the hand [m] as the encoder shows it, in whole counts."""
        aim = self._intention.read(now_ns)
        if self._start_ns is None:
            self._start_ns = self._now_ns = now_ns
            self._aim = self._state[0] = aim
        elif now_ns > self._now_ns:
            period = min((now_ns - self._now_ns) * 1e-9, LONGEST_GAP)
            speed = (aim - self._aim) / period
            for time, force in self._held.over(now_ns - round(period * 1e9), now_ns):
                self._move(self._state, self._constants, self._aim, speed, force, time)
                self._aim += speed * time
            self._aim, self._now_ns = aim, now_ns
        position = float(self._state[0])
        count = self._specification.resolution
        return count * math.floor(position / count + 0.5) if count > 0.0 else position

    def render(self, force: float) -> float:
        """Hold a force [N] from a delay after the newest `read` on; returns what is given, at most the limit."""
        given = limit_force(force, self._specification.force_limit)
        self._held.render(given, self._now_ns)
        return given
