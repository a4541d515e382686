"""What a follower robot is, along a line and in space: one exchange a sample period, places in, sensors out.

A robot that is moved from elsewhere, with a pendant, by hand, by a program of its own, is one too.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar


class RobotSample(NamedTuple):
    """What the robot's sensors show after one sample period. Positions are of the probe's tip along the approach.

    Attributes:
        position: Position from the encoders [m], growing into the material.
        sensor_force: As the sensor gives it [N], along the outward normal, positive in compression; its offset and
            the weight and inertia of the tool are in it (`RobotSpecification.tool_force`).
        acceleration: Acceleration of the tool along the approach [m/s^2], positive into the material, as an
            accelerometer beside the force sensor gives it, through the same low-pass: without it, a jerked tool is felt
            as contact.
        exact_force: The simulator's own contact force [N]; NaN on hardware.
        exact_position: The simulator's own position [m]; NaN on hardware.
        commanded_position: Position that the robot was commanded in the end [m], after its limits.
        clipped: Whether the force limit cut the command in this tick.
        effort: What the drive pushes the probe inwards with [N], net of gravity, by its own current; NaN where it does
            not say. It bears the force sensor out, or not.
        held: Whether the robot holds by itself, because it has met something on its way beside the probe.
    """

    position: float
    sensor_force: float
    acceleration: float
    exact_force: float
    exact_position: float
    commanded_position: float
    clipped: bool
    effort: float = math.nan
    held: bool = False


@dataclass(frozen=True, slots=True)
class RobotSpecification:
    """What there is to know about a robot before it moves.

    Attributes:
        sample_period: Time of one exchange [s].
        force_limit: The contact force that the robot holds in the end, at most [N].
        encoder_resolution: Step of the encoders at the tip [m].
        encoder_noise: Standard deviation of the encoders before rounding [m].
        tool_mass: Mass beyond the force sensor [kg].
        gravity: Gravity along the approach [m/s^2], positive where it pulls the tool into the material.
        sensor_noise: Standard deviation of the force sensor [N].
        accelerometer_noise: Standard deviation of the accelerometer [m/s^2].
        sensor_bandwidth: Cut-off of the first-order low-pass of both [Hz].
        workspace: Smallest and largest position of the tip [m].
        simulated: Whether nothing can be hurt: a real robot's first touches are guarded by default.
        moved_mass: Mass that moves with the tip along the approach [kg] and makes its impacts.
        sensor_range: The force sensor shows at most this, either way [N]; infinite where it is not known.
        largest_offset: With nothing on it, and its tool weighed out, the force sensor shows at most this [N]. More is
            contact, whatever is learnt of the offset; infinite where it is not known: then a follower that begins in
            contact takes that for the offset.
        contact_floor: While the robot moves, friction and the like show at most this as a force [N]: less is no
            contact.
    """

    sample_period: float
    force_limit: float
    encoder_resolution: float
    encoder_noise: float
    tool_mass: float
    gravity: float
    sensor_noise: float
    accelerometer_noise: float
    sensor_bandwidth: float
    workspace: tuple[float, float]
    simulated: bool = False
    sensor_range: float = math.inf
    moved_mass: float = 0.4
    largest_offset: float = 1.0
    contact_floor: float = 0.0

    def tool_force(self, acceleration: float) -> float:
        r"""Part of the sensor force that the tool's weight and inertia make [N].

        .. math:: F_{sensor} = F_{contact} + F_{offset} + m (\ddot p - g)

        A tool that hangs below its sensor pulls on it: at rest in free air this is -m g.

        Args:
            acceleration: Acceleration of the tip along the approach [m/s^2], positive into the material.
        """
        return self.tool_mass * (acceleration - self.gravity)


Vector: TypeAlias = tuple[float, float, float]
"""A vector in the world's frame, z up."""


class SpatialSample(NamedTuple):
    """What the robot's sensors show after one sample period. Places are of the probe's tip, or a sphere's centre.

    Attributes:
        place: Position from the encoders [m].
        force: Contact force on the probe [N] as its sensor gives it, less the tool's weight and inertia; its offset is
            in it.
        exact_force: The simulator's own contact force on the probe [N]; NaN on hardware.
        exact_place: The simulator's own place [m]; NaN on hardware.
        fixture: The simulator's own pose of what is touched, a place [m] and a rotation vector [rad]; empty on
            hardware.
        clipped: Whether a force limit cut the command in this tick.
        held: Whether the robot holds by itself, because it has met something on its way beside the probe.
        joints: Positions of its joints from the base on, as their encoders count them [rad], for pictures; empty where
            it has none, or does not say.
    """

    place: Vector
    force: Vector
    exact_force: Vector
    exact_place: Vector
    fixture: tuple[float, ...]
    clipped: bool
    held: bool = False
    joints: tuple[float, ...] = ()


