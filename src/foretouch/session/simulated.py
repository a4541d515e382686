"""The runner in simulated time: the same steps, one process, a seeded network, bit-identical on repeat."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from foretouch.devices import Device
from foretouch.link import FaultStage
from foretouch.messages import Command, Hello, Message, ModelUpdate, SessionLog, Telemetry
from foretouch.models.checks import require, require_type
from foretouch.quantities import Columns
from foretouch.robot import Robot
from foretouch.session import follower, leader
from foretouch.session.counting import follower_counts, leader_counts
from foretouch.session.frames import framed_device, framed_robot
from foretouch.session.operator_clock import OperatorClock
from foretouch.session.operators import felt_device, felt_texts
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.sides import leading_side
from foretouch.session.warm_up import warm_up_once

__all__ = ["SimulatedSession", "simulate"]

_PERIOD_NS = round(SAMPLE_PERIOD * 1e9)


@dataclass(frozen=True)
class SimulatedSession(Columns):
    """A simulated session; its columns are those of its log.

    Attributes:
        log: What was said; its `compute_ns` columns hold what the steps really took on this machine, which is the
            only thing that differs on repeat.
        duration: Simulated [s].
        elapsed: Real [s].
    """

    log: SessionLog
    duration: float
    elapsed: float

    def columns(self) -> dict[str, NDArray[Any]]:
        """See `SessionLog.columns`."""
        return self.log.columns()


def simulate(
    settings: SessionSettings,
    *,
    duration: float,
    operator: Device,
    robot: Robot,
    description: Mapping[str, str] | None = None,
    record: Callable[[Message, int], None] | None = None,
    progress: Callable[[float], None] | None = None,
) -> SimulatedSession:
    """Run a session in simulated time.

    Each tick runs the follower, then the leader. Time is the number of the tick, so that nothing of this machine
    enters; the real computing times are kept out of the messages.

    Args:
        settings: Of the session.
        duration: Simulated [s].
        operator: Moves the leader; counts as the settings' leader frame says.
        robot: The follower's; counts as the settings' follower frame says.
        description: Further settings for the log, as the sides say in their `Hello`.
        record: Called with each message to keep and its simulated time [ns].
        progress: Called now and then with the simulated time [s].

    Raises:
        SettingError: A duration that is negative or not finite.
        ArgumentTypeError: Settings, operator or robot that are none.
    """
    require_type("settings", settings, SessionSettings, "SessionSettings: SessionSettings() are the defaults")
    require_type("operator", operator, Device, "a Device: make_operator gives one")
    require_type("robot", robot, Robot, "a Robot: make_robot gives one")
    require("duration", duration, at_least=0.0)
    warm_up_once(settings)
    operator, robot = framed_device(operator, settings.frames[0]), framed_robot(robot, settings.frames[1])
    commands: FaultStage[Command] = FaultStage(settings.command_faults)
    returned: FaultStage[ModelUpdate | Telemetry] = FaultStage(settings.return_faults)
    side = leading_side(settings)
    leading = side.start(settings, device=felt_device(operator, settings))
    clock = OperatorClock(operator)
    following = follower.start(robot.specification, settings)
    ticks = round(duration / SAMPLE_PERIOD)
    led_in, followed_in = [0] * ticks, [0] * ticks  # [ns]
    leader_log, follower_log, models = [], [], []
    texts = settings.as_text() | {"operator": operator.name} | felt_texts(operator, settings) | dict(description or {})
    if record is not None:
        record(Hello.of("simulation", 1, 0, texts), 0)
    sample = robot.read()
    began = time.perf_counter()
    for tick in range(ticks):
        now_ns = tick * _PERIOD_NS
        start = time.perf_counter_ns()
        following, acted = follower.step(
            following, follower.Inputs(commands.pop_due(now_ns), sample, _PERIOD_NS, 0), now_ns
        )
        followed_in[tick] = time.perf_counter_ns() - start
        follower_log.append(acted.telemetry)
        returned.push(now_ns, acted.telemetry)
        if acted.model is not None:
            models.append(acted.model)
            returned.push(now_ns, acted.model)
        sample = robot.exchange(acted.desired_position)

        telemetry: list[Telemetry] = []
        updates: list[ModelUpdate] = []
        for message in returned.pop_due(now_ns):
            if type(message) is Telemetry:
                telemetry.append(message)
            elif type(message) is ModelUpdate:
                updates.append(message)
        position = operator.read(clock.read(now_ns, coupled=leading.heard.run > 0))
        start = time.perf_counter_ns()
        leading, led = side.step(
            leading,
            leader.Inputs(
                position,
                updates,
                telemetry,
                _PERIOD_NS,
                0,
                operator.clutched,
                operator.exact_position,
                operator.intention,
            ),
            now_ns,
        )
        led_in[tick] = time.perf_counter_ns() - start
        operator.render(led.record.rendered_force)
        leader_log.append(led.record)
        commands.push(now_ns, led.command)
        if record is not None:
            record(acted.telemetry, now_ns)
            if acted.model is not None:
                record(acted.model, now_ns)
            record(led.record, now_ns)
        if progress is not None and tick % 1000 == 0:
            progress(now_ns * 1e-9)
    elapsed = time.perf_counter() - began
    counts = leader_counts(leading) | follower_counts(following)
    log = SessionLog.from_messages(leader_log, follower_log, models, texts, counts)
    log.leader["compute_ns"], log.follower["compute_ns"] = led_in, followed_in
    return SimulatedSession(log, duration, elapsed)
