"""Each side's step with its robot or its operator, on a line or in three dimensions, as the loops drive it."""

from __future__ import annotations

import importlib
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from foretouch.devices import BrowserOperator, Device, SpatialBrowserOperator, SpatialDevice, SpatialHand
from foretouch.link import ZenohLink
from foretouch.messages import (
    Command,
    FieldUpdate,
    FixtureBelief,
    FollowerSpace,
    Handle,
    Message,
    ModelUpdate,
    Telemetry,
)
from foretouch.quantities.pose import Vector, add, norm, scaled, subtract
from foretouch.robot import Robot, SpatialRobot
from foretouch.session.frames import browser_operator, framed_device, framed_robot
from foretouch.session.operators import felt_device
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial import follower as spatial_follower
from foretouch.session.spatial import leader as spatial_leader
from foretouch.session.spatial.scenes import make_scene
from foretouch.session.steps import follower, leader


class DrivenFollower(ABC):
    """A follower's step with its robot.

    Args:
        robot: Robot to command; along a line it counts as the settings' follower frame says.
        settings: Session settings.

    Attributes:
        channels: Channels that it listens to beside those of every follower.
        state: State of the follower along the line or the normal.
        sample: Newest sample of the robot.
    """

    channels: tuple[str, ...] = ()
    state: follower.State

    def __init__(self, robot: Any, settings: SessionSettings) -> None:
        self._robot = robot
        self._back = settings.return_speed * SAMPLE_PERIOD
        self._beliefs: list[FixtureBelief] = []
        self.sample = robot.read()
        self._desired: Any = None

    def exchange(self) -> None:
        """Let a sample period of the robot pass, with the newest command."""
        self.sample = self._robot.exchange(self._desired)

    def listen(self, link: ZenohLink) -> None:
        """Take the messages on `channels`."""
        for channel in self.channels:
            self.believe([belief for _, belief in link.take(channel)])

    def believe(self, beliefs: list[FixtureBelief]) -> None:
        """Take beliefs of the fixture's pose, for the next tick."""
        self._beliefs = beliefs

    def tick(
        self,
        commands: list[Command],
        period_ns: int,
        compute_ns: int,
        now_ns: int,
        *,
        stop: str = "",
        release: bool = False,
        ended: bool = False,
    ) -> list[Message]:
        """One tick; returns its messages. Arguments as of `foretouch.session.steps.follower.Inputs`."""
        beliefs, self._beliefs = self._beliefs, []
        inputs = follower.Inputs(commands, self.sample, period_ns, compute_ns, stop, release, ended, beliefs)
        return [message for message in self._step(inputs, now_ns) if message is not None]

    @abstractmethod
    def _step(self, inputs: follower.Inputs[Any], now_ns: int) -> Sequence[Message | None]:
        """Run the step and keep the desired position."""

    @abstractmethod
    def back_off(self) -> None:
        """Where a tick raises: retreat according to the force in the newest sample, and nothing else."""


class LineFollower(DrivenFollower):
    """A follower along a line, in process `run`."""

    def __init__(self, robot: Robot, settings: SessionSettings, run: int) -> None:
        framed = framed_robot(robot, settings.follower_frame)
        self.state = follower.start(framed.specification, settings, run=run)
        super().__init__(framed, settings)
        self._desired = self.sample.commanded_position

    def _step(self, inputs: follower.Inputs[Any], now_ns: int) -> Sequence[Message | None]:
        _, acted = follower.step(self.state, inputs, now_ns)
        self._desired = acted.desired_position
        return acted.telemetry, acted.model

    def back_off(self) -> None:
        """See `DrivenFollower.back_off`."""
        force = follower.sensor_force(self.state, self.sample)
        if math.isfinite(force):
            follower.feel_plainly(self.state, force)
        self._desired -= self._back
        self.state.safety.go_on_from(self._desired)


class SpaceFollower(DrivenFollower):
    """A follower in three dimensions, in process `run`."""

    channels = ("fixture",)

    def __init__(self, robot: SpatialRobot, settings: SessionSettings, run: int) -> None:
        scene = make_scene(settings.scene)
        self._whole = spatial_follower.start(robot.specification, settings, scene.surface, scene.nominal, run=run)
        self.state = self._whole.inner
        super().__init__(robot, settings)
        self._desired = self.sample.place

    def _step(self, inputs: follower.Inputs[Any], now_ns: int) -> Sequence[Message | None]:
        _, acted = spatial_follower.step(self._whole, inputs, now_ns)
        self._desired = acted.desired
        return acted.telemetry, acted.space, acted.model, acted.field

    def back_off(self) -> None:
        """See `DrivenFollower.back_off`; whatever is believed of the fixture."""
        force = subtract(self.sample.force, self._whole.bias)
        size = norm(force)
        if 0.0 < size < math.inf:
            follower.feel_plainly(self.state, size)
            self._desired = add(self._desired, scaled(force, self._back / size))
            self._whole.last.begin(self._desired)


