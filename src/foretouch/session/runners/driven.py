"""What the loops in real time drive: a side's step with its robot or its operator, on a line or in three dimensions."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from typing import Protocol

from foretouch.devices import BrowserOperator, Device, SpatialDevice
from foretouch.link import ZenohLink
from foretouch.messages import Command, Handle, Message, ModelUpdate, Telemetry
from foretouch.robot import Robot, SpatialRobot
from foretouch.session.frames import browser_operator, framed_device, framed_robot
from foretouch.session.operators import felt_device
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps import follower, leader


class DrivenFollower(Protocol):
    """A follower's step with its robot.

    Attributes:
        channels: Channels that it listens to beside those of every follower.
        state: State of the follower along the line or the normal.
    """

    channels: tuple[str, ...]
    state: follower.State

    def exchange(self) -> None:
        """Let a sample period of the robot pass, with the newest command."""

    def listen(self, link: ZenohLink) -> None:
        """Take what came on `channels`."""

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
        """One tick: what it says. Arguments as of `foretouch.session.steps.follower.Inputs`."""

    def back_off(self) -> None:
        """Where a tick raises: go back from what the newest sample feels, with nothing but that sample."""


class DrivenLeader(Protocol):
    """A leader's step with its operator.

    Attributes:
        channels: Channels that it listens to beside those of every leader.
        state: State of the leader along the line or the normal.
        nowhere: Ticks in which the device gave no position: the hand then counts as not moved.
    """

    channels: tuple[str, ...]
    state: leader.State
    nowhere: int

    def take(self, handle: Handle, now_ns: int) -> None:
        """Take what the browser says of its handle."""

    def tick(
        self, arrived: Sequence[Message], operator_ns: int, period_ns: int, compute_ns: int, now_ns: int, *, stop: bool
    ) -> list[Message]:
        """One tick: what it says, the command first."""


class LineFollower:
    """A follower along a line.

    Args:
        robot: Counts as the settings' follower frame says.
        settings: Of the session.
        run: Epoch of this process.
    """

    channels: tuple[str, ...] = ()

    def __init__(self, robot: Robot, settings: SessionSettings, run: int) -> None:
        self._robot = framed_robot(robot, settings.follower_frame)
        self.state = follower.start(self._robot.specification, settings, run=run)
        self._sample = self._robot.read()
        self._desired = self._sample.commanded_position
        self._back = settings.return_speed * SAMPLE_PERIOD

    def exchange(self) -> None:
        """See `DrivenFollower.exchange`."""
        self._sample = self._robot.exchange(self._desired)

    def listen(self, link: ZenohLink) -> None:
        """There is nothing else to listen to."""

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
        """See `DrivenFollower.tick`."""
        inputs = follower.Inputs(commands, self._sample, period_ns, compute_ns, stop, release, ended)
        _, acted = follower.step(self.state, inputs, now_ns)
        self._desired = acted.desired_position
        return [acted.telemetry] if acted.model is None else [acted.telemetry, acted.model]

    def back_off(self) -> None:
        """See `DrivenFollower.back_off`."""
        force = follower.sensor_force(self.state, self._sample)
        if math.isfinite(force):
            follower.feel_plainly(self.state, force)
        self._desired -= self._back
        self.state.safety.go_on_from(self._desired)


class LineLeader:
    """A leader along a line.

    Args:
        operator: Counts as the settings' leader frame says.
        settings: Of the session.
        holder: Name of this leader.
        epoch: Of this process.
    """

    channels: tuple[str, ...] = ()

    def __init__(self, operator: Device, settings: SessionSettings, holder: str, epoch: int) -> None:
        # A baseline, which renders the delayed force, is imported only where it is asked for.
        name = "leader" if settings.baseline == "none" else "baseline"
        start = importlib.import_module(f"foretouch.session.steps.{name}").start
        self.state: leader.State = start(settings, holder=holder, epoch=epoch, device=felt_device(operator, settings))
        self.nowhere = 0
        self._operator = framed_device(operator, settings.leader_frame)
        self._mouse: BrowserOperator | None = browser_operator(self._operator)

    def take(self, handle: Handle, now_ns: int) -> None:
        """See `DrivenLeader.take`."""
        if self._mouse is not None:
            self._mouse.take(handle.position, handle.held, now_ns, clutched=handle.clutched)

    def tick(
        self, arrived: Sequence[Message], operator_ns: int, period_ns: int, compute_ns: int, now_ns: int, *, stop: bool
    ) -> list[Message]:
        """See `DrivenLeader.tick`."""
        operator = self._operator
        position = operator.read(operator_ns)
        if not math.isfinite(position):
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
        )
        _, led = leader.step(self.state, inputs, now_ns)
        operator.render(led.record.rendered_force)
        return [led.command, led.record]


def drive_follower(robot: Robot | SpatialRobot, settings: SessionSettings, run: int) -> DrivenFollower:
    """The follower for this robot."""
    if isinstance(robot, Robot):
        return LineFollower(robot, settings, run)
    from foretouch.session.runners.driven_scene import SpaceFollower

    return SpaceFollower(robot, settings, run)


def drive_leader(operator: Device | SpatialDevice, settings: SessionSettings, holder: str, epoch: int) -> DrivenLeader:
    """The leader for this operator."""
    if isinstance(operator, Device):
        return LineLeader(operator, settings, holder, epoch)
    from foretouch.session.runners.driven_scene import SpaceLeader

    return SpaceLeader(operator, settings, holder, epoch)
