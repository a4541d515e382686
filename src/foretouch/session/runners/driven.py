"""Each side of a session with its machine, on a line or in three dimensions.

Loops in real and in simulated time, and one that only watches a robot, drive the same: what arrives waits in the
simulated faults of the network, and a tick takes what is due and returns the messages to send.
"""

from __future__ import annotations

import importlib
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from foretouch.devices import Device, SpatialDevice
from foretouch.errors import SettingError
from foretouch.link import Faults, FaultStage
from foretouch.messages import FixtureBelief, Handle, Message
from foretouch.quantities.pose import Vector, add, scaled
from foretouch.robot import Robot, SpatialRobot
from foretouch.session.free_air import misfit
from foretouch.session.network.freshness import Arrival
from foretouch.session.operators import felt_device
from foretouch.session.runners.loop_timer import let_pass
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.hand import HandInSpace
from foretouch.session.spatial.probe import ProbeInSpace
from foretouch.session.spatial.scenes import make_scene
from foretouch.session.spatial.unknown import HandOverUnknown, ProbeOverUnknown
from foretouch.session.steps import follower, leader
from foretouch.session.thin import FollowerEnd, LeaderEnd, end_of
from foretouch.session.workspace import LINE, SPACE, browser_operator, framed_device, framed_robot
from foretouch.settings import UNKNOWN


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
        end: Its end of a thin link, whose packets then are what arrives; None where messages cross as they are.
        computed_ns: Computing time of the newest tick [ns].
    """

    channels: tuple[str, ...] = ()
    delay = "force_delay"

    def __init__(self, faults: Faults, end: LeaderEnd | FollowerEnd | None = None) -> None:
        self.arriving: FaultStage[Any] = FaultStage(faults)
        self.end = end
        self.computed_ns = 0

    def tick(self, tick: Tick) -> list[Message]:
        """One tick: takes the messages that are due; returns those to send, and the packet of a thin link last."""
        due, end = self.arriving.pop_due(tick.now_ns), self.end
        began = time.perf_counter_ns()
        if end is None:
            messages = self.act(due, tick)
        else:
            messages = end.said(self.act(end.heard(due, tick.now_ns), tick), tick.now_ns)
        self.computed_ns = time.perf_counter_ns() - began
        return messages

    def crossing(self, messages: list[Message]) -> list[Message]:
        """Those messages of a tick that cross the network to the other side."""
        return messages if self.end is None else [one for one in messages if type(one) is self.end.packet]

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
        robot: Robot to command; it counts as the settings' follower frame says.
        settings: Session settings.
        run: Number of this process.
        probe: The probe in three dimensions; None for one along a line.

    Raises:
        RecordingError: The file of the settings' calibration cannot be read, or is none.
        SettingError: The calibration does not fit this robot, or its sensor.

    Attributes:
        state: State of the follower along the line or the normal.
        sample: Newest sample of the robot.
        desired: Position for the robot [m].
        beliefs: Beliefs of the fixture's pose, for the next tick.
    """

    delay = "position_delay"

    def __init__(self, robot: Any, settings: SessionSettings, run: int, probe: ProbeInSpace | None = None) -> None:
        super().__init__(settings.command_faults, end_of("follower", settings))
        self._robot = framed_robot(robot, settings.follower_frame)
        self.state = follower.start(self._robot.specification, settings, run=run, probe=probe)
        if rule := misfit(self._robot, self.state, settings):
            raise SettingError("calibration", settings.calibration, rule)
        self._back = settings.return_speed * SAMPLE_PERIOD
        self.beliefs: list[FixtureBelief] = []
        self.sample = self._robot.read()
        self.desired: Any = None

    def counts(self) -> dict[str, int]:
        """Messages sent by the follower, and lost, late, repeated or refused ones of the leader.

        Over a thin link packets count as the messages that arrive.
        """
        fresh, end = self.state.freshness, self.end
        commands = self.state.commands if end is None else end.arrived
        sent = {} if end is None else {f"follower_{name}": count for name, count in end.counts().items()}
        return (
            sent
            | {
                "models_sent": self.state.sender.sequence,
                "telemetry_sent": self.state.tick,
                "commands_lost": commands.lost,
                "commands_late": commands.late,
                "commands_copies": commands.copies,
                "commands_stale": fresh.counts[Arrival.STALE],
                "commands_overtaken": fresh.counts[Arrival.OVERTAKEN],
                "commands_future": fresh.counts[Arrival.FUTURE],
                "commands_of_others": self.state.lease.refused,
                "commands_before_release": self.state.before_release,
                "step_failures": self.state.failures.count,
                "held_ticks": self.state.held_ticks,
                "faulty_ticks": self.state.faulty_ticks,
            }
            | self._recalled()
        )

    def _recalled(self) -> dict[str, int]:
        """Whether what was remembered of the material has been dropped; nothing where nothing was."""
        recalls = getattr(self.state.learner.estimator, "recalls", "none")
        return {} if recalls == "none" else {"memory_dropped": int(recalls == "dropped")}

    def pass_time(self, periods: int) -> None:
        """See `Driven.pass_time`."""
        let_pass(self.exchange, periods, simulated=self._robot.specification.simulated)

    def exchange(self) -> None:
        """Let a sample period of the robot pass, with the newest command."""
        self.sample = self._robot.exchange(self.desired)

    def act(self, due: list[Any], tick: Tick) -> list[Message]:
        """See `Driven.act`; the commands are due, and the telemetry is its first message."""
        now_ns, period_ns, compute_ns, stop, release, ended = tick
        beliefs = self.beliefs
        if beliefs:
            self.beliefs = []
        inputs = follower.Inputs(due, self.sample, period_ns, compute_ns, stop, release, ended, beliefs)
        _, (self.desired, *said) = follower.step(self.state, inputs, now_ns)
        return [message for message in said if message is not None]

    def back_off(self) -> None:
        """Where a tick raises: retreat according to the force in the newest sample, and nothing else."""
        self.desired = self.state.probe.back_off(self.state, self.sample, self.desired, self._back)


