"""Each side of a session with its machine, on a line or in three dimensions.

Loops in real and in simulated time, and one that only watches a robot, drive the same: what arrives waits in the
simulated faults of the network, and a tick takes what is due and returns the messages to send.
"""

from __future__ import annotations

import importlib
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

from foretouch.devices import BrowserOperator, Device, SpatialBrowserOperator, SpatialDevice, SpatialHand
from foretouch.link import Faults, FaultStage
from foretouch.messages import (
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
from foretouch.session.runners.loop_timer import let_pass
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial import follower as spatial_follower
from foretouch.session.spatial import leader as spatial_leader
from foretouch.session.spatial.scenes import make_scene
from foretouch.session.steps import follower, leader
from foretouch.session.steps.counting import OperatorClock, follower_counts, leader_counts


class Tick(NamedTuple):
    """One tick of a side: its time, and what is requested in it beside the messages.

    Attributes:
        now_ns: Time of the tick [ns].
        period_ns: Time since the last tick began [ns].
        compute_ns: Computing time of the last tick, as messages report it [ns].
        stop: Why an emergency stop was requested; empty while none was.
        release: Whether its end is requested at the robot, or a repair of the sensors reported.
        ended: Whether the session is over: the robot is left as after a long silence.
    """

    now_ns: int
    period_ns: int = 0
    compute_ns: int = 0
    stop: str = ""
    release: bool = False
    ended: bool = False


class Driven(ABC):
    """A side of a session with its machine.

    Attributes:
        channels: Channels that it listens to beside those of every such side.
        delay: Name of the setting that delays what arrives.
        arriving: Messages that arrived, on their way through the simulated network.
        computed_ns: Computing time of the newest tick [ns].
    """

    channels: tuple[str, ...] = ()
    delay = "force_delay"

    def __init__(self, faults: Faults) -> None:
        self.arriving: FaultStage[Any] = FaultStage(faults)
        self.computed_ns = 0

    def tick(self, tick: Tick) -> list[Message]:
        """One tick: takes the messages that are due; returns those to send."""
        due = self.arriving.pop_due(tick.now_ns)
        began = time.perf_counter_ns()
        messages = self.act(due, tick)
        self.computed_ns = time.perf_counter_ns() - began
        return messages

    @abstractmethod
    def act(self, due: list[Any], tick: Tick) -> list[Message]:
        """The same, with the messages that are due."""

    @abstractmethod
    def counts(self) -> dict[str, int]:
        """Counters, by name."""

    def pass_time(self, periods: int) -> None:  # noqa: B027  # a hand moves without being asked
        """Let these sample periods of the machine pass, as far as it can make up for them."""


class DrivenFollower(Driven):
    """A follower's step with its robot.

    Args:
        robot: Robot to command; along a line it counts as the settings' follower frame says.
        settings: Session settings.

    Attributes:
        state: State of the follower along the line or the normal.
        sample: Newest sample of the robot.
        desired: Position for the robot [m].
        beliefs: Beliefs of the fixture's pose, for the next tick.
    """

    delay = "position_delay"
    state: follower.State

    def __init__(self, robot: Any, settings: SessionSettings) -> None:
        super().__init__(settings.command_faults)
        self._robot = robot
        self._back = settings.return_speed * SAMPLE_PERIOD
        self.beliefs: list[FixtureBelief] = []
        self.sample = robot.read()
        self.desired: Any = None

    def counts(self) -> dict[str, int]:
        """See `Driven.counts`."""
        return follower_counts(self.state)

    def pass_time(self, periods: int) -> None:
        """See `Driven.pass_time`."""
        let_pass(self.exchange, periods, simulated=self._robot.specification.simulated)

    def exchange(self) -> None:
        """Let a sample period of the robot pass, with the newest command."""
        self.sample = self._robot.exchange(self.desired)

    def act(self, due: list[Any], tick: Tick) -> list[Message]:
        """See `Driven.act`; the commands are due, and the telemetry is its first message."""
        beliefs, self.beliefs = self.beliefs, []
        inputs = follower.Inputs(due, self.sample, *tick[1:], beliefs)
        return [message for message in self._step(inputs, tick.now_ns) if message is not None]

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
        self.desired = self.sample.commanded_position

    def _step(self, inputs: follower.Inputs[Any], now_ns: int) -> Sequence[Message | None]:
        _, acted = follower.step(self.state, inputs, now_ns)
        self.desired = acted.desired_position
        return acted.telemetry, acted.model

    def back_off(self) -> None:
        """See `DrivenFollower.back_off`."""
        force = follower.sensor_force(self.state, self.sample)
        if math.isfinite(force):
            follower.feel_plainly(self.state, force)
        self.desired -= self._back
        self.state.safety.go_on_from(self.desired)


class SpaceFollower(DrivenFollower):
    """A follower in three dimensions, in process `run`."""

    channels = ("fixture",)

    def __init__(self, robot: SpatialRobot, settings: SessionSettings, run: int) -> None:
        scene = make_scene(settings.scene)
        self._whole = spatial_follower.start(robot.specification, settings, scene.surface, scene.nominal, run=run)
        self.state = self._whole.inner
        super().__init__(robot, settings)
        self.desired = self.sample.place

    def _step(self, inputs: follower.Inputs[Any], now_ns: int) -> Sequence[Message | None]:
        _, acted = spatial_follower.step(self._whole, inputs, now_ns)
        self.desired = acted.desired
        return acted.telemetry, acted.space, acted.model, acted.field

    def back_off(self) -> None:
        """See `DrivenFollower.back_off`; whatever is believed of the fixture."""
        force = subtract(self.sample.force, self._whole.bias)
        size = norm(force)
        if 0.0 < size < math.inf:
            follower.feel_plainly(self.state, size)
            self.desired = add(self.desired, scaled(force, self._back / size))
            self._whole.safety.begin(self.desired)


class DrivenLeader(Driven):
    """A leader's step with its operator.

    Args:
        operator: Moves the leader; along a line it counts as the settings' leader frame says.
        settings: Session settings.

    Attributes:
        state: State of the leader along the line or the normal.
        nowhere: Ticks in which the device gave no position: the hand then counts as not moved.
    """

    state: leader.State

    def __init__(self, operator: Any, settings: SessionSettings) -> None:
        super().__init__(settings.return_faults)
        self._operator = operator
        self._clock = OperatorClock(operator)
        self.nowhere = 0

    def counts(self) -> dict[str, int]:
        """See `Driven.counts`."""
        return leader_counts(self.state)

    def operator_ns(self, now_ns: int) -> int:
        """The operator's time [ns]."""
        return self._clock.read(now_ns, coupled=self.state.follower_view.run > 0)

    @abstractmethod
    def take(self, handle: Handle, now_ns: int) -> None:
        """Take a message of the browser about its handle."""

    def act(self, due: list[Any], tick: Tick) -> list[Message]:
        """See `Driven.act`; the command is its first message, and the record the second."""
        operator = self._operator
        position = operator.read(self.operator_ns(tick.now_ns))
        if not all(map(math.isfinite, position if isinstance(position, tuple) else (position,))):
            self.nowhere += 1
        inputs = leader.Inputs(
            position,
            [message for message in due if type(message) is ModelUpdate],
            [message for message in due if type(message) is Telemetry],
            tick.period_ns,
            tick.compute_ns,
            operator.clutched,
            operator.exact_position,
            operator.intention,
            bool(tick.stop),
            [message for message in due if type(message) is FollowerSpace],
            [message for message in due if type(message) is FieldUpdate],
        )
        return self._step(inputs, tick.now_ns)

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
        super().__init__(framed_device(operator, settings.leader_frame), settings)
        self._mouse: BrowserOperator | None = browser_operator(self._operator)

    def take(self, handle: Handle, now_ns: int) -> None:
        """See `DrivenLeader.take`."""
        if self._mouse is not None:
            self._mouse.take(handle.position, handle.held, self.operator_ns(now_ns), clutched=handle.clutched)

    def _step(self, inputs: leader.Inputs[Any], now_ns: int) -> list[Message]:
        _, led = leader.step(self.state, inputs, now_ns)
        self._operator.render(led.record.rendered_force)
        return [led.command, led.record]


class SpaceLeader(DrivenLeader):
    """A leader in three dimensions, named `holder` and of this epoch."""

    channels = ("follower-space", "field")

    def __init__(self, operator: SpatialDevice, settings: SessionSettings, holder: str, epoch: int) -> None:
        super().__init__(operator, settings)
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
        mouse.take(point, handle.held, self.operator_ns(now_ns), clutched=handle.clutched)

    def act(self, due: list[Any], tick: Tick) -> list[Message]:
        """See `DrivenLeader.act`; the operator sees the fixture where the scene shows it."""
        self._operator.see(self._whole.line.pose)
        return super().act(due, tick)

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
