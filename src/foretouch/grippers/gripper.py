"""A gripper of one servo as a robot along a line: it presses what lies between its fingers."""

from __future__ import annotations

from typing import Any

from foretouch.grippers.servo import CURRENT_BASED_POSITION, Servo, servo_address
from foretouch.robot import AnyRobot, RobotSpecification
from foretouch.robot.drivers import ArmLink, ArmState, arm_robot

FRICTION, INERTIA = 0.018, 0.002
"""Friction [N m] and inertia [kg m^2] at the axis of an XL330-M288, as Rhoban's measurements have them (bam,
``params/xl330/m1.json``, MIT). An XL330-M077 has less of both."""

ACCELERATION = 1.0  # Of a finger that goes on and off [m/s^2]: its inertia is in the current, too
NOISE = 0.02  # Noise of the current [A]: an assumption, for `foretouch doctor` to check


class Gripper(ArmLink):
    """Its tip is the finger, and z is how far it is open [m]. What is gripped pushes it open, along +z.

    The force is minus what the motor's current pushes with. Friction and inertia of the gears are in it, either way, so
    less than about a newton is no contact.

    Args:
        servo: Of the finger, in the mode `CURRENT_BASED_POSITION`.
    """

    def __init__(self, servo: Servo) -> None:
        self.name, self._servo = servo.name, servo
        self.reach = ((0.0, 0.0, 0.0), (0.0, 0.0, servo.width))
        friction, mass = FRICTION / servo.lever, INERTIA / servo.lever**2
        noise = NOISE * servo.force_per_ampere
        self.specification = RobotSpecification(
            sample_period=servo.period,
            force_limit=servo.force_limit,
            encoder_resolution=servo.count,
            encoder_noise=0.0,
            tool_mass=0.0,
            gravity=0.0,
            sensor_noise=noise,
            accelerometer_noise=0.0,
            sensor_bandwidth=100.0,
            workspace=(0.0, servo.width),
            sensor_range=servo.force_limit,
            moved_mass=mass,
            largest_offset=friction + noise,
            contact_floor=2.0 * friction + mass * ACCELERATION,  # where it turns around
        )

    def state(self) -> ArmState:
        """The newest state."""
        at = self._servo.state
        if self._servo.why:
            raise ConnectionError(self._servo.why)
        angle = at.opening / self._servo.lever
        return ArmState(at.measured_ns, (0.0, 0.0, at.opening), (0.0, 0.0, -at.force), (angle,), at.refuses)

    def command(self, place: tuple[float, float, float]) -> None:
        """Take how far it is to be open."""
        self._servo.go(place[2])

    def close(self) -> None:
        """Let go, and give back the port."""
        self._servo.close()


def make_gripper(settings: Any) -> AnyRobot[Any, Any]:
    """The robot ``dynamixel@PORT,lever=0.06`` of the settings.

    Raises:
        SettingError: An address that is none, or a scene: a gripper moves along a line.
        MissingExtraError: ``dynamixel-sdk`` is not installed.
        InputError: See `Servo`.
    """
    return arm_robot(Gripper(Servo(servo_address("robot", settings), CURRENT_BASED_POSITION)), in_space=False)