class LineFollower(DrivenFollower):
    """A follower along a line, in process `run`."""

    def __init__(self, robot: Robot, settings: SessionSettings, run: int) -> None:
        super().__init__(robot, settings, run)
        self.desired = self.sample.commanded_position


class SpaceFollower(DrivenFollower):
    """A follower in three dimensions, in process `run`."""

    channels = ("fixture",)

    def __init__(self, robot: SpatialRobot, settings: SessionSettings, run: int) -> None:
        scene = make_scene(settings.scene, settings.probe_radius)
        probe = ProbeOverUnknown if scene.name == UNKNOWN else ProbeInSpace
        super().__init__(robot, settings, run, probe(scene.surface, scene.nominal))
        self.desired = self.sample.place


class OperatorClock:
    """The clock that an operator is read by.

    A hand that holds a device waits, as a person would, until the follower's position is known. From then on its time
    runs, from zero. For an operator that feels nothing it is the session's own clock.
    """

    __slots__ = ("_begun_ns", "_waits")

    def __init__(self, operator: Device | SpatialDevice) -> None:
        self._waits = operator.closed_loop
        self._begun_ns = 0

    def read(self, now_ns: int, *, coupled: bool) -> int:
        """The operator's time [ns] at the session's [ns]; `coupled` says whether hand and follower have met."""
        if self._waits:
            self._begun_ns, self._waits = now_ns, not coupled
        return now_ns - self._begun_ns


