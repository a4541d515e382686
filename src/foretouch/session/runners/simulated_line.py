"""A session along a line in simulated time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from foretouch.devices import Device
from foretouch.errors import SettingError
from foretouch.link import FaultStage
from foretouch.messages import Command, Hello, Message, ModelUpdate, SessionLog, Telemetry
from foretouch.quantities import Columns
from foretouch.robot import Robot, material_names
from foretouch.session.frames import framed_device, framed_robot
from foretouch.session.operators import (
    close_operator,
    felt_device,
    felt_texts,
    make_operator,
    pressed_material,
    reach_of,
    require_simulated_time,
)
from foretouch.session.robots import make_session_robot, reach_texts, require_simulated_robot
from foretouch.session.runners.warm_up import warm_up_once
from foretouch.session.settings import SAMPLE_PERIOD, SIMULATED, SessionSettings
from foretouch.session.steps import follower, leader
from foretouch.session.steps.counting import OperatorClock, follower_counts, leader_counts
from foretouch.session.steps.sides import leading_side

_PERIOD_NS = round(SAMPLE_PERIOD * 1e9)

Record = Callable[[Message, int], None]
"""Called with each message to keep and its simulated time [ns]."""


@dataclass(frozen=True)
class SimulatedSession(Columns):
    """A simulated session; its columns are those of its log.

    The same settings give an equal one: ``==`` leaves out how long the computer took.

    Attributes:
        log: What was said; its `compute_ns` columns hold what the steps really took on this machine, which is the
            only thing that differs on repeat.
        duration: Simulated [s].
        elapsed: Real [s].
    """

    log: SessionLog
    duration: float
    elapsed: float = field(compare=False)

    def columns(self) -> dict[str, NDArray[Any]]:
        """See `SessionLog.columns`."""
        return self.log.columns()


def prepare_line(
    settings: SessionSettings,
    duration: float,
    operator: Device | None,
    robot: Robot | None,
    *,
    description: Mapping[str, str] | None,
    progress: Callable[[float], None] | None,
    say: Callable[[str], None],
) -> Callable[[Record | None], SimulatedSession]:
    """Make what a session along a line needs and was not given: see `prepare_simulation`."""
    with ExitStack() as made:  # what is made here is closed here
        if robot is None:
            robot, reach = make_session_robot(settings)
            made.callback(robot.close)
            require_simulated_robot(robot, settings)
        else:
            reach = reach_of(robot, settings)
        texts = _own_material(robot, settings) | reach_texts(reach) | dict(description or {})
        if operator is None:
            operator = make_operator(settings, surface=reach.surface, press_depth=reach.press_depth, say=say)
            made.callback(close_operator, operator)
            require_simulated_time(operator)
        to_close = made.pop_all()

    def run(record: Record | None) -> SimulatedSession:
        with to_close:
            return _run(settings, duration, operator, robot, texts, record, progress)

    return run


def _own_material(robot: Robot, settings: SessionSettings) -> dict[str, str]:
    """What the log says of the material where the robot presses one of its own, which no setting can name.

    Raises:
        SettingError: It presses another one than the settings name.
    """
    material = pressed_material(robot)
    if settings.robot != SIMULATED or material is None or material.name == settings.material:
        return {}
    if material.name in material_names():
        rule = f"the robot presses {material.name}; make it with make_robot(settings.material), or leave it out"
        raise SettingError("material", settings.material, rule)
    return {"material": material.name}


def _run(
    settings: SessionSettings,
    duration: float,
    operator: Device,
    robot: Robot,
    description: Mapping[str, str],
    record: Record | None,
    progress: Callable[[float], None] | None,
) -> SimulatedSession:
    """Tick by tick; what is given is in order."""
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
    texts = settings.as_text() | {"operator": operator.name} | felt_texts(operator, settings) | dict(description)
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
