"""Machines that count positions otherwise than the session does, translated at the edge."""

from __future__ import annotations

from dataclasses import replace

from foretouch.devices import BrowserOperator, Device, DeviceSpecification, Hand
from foretouch.quantities import Frame
from foretouch.robot import Robot, RobotSample, WrappedRobot


def inverse(frame: Frame) -> Frame:
    """The session's frame as seen from the machine's: `inside` of one is `outside` of the other."""
    return Frame(-frame.direction * frame.origin, frame.direction)


def framed_device(device: Device, frame: Frame) -> Device:
    """The device as the session sees it; itself where both count alike."""
    return device if frame == Frame() else FramedDevice(device, frame)


def framed_robot(robot: Robot, frame: Frame) -> Robot:
    """The robot as the session sees it; itself where both count alike."""
    return robot if frame == Frame() else FramedRobot(robot, frame)


def browser_operator(device: Device) -> BrowserOperator | None:
    """The operator at a mouse behind a device, if one moves it. Handles count as the session does."""
    device = device_inside(device)
    return device if isinstance(device, BrowserOperator) else None


def device_inside(device: Device) -> Device:
    """The device that moves the hand, without the frame and the simulated hand about it."""
    while True:
        if isinstance(device, Hand):
            device = device.intention_device
        elif isinstance(device, FramedDevice):
            device = device.device
        else:
            return device


class FramedDevice(Device):
    """A device whose positions are translated; forces are not, for they push the hand out on either side."""

    def __init__(self, device: Device, frame: Frame) -> None:
        self.device, self._frame = device, frame
        self.name, self.closed_loop = device.name, device.closed_loop  # type: ignore[misc]  # the device's own

    @property
    def specification(self) -> DeviceSpecification | None:
        """Specification of the device; its lengths are the same in every frame."""
        return self.device.specification

    @property
    def intention(self) -> float:
        """Intended position of the hand [m]; NaN where it is unknown."""
        return self._frame.inside(self.device.intention)

    @property
    def exact_position(self) -> float:
        """Position of the hand, without the encoder's rounding [m]; NaN where it is unknown."""
        return self._frame.inside(self.device.exact_position)

    @property
    def clutched(self) -> bool:
        """Whether the operator holds the clutch."""
        return self.device.clutched

    @property
    def fresh(self) -> bool:
        """Whether nothing was read yet."""
        return self.device.fresh

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]."""
        return self._frame.inside(self.device.read(now_ns))

    def render(self, force: float) -> float:
        """Give the hand a force [N], positive where it pushes the hand out."""
        return self.device.render(force)


class FramedRobot(WrappedRobot):
    """A robot whose positions, accelerations, gravity and workspace are translated.

    Forces are along the outward normal and positive in compression, whichever way the robot counts.
    """

    def __init__(self, robot: Robot, frame: Frame) -> None:
        super().__init__(robot)
        self.frame, own = frame, robot.specification
        low, high = sorted(map(frame.inside, own.workspace))
        self.specification = replace(own, workspace=(low, high), gravity=frame.direction * own.gravity)

    def read(self) -> RobotSample:
        """Present sample of the sensors."""
        return self._inside(self.robot.read())

    def exchange(self, desired_position: float) -> RobotSample:
        """Give a command [m], let one sample period pass, and return the sample then."""
        return self._inside(self.robot.exchange(self.frame.outside(desired_position)))

    def _inside(self, sample: RobotSample) -> RobotSample:
        inside = self.frame.inside
        return sample._replace(
            position=inside(sample.position),
            acceleration=self.frame.direction * sample.acceleration,
            exact_position=inside(sample.exact_position),
            commanded_position=inside(sample.commanded_position),
        )