class DrivenLeader(ABC):
    """A leader's step with its operator.

    Args:
        operator: Moves the leader; along a line it counts as the settings' leader frame says.

    Attributes:
        channels: Channels that it listens to beside those of every leader.
        state: State of the leader along the line or the normal.
        nowhere: Ticks in which the device gave no position: the hand then counts as not moved.
    """

    channels: tuple[str, ...] = ()
    state: leader.State

    def __init__(self, operator: Any) -> None:
        self._operator = operator
        self.nowhere = 0

    @abstractmethod
    def take(self, handle: Handle, now_ns: int) -> None:
        """Take a message of the browser about its handle."""

    def tick(
        self, arrived: Sequence[Message], operator_ns: int, period_ns: int, compute_ns: int, now_ns: int, *, stop: bool
    ) -> list[Message]:
        """One tick; returns its messages, the command first."""
        operator = self._operator
        position = operator.read(operator_ns)
        if not all(map(math.isfinite, position if isinstance(position, tuple) else (position,))):
            self.nowhere += 1
        inputs = leader.Inputs(
            position,
            [message for message in arrived if type(message) is ModelUpdate],
            [message for message in arrived if type(message) is Telemetry],
            period_ns,
            compute_ns,
            operator.clutched,
            operator.exact_position,
            operator.intention,
            stop,
            [message for message in arrived if type(message) is FollowerSpace],
            [message for message in arrived if type(message) is FieldUpdate],
        )
        return self._step(inputs, now_ns)

    @abstractmethod
    def _step(self, inputs: leader.Inputs[Any], now_ns: int) -> list[Message]:
        """Run the step and render its force."""


class LineLeader(DrivenLeader):
    """A leader along a line, named `holder` and of this epoch."""

    def __init__(self, operator: Device, settings: SessionSettings, holder: str, epoch: int) -> None:
        # A baseline, which renders the delayed force, is imported only where it is asked for.
        name = "leader" if settings.baseline == "none" else "baseline"
        start = importlib.import_module(f"foretouch.session.steps.{name}").start
        self.state = start(settings, holder=holder, epoch=epoch, device=felt_device(operator, settings))
        super().__init__(framed_device(operator, settings.leader_frame))
        self._mouse: BrowserOperator | None = browser_operator(self._operator)

    def take(self, handle: Handle, now_ns: int) -> None:
        """See `DrivenLeader.take`."""
        if self._mouse is not None:
            self._mouse.take(handle.position, handle.held, now_ns, clutched=handle.clutched)

    def _step(self, inputs: leader.Inputs[Any], now_ns: int) -> list[Message]:
        _, led = leader.step(self.state, inputs, now_ns)
        self._operator.render(led.record.rendered_force)
        return [led.command, led.record]


class SpaceLeader(DrivenLeader):
    """A leader in three dimensions, named `holder` and of this epoch."""

    channels = ("follower-space", "field")

    def __init__(self, operator: SpatialDevice, settings: SessionSettings, holder: str, epoch: int) -> None:
        super().__init__(operator)
        scene = make_scene(settings.scene)
        self._whole = spatial_leader.start(settings, scene.surface, scene.nominal, holder=holder, epoch=epoch)
        self.state = self._whole.inner
        moved = operator.intention_device if isinstance(operator, SpatialHand) else operator
        self._mouse = moved if isinstance(moved, SpatialBrowserOperator) else None
        self._apart: Vector = (0.0, 0.0, 0.0)  # of hand and world, when the handle was taken

    def take(self, handle: Handle, now_ns: int) -> None:
        """See `DrivenLeader.take`; the handle's place in the world may be apart from the hand's own."""
        mouse = self._mouse
        if mouse is None:
            return
        if not mouse.held:
            self._apart = self._whole.apart
        point: Sequence[float] = handle.place
        if len(point) == 3:
            here = add((point[0], point[1], point[2]), self._apart)
            point = scaled(here, 1.0 / self._whole.position_scale)
        mouse.take(point, handle.held, now_ns, clutched=handle.clutched)

    def tick(
        self, arrived: Sequence[Message], operator_ns: int, period_ns: int, compute_ns: int, now_ns: int, *, stop: bool
    ) -> list[Message]:
        """See `DrivenLeader.tick`; the operator sees the fixture where the scene shows it."""
        self._operator.see(self._whole.line.pose)
        return super().tick(arrived, operator_ns, period_ns, compute_ns, now_ns, stop=stop)

    def _step(self, inputs: leader.Inputs[Any], now_ns: int) -> list[Message]:
        _, led = spatial_leader.step(self._whole, inputs, now_ns)
        self._operator.render(led.force)
        return [led.command, led.record, led.space]


def drive_follower(robot: Robot | SpatialRobot, settings: SessionSettings, run: int) -> DrivenFollower:
    """The follower for this robot."""
    return (LineFollower if isinstance(robot, Robot) else SpaceFollower)(robot, settings, run)  # type: ignore[arg-type]


def drive_leader(operator: Device | SpatialDevice, settings: SessionSettings, holder: str, epoch: int) -> DrivenLeader:
    """The leader for this operator."""
    make = LineLeader if isinstance(operator, Device) else SpaceLeader
    return make(operator, settings, holder, epoch)  # type: ignore[arg-type]
