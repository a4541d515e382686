"""What a session is made of, along a line and in space; and machines that count positions otherwise than it does.

Those are translated at the edge. Nothing else asks whether a session has a scene: it asks `Line` or `Space`.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from foretouch.devices import (
    HARDWARE_OPERATORS,
    AnyDevice,
    BrowserOperator,
    Device,
    DeviceSpecification,
    Hand,
    SpatialBrowserOperator,
    SpatialDevice,
    SpatialHand,
)
from foretouch.errors import SettingError, UnknownNameError
from foretouch.quantities import Frame, SpatialFrame
from foretouch.quantities.pose import Vector
from foretouch.robot import (
    FaultySensor,
    FaultySpatialSensor,
    MovedRobot,
    MovedSpatialRobot,
    Robot,
    RobotSample,
    SpatialRobot,
    SpatialSample,
    WrappedRobot,
    WrappedSpatialRobot,
)
from foretouch.robot.robot import Wrapped
from foretouch.settings import DEFAULTS, MESH_ENDINGS, SCENE, SCENES, SETTINGS, UNKNOWN

POSE_NUMBERS = 6  # A place and a rotation vector


def unused_setting(settings: Any) -> SettingError | None:
    """The error of a setting that is of a scene where there is none, and that would change nothing; None for none.

    Settings do not refuse it themselves: what is of a line is warmed up with the settings of a scene, too. One that is
    given as it is by default cannot be told from one that is not.
    """
    texts = settings.as_text()
    unused = [name for name, one in SETTINGS.items() if one.group == SCENE and texts[name] != str(DEFAULTS[name])]
    if settings.scene or not unused:
        return None
    given = getattr(settings, unused[0])
    shown = given if isinstance(given, float) else texts[unused[0]]
    return SettingError(unused[0], shown, "is of a scene, and there is none: add --scene NAME")


def inverse(frame: Frame | SpatialFrame) -> Any:
    """The session's frame as seen from the machine's: `inside` of one is `outside` of the other."""
    return frame.inverse()


def framed_device(device: Any, frame: Frame | SpatialFrame) -> Any:
    """The device as the session sees it; itself where both count alike."""
    return device if frame == Frame() else FRAMED[type(frame)][0](device, frame)


def framed_robot(robot: Any, frame: Frame | SpatialFrame) -> Any:
    """The robot as the session sees it; itself where both count alike."""
    return robot if frame == Frame() else FRAMED[type(frame)][1](robot, frame)


def browser_operator(device: AnyDevice) -> Any:
    """The operator at a mouse behind a device, if one moves it. Handles count as the session does."""
    device = device_inside(device)
    return device if isinstance(device, BrowserOperator | SpatialBrowserOperator) else None


def device_inside(device: Any) -> AnyDevice:
    """The device that moves the hand, without the frame and the simulated hand about it."""
    while True:
        if isinstance(device, Hand | SpatialHand):
            device = device.intention_device
        elif isinstance(device, _Framed):
            device = device.device
        else:
            return device  # type: ignore[no-any-return]


class _Framed:
    """A device whose positions are translated, and in space its forces; along a line these push out on either side."""

    def __init__(self, device: Any, frame: Any) -> None:
        self.device, self._frame = device, frame
        self.name, self.closed_loop, self.real_time = device.name, device.closed_loop, device.real_time

    @property
    def specification(self) -> DeviceSpecification | None:
        """Specification of the device; its lengths are the same in every frame."""
        return self.device.specification  # type: ignore[no-any-return]

    @property
    def intention(self) -> Any:
        """Intended position of the hand [m]; NaN where it is unknown."""
        return self._frame.inside(self.device.intention)

    @property
    def exact_position(self) -> Any:
        """Position of the hand, without the encoder's rounding [m]; NaN where it is unknown."""
        return self._frame.inside(self.device.exact_position)

    @property
    def clutched(self) -> bool:
        """Whether the operator holds the clutch."""
        return bool(self.device.clutched)

    @property
    def fresh(self) -> bool:
        """Whether nothing was read yet."""
        return bool(self.device.fresh)

    def read(self, now_ns: int) -> Any:
        """Position of the hand [m]."""
        return self._frame.inside(self.device.read(now_ns))


class FramedDevice(_Framed, Device):
    """A device whose positions are translated; forces are not, for they push the hand out on either side."""

    def render(self, force: float) -> float:
        """Give the hand a force [N], positive where it pushes the hand out."""
        return float(self.device.render(force))


class FramedSpatialDevice(_Framed, SpatialDevice):
    """A device in space whose positions and forces are translated."""

    def render(self, force: Vector) -> None:
        """Give the hand a force [N], turned into the device's own axes."""
        self.device.render(self._frame.motion.rotate_back(force))

    def see(self, pose: Sequence[float]) -> None:
        """See where the virtual scene shows the fixture."""
        self.device.see(_posed(self._frame.inverse(), tuple(pose)))


class _FramedRobot(Wrapped[Any, Any]):
    frame: Any
    _inside: Callable[[Any], Any]

    def read(self) -> Any:
        """Present sample of the sensors."""
        return self._inside(self.robot.read())

    def exchange(self, desired_position: Any) -> Any:
        """Give a command [m], let one sample period pass, and return the sample then."""
        return self._inside(self.robot.exchange(self.frame.outside(desired_position)))