class DrivenLeader(Driven):
    """A leader's step with its operator.

    Args:
        operator: Moves the leader; it counts as the settings' leader frame says.
        settings: Session settings.
        holder: Name of this leader.
        epoch: Epoch of this process.
        hand: The hand in three dimensions; None for one along a line.

    Attributes:
        state: State of the leader along the line or the normal.
        nowhere: Ticks in which the device gave no position: the hand then counts as not moved.
    """

    def __init__(
        self, operator: Any, settings: SessionSettings, holder: str, epoch: int, hand: HandInSpace | None = None
    ) -> None:
        super().__init__(settings.return_faults, end_of("leader", settings))
        device = felt_device(operator, settings)
        self.state = _start_of(settings)(settings, holder=holder, epoch=epoch, device=device, hand=hand)
        self._operator = framed_device(operator, settings.leader_frame)
        self._mouse, self._clock = browser_operator(self._operator), OperatorClock(self._operator)
        self.nowhere = 0

    def counts(self) -> dict[str, int]:
        """Messages sent by the leader, and lost, late or repeated ones of the follower.

        Over a thin link packets count as its telemetry.
        """
        view, end = self.state.follower_view, self.end
        telemetry = view.telemetry if end is None else end.arrived
        sent = {} if end is None else {f"leader_{name}": count for name, count in end.counts().items()}
        return sent | {
            "commands_sent": self.state.sequence,
            "models_lost": view.models.lost if end is None else end.models_broken,
            "models_late": view.models.late,
            "models_copies": view.models.copies,
            "models_refused": self.state.refused,
            "telemetry_lost": telemetry.lost,
            "telemetry_late": telemetry.late,
            "telemetry_copies": telemetry.copies,
        }

    def operator_ns(self, now_ns: int) -> int:
        """The operator's time [ns]."""
        return self._clock.read(now_ns, coupled=self.state.follower_view.run > 0)

    @abstractmethod
    def take(self, handle: Handle, now_ns: int) -> None:
        """Take a message of the browser about its handle."""

    def act(self, due: list[Any], tick: Tick) -> list[Message]:
        """See `Driven.act`; the command is its first message, and the record the second."""
        operator, now_ns = self._operator, tick.now_ns
        position = operator.read(self.operator_ns(now_ns))
        if not math.isfinite(sum(position) if isinstance(position, tuple) else position):
            self.nowhere += 1
        inputs = leader.Inputs(
            position,
            due,
            tick.period_ns,
            tick.compute_ns,
            operator.clutched,
            operator.exact_position,
            operator.intention,
            bool(tick.stop),
        )
        _, led = leader.step(self.state, inputs, tick.now_ns)
        self._give(led)
        return list(led)

    @abstractmethod
    def _give(self, led: leader.Outputs) -> None:
        """Give the hand its force."""


def _start_of(settings: SessionSettings) -> Callable[..., leader.State]:
    """A baseline, which renders the delayed force, is imported only where it is asked for."""
    name = "leader" if settings.baseline == "none" else "baseline"
    return importlib.import_module(f"foretouch.session.steps.{name}").start  # type: ignore[no-any-return]


class LineLeader(DrivenLeader):
    """A leader along a line."""

    def take(self, handle: Handle, now_ns: int) -> None:
        """See `DrivenLeader.take`."""
        if self._mouse is not None:
            self._mouse.take(handle.position, handle.held, self.operator_ns(now_ns), clutched=handle.clutched)

    def _give(self, led: leader.Outputs) -> None:
        self._operator.render(led.record.rendered_force)


class SpaceLeader(DrivenLeader):
    """A leader in three dimensions."""

    channels = ("field",)

    def __init__(self, operator: SpatialDevice, settings: SessionSettings, holder: str, epoch: int) -> None:
        scene = make_scene(settings.scene, settings.probe_radius)
        hand = HandOverUnknown if scene.name == UNKNOWN else HandInSpace
        self._hand = hand(scene.surface, scene.nominal, settings.position_scale)
        super().__init__(operator, settings, holder, epoch, self._hand)
        self._apart: Vector = (0.0, 0.0, 0.0)  # of hand and world, when the handle was taken

    def take(self, handle: Handle, now_ns: int) -> None:
        """See `DrivenLeader.take`; the handle's place in the world may be apart from the hand's own."""
        mouse = self._mouse
        if mouse is None:
            return
        if not mouse.held:
            self._apart = self._hand.apart
        point: Sequence[float] = handle.place
        if len(point) == 3:
            here = add((point[0], point[1], point[2]), self._apart)
            point = scaled(here, 1.0 / self._hand.scale)
        mouse.take(point, handle.held, self.operator_ns(now_ns), clutched=handle.clutched)

    def act(self, due: list[Any], tick: Tick) -> list[Message]:
        """See `DrivenLeader.act`; the operator sees the fixture where the scene shows it."""
        self._operator.see(self._hand.line.pose)
        return super().act(due, tick)

    def _give(self, led: leader.Outputs) -> None:
        self._operator.render(self.state.renderer.force)


SIDES: dict[Any, Any] = {LINE: (LineFollower, LineLeader), SPACE: (SpaceFollower, SpaceLeader)}


def drive_follower(robot: Any, settings: SessionSettings, run: int) -> DrivenFollower:
    """The follower for this robot."""
    return SIDES[settings.workspace][0](robot, settings, run)  # type: ignore[no-any-return]


def drive_leader(operator: Any, settings: SessionSettings, holder: str, epoch: int) -> DrivenLeader:
    """The leader for this operator."""
    return SIDES[settings.workspace][1](operator, settings, holder, epoch)  # type: ignore[no-any-return]
