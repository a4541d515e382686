"""A trigger on a servo as a device: the hand closes it, and the servo pushes it open with the force that is felt."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Callable
from typing import Any, ClassVar

from foretouch.devices import DeviceSpecification
from foretouch.devices.felt import FeltAlongAxis, HandleLink
from foretouch.devices.spatial import NOWHERE
from foretouch.errors import printable
from foretouch.grippers.servo import CURRENT_CONTROL, Servo, servo_address
from foretouch.plugins import Address
from foretouch.quantities.pose import Vector

TICK = 0.001  # Of a session [s]
SILENT, PERIODS = 0.02, 5.0  # Without a new position for so long [s], and so many exchanges, none is shown


def felt_over_bus(specification: DeviceSpecification, period: float) -> DeviceSpecification:
    r"""What a session of 1 kHz may count on of a device that is reached over a slower bus.

    A position that came in with one exchange is seen by the next tick of the session, up to T later; the force goes out
    with the next exchange, so at most :math:`T_b + T` after it was measured, acts after the device's own delay d, and
    stays for one exchange, so

    .. math:: K \le \frac{b - |B|}{T_b / 2 + T_b + T + d}

    (`DeviceSpecification.largest_stiffness`, with the bus's period in place of the session's). A session counts with
    its own period T and a delay of at most T. So it is told that, and a damping that gives no more for every B:

    .. math:: b' = b \frac{3 T / 2}{3 T_b / 2 + T + d} < b

    Args:
        specification: Of the device itself; its damping b [N s/m] and delay d [s].
        period: Of the bus, T_b [s], at least that of a session.
    """
    share = 1.5 * TICK / (1.5 * period + TICK + specification.delay)
    return dataclasses.replace(specification, damping=share * specification.damping, delay=TICK)


class Trigger(HandleLink):
    """A trigger on a servo in current control. Its z is how far it is open [m].

    A servo that has said nothing for 20 ms, or for five exchanges, shows no place; after 0.25 s it is lost, and gives
    no force until a new session.

    Args:
        address: Of the servo; see `Servo`.
        tell: Gets a line where the servo is lost.

    Attributes:
        servo: The servo.

    Raises:
        SettingError: An address that is none.
        MissingExtraError: ``dynamixel-sdk`` is not installed.
        InputError: See `Servo`.
    """

    def __init__(self, address: Address, tell: Callable[[str], object] = lambda line: None) -> None:
        self._lost, self._tell = False, tell
        self.servo = Servo(address, CURRENT_CONTROL, self._lose)
        self._silent_ns = round(1e9 * max(SILENT, PERIODS * self.servo.period))

    @property
    def lost(self) -> bool:
        """Whether the servo shows no place any more, and gives no force until it is opened anew."""
        return self._lost

    def place(self) -> Vector:
        """How far it is open; no numbers where the servo is silent or has let go."""
        state = self.servo.state
        if self._lost or state.refuses or time.monotonic_ns() - state.measured_ns > self._silent_ns:
            return NOWHERE
        return 0.0, 0.0, state.opening

    def push(self, force: Vector) -> bool:
        """Push it open with the force along z [N]."""
        self.servo.push(0.0 if self._lost else force[2])
        return not (self._lost or self.servo.why or self.servo.state.refuses)

    def close(self) -> None:
        """No torque, and the port is given back."""
        self.servo.close()

    def _lose(self, why: str) -> None:
        self._lost = True
        self._tell(
            f"dynamixel: lost {self.servo.name}: {why}. The hand gets no force and counts as not moved: end the "
            "session, and begin again when it is connected"
        )


class GripperHandle(FeltAlongAxis):
    """A trigger in the hand: closing it is in.

    Args:
        trigger: Its driver, opened.
        specification: What the device is; its damping says how stiff it may be rendered.
    """

    name: ClassVar[str] = "dynamixel"

    def __init__(self, trigger: Trigger, specification: DeviceSpecification) -> None:
        servo = trigger.servo
        limit = min(specification.force_limit, servo.force_limit)
        own = dataclasses.replace(specification, resolution=servo.count, force_limit=limit)
        super().__init__(trigger, felt_over_bus(own, servo.period))


def said_of_bus(specification: DeviceSpecification, period: float) -> str:
    """What the rate of a bus costs, for people.

    Args:
        specification: Of the device itself.
        period: Of its bus [s].
    """
    rates = {rate: felt_over_bus(specification, rate).largest_stiffness(TICK) for rate in (period, TICK)}
    return (
        f"dynamixel: {1.0 / period:.0f} exchanges a second: with {specification.damping:g} N s/m no more than "
        f"{rates[period]:.0f} N/m are felt, and {rates[TICK]:.0f} with 1,000"
    )


def make_handle(settings: Any, reach: Any) -> GripperHandle:
    """The device ``dynamixel@PORT,lever=0.06`` of a session.

    Args:
        settings: `foretouch.session.SessionSettings`.
        reach: How far the material is; not needed.

    Raises:
        SettingError: An address that is none, or a scene: a trigger moves along a line.
        MissingExtraError: ``dynamixel-sdk`` is not installed.
        InputError: See `Servo`.
    """
    trigger = Trigger(servo_address("operator", settings), lambda line: sys.stderr.write(f"{printable(line)}\n"))
    sys.stderr.write(f"{said_of_bus(settings.device, trigger.servo.period)}\n")
    return GripperHandle(trigger, settings.device)