Sample = TypeVar("Sample", RobotSample, SpatialSample)
Place = TypeVar("Place", float, Vector)


class AnyRobot(ABC, Generic[Place, Sample]):
    """A position-controlled follower with a force sensor at its probe, along a line or in space.

    Leaves may move simulated time or wait for real time; the caller does not see which.

    Attributes:
        specification: What there is to know about the robot.
    """

    specification: RobotSpecification

    @property
    def fresh(self) -> bool:
        """Whether no exchange has been yet, so that a simulated session can begin; True where a class does not say."""
        return True

    @property
    def says(self) -> str:
        """What a person should know of how the robot goes now, as a sentence without a full stop; "" for nothing.

        Asked for twice a second, by another thread than the one that exchanges.
        """
        return ""

    @abstractmethod
    def read(self) -> Sample:
        """What the sensors show now; no time passes and nothing moves."""

    @abstractmethod
    def exchange(self, desired_position: Place, /) -> Sample:
        """Give a command, let one sample period pass, and return what the sensors show then.

        Never raises on bad data.

        Args:
            desired_position: Where the tip should be now [m]; limited to the workspace. One that is not finite is
                left out: the one before holds.
        """

    def close(self) -> None:
        """Give back what the robot holds; a second call does nothing."""
        return None


class Robot(AnyRobot[float, RobotSample]):
    """A follower along a line."""


class SpatialRobot(AnyRobot[Vector, SpatialSample]):
    """A follower that moves its probe in three dimensions, with a force sensor of three axes.

    Attributes:
        specification: What there is to know about it; of the workspace, the lowest and highest place along each axis is
            `reach`, and the tool is weighed out already.
        reach: Lowest and highest place [m].
    """

    reach: tuple[Vector, Vector]


class Wrapped(Generic[Place, Sample]):
    """A robot with another inside, which changes what it is told or what it shows.

    Args:
        robot: The robot inside.

    Attributes:
        robot: The robot inside.
    """

    def __init__(self, robot: Any) -> None:
        self.robot: AnyRobot[Place, Sample] = robot
        self.specification = robot.specification
        self._exchanges = 0

    @property
    def fresh(self) -> bool:
        """Whether no exchange has been yet."""
        return self.robot.fresh

    @property
    def says(self) -> str:
        """See `AnyRobot.says`."""
        return self.robot.says

    def read(self) -> Sample:
        """What the sensors show now; no time passes and nothing moves."""
        return self.robot.read()

    def close(self) -> None:
        """Give back what the robot holds; a second call does nothing."""
        self.robot.close()


class WrappedRobot(Wrapped[float, RobotSample], Robot):
    """A robot along a line with another inside, which changes what it is told or what it shows."""


class WrappedSpatialRobot(Wrapped[Vector, SpatialSample], SpatialRobot):
    """The same in three dimensions."""

    def __init__(self, robot: SpatialRobot) -> None:
        super().__init__(robot)
        self.reach = robot.reach


class _Moved(Wrapped[Place, Sample]):
    """Moved by a motion of its own."""

    def __init__(self, robot: Any, position_at: Callable[[float], Place]) -> None:
        super().__init__(robot)
        self._position_at: Callable[[float], Place] = position_at

    def exchange(self, desired_position: Place) -> Sample:
        """Let one sample period pass and return what the sensors show then.

        Args:
            desired_position: Left out, whatever it is.
        """
        time = self._exchanges * self.specification.sample_period
        self._exchanges += 1
        return self.robot.exchange(self._position_at(time))


class MovedRobot(_Moved[float, RobotSample], WrappedRobot):
    """Any robot along a line, moved by a motion of its own; commands it leaves out.

    Its time is its own and begins at 0; an exchange is one sample period.

    Args:
        robot: Robot that moves.
        position_at: Position [m] that it is moved to at a time [s]; asked once for each exchange, in order.
    """


class MovedSpatialRobot(_Moved[Vector, SpatialSample], WrappedSpatialRobot):
    """The same in three dimensions, with the same arguments."""