class FramedRobot(_FramedRobot, WrappedRobot):
    """A robot whose positions, acceleration and gravity are translated; forces are not, and no length changes."""

    def __init__(self, robot: Robot, frame: Frame) -> None:
        super().__init__(robot)
        self.frame, own = frame, robot.specification
        low, high = sorted(map(frame.inside, own.workspace))
        self.specification = replace(own, workspace=(low, high), gravity=frame.direction * own.gravity)

    def _inside(self, sample: RobotSample) -> RobotSample:
        inside = self.frame.inside
        return sample._replace(
            position=inside(sample.position),
            acceleration=self.frame.direction * sample.acceleration,
            exact_position=inside(sample.exact_position),
            commanded_position=inside(sample.commanded_position),
        )


class FramedSpatialRobot(_FramedRobot, WrappedSpatialRobot):
    """A robot in space whose places and forces, and the fixture where it says that, are translated.

    Its `reach` is the box along the world's axes that holds its own.
    """

    def __init__(self, robot: SpatialRobot, frame: SpatialFrame) -> None:
        super().__init__(robot)
        self.frame = frame
        (x, u), (y, v), (z, w) = zip(*robot.reach, strict=True)
        corners = [frame.inside(corner) for corner in itertools.product((x, u), (y, v), (z, w))]
        low, high = (tuple(map(end, zip(*corners, strict=True))) for end in (min, max))
        self.reach = low, high

    def _inside(self, sample: SpatialSample) -> SpatialSample:
        inside, turned = self.frame.inside, self.frame.motion.rotate
        return sample._replace(
            place=inside(sample.place),
            force=turned(sample.force),
            exact_force=turned(sample.exact_force),
            exact_place=inside(sample.exact_place),
            fixture=_posed(self.frame, sample.fixture),
        )


FRAMED: Any = {Frame: (FramedDevice, FramedRobot), SpatialFrame: (FramedSpatialDevice, FramedSpatialRobot)}


@functools.lru_cache(maxsize=4)
def _posed(frame: SpatialFrame, pose: tuple[float, ...]) -> tuple[float, ...]:
    """The pose in the world of one in the machine's frame, computed where it has moved; none stays none."""
    known = len(pose) == POSE_NUMBERS and all(map(math.isfinite, pose))
    return frame.pose_inside(pose) if known else pose


class Line:
    """What a session along a line is made of, and what is said of it."""

    unchosen = (("material", "foam-measured"), ("model", "contact-map"))  # what is taken where nothing is chosen
    frame: type[Any] = Frame
    commas = 4  # more in a text make a frame in space, which has six numbers
    device: type[Any] = Device
    hand: type[Any] = Hand  # a simulated one, about the device that moves it
    robot: type[Any] = Robot
    moved: type[Any] = MovedRobot  # from elsewhere
    faulty: type[Any] = FaultySensor
    unknown: Any = math.nan  # position [m]
    lengths: tuple[str, ...] = ("surface", "press_depth")  # what a follower says, for an operator to reach it
    beside: tuple[str, ...] = ()  # processes beside those of both sides
    where = again = ""  # where the material is, and what is simulated again with it
    # What is wrong with frames, machines and sides of the other kind.
    frames = "is of a scene; along a line give two numbers, ORIGIN,DIRECTION: for example 0.02,-1"
    machines = "moves in three dimensions, and this session is along a line: give a scene, or take one that is a {kind}"
    sides = "the follower is in a scene: give this side --scene {theirs} too"

    def check(self, settings: Any) -> None:
        """Refuse a scene that does not exist, a device that cannot move in it, and a specimen without one."""
        if settings.specimen:
            raise SettingError(
                "specimen", settings.specimen, f"is of a scene, and there is none: add --scene {UNKNOWN}"
            )

    def show(self, robot: Any, operator: Any) -> None:
        """Show the operator where the robot has the fixture."""


class Space(Line):
    """The same of a session in a scene, in three dimensions."""

    unchosen = (("material", "hunt-crossley"), ("model", "contact-map"))
    frame, commas = SpatialFrame, 1
    device, hand = SpatialDevice, SpatialHand
    robot, moved, faulty = SpatialRobot, MovedSpatialRobot, FaultySpatialSensor
    unknown = (math.nan, math.nan, math.nan)
    lengths, beside = (), ("camera",)
    where, again = " on the scene {}", ", its fixture, camera and tracker"
    frames = "is of a line; with a scene give six numbers, X,Y,Z,RX,RY,RZ: the base in the world [m, rad]"
    machines = "moves along one axis, and the scene {scene} is touched in three dimensions: take one that is a {kind}"
    sides = "the follower has {theirs} and not scene = {ours!r}: give both sides the same"

    def check(self, settings: Any) -> None:
        """See `Line.check`."""
        scene, operator = settings.scene, settings.operator
        for name, given in (("scene", scene), ("specimen", settings.specimen)):
            known = [one for one in SCENES if name == "scene" or one != UNKNOWN]
            if given and given not in known and not given.lower().endswith(MESH_ENDINGS):
                raise UnknownNameError(name, given, (*known, *(f"FILE{ending}" for ending in MESH_ENDINGS)))
        if settings.specimen and scene != UNKNOWN:
            rule = f"stands there where no shape is given: take scene = {UNKNOWN!r}, or leave it out"
            raise SettingError("specimen", settings.specimen, rule)
        if scene == UNKNOWN and settings.fusion == "contact":
            rule = "tells no pose, for touches of an unknown shape show the shape: take full, image or none"
            raise SettingError("fusion", settings.fusion, rule)
        if operator in HARDWARE_OPERATORS:
            raise SettingError("operator", operator, self.machines.format(scene=scene, kind=self.device.__name__))

    def show(self, robot: Any, operator: Any) -> None:
        """See `Line.show`."""
        operator.see(robot.read().fixture)


LINE, SPACE = WORKSPACES = Line(), Space()
"""Without a scene and with one: the one place where that is asked is `foretouch.session.SessionSettings.workspace`."""
