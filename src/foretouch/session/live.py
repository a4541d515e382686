"""The runner in real time: one process a side, joined by the network; the same steps as in simulated time."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from foretouch.devices import Device
from foretouch.link import FaultStage, ZenohLink
from foretouch.messages import COUNT_PREFIX, Command, ModelUpdate, Telemetry
from foretouch.robot import Robot
from foretouch.session import follower, leader
from foretouch.session.counting import follower_counts, leader_counts
from foretouch.session.frames import browser_operator, framed_device, framed_robot
from foretouch.session.housekeeping import ORPHANED, Housekeeper, StopFlag, orphaned
from foretouch.session.loop_timer import LoopTimer
from foretouch.session.operator_clock import OperatorClock
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.sides import leading_side
from foretouch.session.warm_up import warm_up

__all__ = ["FOLLOWER_CHANNELS", "LEADER_CHANNELS", "run_follower", "run_leader", "wait_for_hello"]

FOLLOWER_CHANNELS = ("command", "settings", "stop", "hello")
"""What the follower's link receives."""

LEADER_CHANNELS = ("model", "telemetry", "handle", "settings", "stop", "hello")
"""What the leader's link receives."""

LONGEST_CATCH_UP = 50
"""A simulated robot that was held up lets at most so many sample periods pass at once."""

RECORDER_PATIENCE = 10.0
"""A leader that was told to wait for a recorder waits at most so long [s]."""


@contextmanager
def _steady() -> Iterator[None]:
    """Keep the garbage collector out of a loop whose messages and states make no cycles, and other threads short."""
    switch = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(5e-4)
    try:
        yield
    finally:
        sys.setswitchinterval(switch)
        gc.enable()
        gc.unfreeze()


def wait_for_hello(
    link: ZenohLink, roles: set[str], stop: StopFlag, *, timeout: float | None = None, parent: int | None = None
) -> dict[str, dict[str, str]]:
    """Wait until each of these roles has said hello; return what each said.

    Returns early, with what there is, when `stop` is set, after `timeout` [s], or when the process `parent`, whose
    end ends this one, has gone.

    Raises:
        PeerVersionError: A peer speaks another version.
    """
    heard: dict[str, dict[str, str]] = {}
    end = None if timeout is None else time.monotonic() + timeout
    while not stop.reason and not roles <= heard.keys():
        for _, hello in link.take("hello"):
            heard[hello.role] = dict(zip(hello.names, hello.values, strict=False))
        if link.version_error is not None:
            raise link.version_error
        if end is not None and time.monotonic() > end:
            break
        if orphaned(parent):
            stop.set(ORPHANED)
        time.sleep(0.01)
    return heard


def run_follower(
    link: ZenohLink,
    robot: Robot,
    settings: SessionSettings,
    *,
    stop: StopFlag,
    say: Callable[[str], None],
    description: dict[str, str],
    duration: float | None = None,
    parent: int | None = None,
) -> None:
    """Run the follower's loop until a `Stop` arrives, `stop` is set, or `duration` [s] is over.

    Args:
        link: With `FOLLOWER_CHANNELS`.
        robot: To command; counts as the settings' follower frame says.
        settings: Of the session.
        stop: Looked at in every tick.
        say: Prints one line for people.
        description: Texts for the `Hello` messages.
        duration: [s], None for no end.
        parent: Process whose end ends this one.

    Raises:
        PeerVersionError: Before the first command that could be read, the peer spoke another version.
    """
    warm_up(settings)
    robot = framed_robot(robot, settings.frames[1])
    stage: FaultStage[Command] = FaultStage(settings.command_faults)
    state = follower.start(robot.specification, settings)

    def describe() -> dict[str, str]:
        return description | _as_text(follower_counts(state) | _link_counts("follower", link))

    house = Housekeeper(link, "follower", describe, stop, say, parent)
    house.start()
    timer = LoopTimer(SAMPLE_PERIOD)
    sample = robot.read()
    desired_position = sample.commanded_position
    woke, compute = 0, 0
    end = None if duration is None else time.monotonic_ns() + round(duration * 1e9)
    with _steady():
        while not stop.reason:
            now, periods = timer.wait()
            for _ in range(min(periods, LONGEST_CATCH_UP)):
                sample = robot.exchange(desired_position)
            for arrival, command in link.take("command"):
                stage.push(arrival, command)
            if link.inboxes["settings"]:
                stage.delay = link.take("settings")[-1][1].position_delay
            if link.inboxes["stop"]:
                stop.set(link.take("stop")[-1][1].reason)
            if end is not None and now >= end:
                stop.set("the duration is over")
            if link.version_error is not None and not state.commands.received:
                stop.set(str(link.version_error))
            inputs = follower.Inputs(stage.pop_due(now), sample, timer.woke_ns - woke if woke else 0, compute)
            woke = timer.woke_ns
            start = time.perf_counter_ns()
            state, outputs = follower.step(state, inputs, now)
            compute = time.perf_counter_ns() - start
            link.publish(outputs.telemetry)
            if outputs.model is not None:
                link.publish(outputs.model)
            desired_position = outputs.desired_position
    house.close(stop.reason)
    if link.version_error is not None and not state.commands.received:
        raise link.version_error


def run_leader(
    link: ZenohLink,
    operator: Device,
    settings: SessionSettings,
    *,
    stop: StopFlag,
    say: Callable[[str], None],
    description: dict[str, str],
    duration: float | None = None,
    wait_for_recorder: bool = False,
    parent: int | None = None,
) -> None:
    """Run the leader's loop until a `Stop` arrives, `stop` is set, or `duration` [s] is over.

    Arguments as for `run_follower`; `link` has `LEADER_CHANNELS`, `operator` moves the handle and counts as the
    settings' leader frame says, and with `wait_for_recorder` the loop begins once a recorder listens, or after
    `RECORDER_PATIENCE`.
    """
    warm_up(settings)
    stage: FaultStage[ModelUpdate | Telemetry] = FaultStage(settings.return_faults)
    side = leading_side(settings)
    state = side.start(settings)
    operator = framed_device(operator, settings.frames[0])
    clock = OperatorClock(operator)
    mouse = browser_operator(operator)

    def describe() -> dict[str, str]:
        return description | _as_text(leader_counts(state) | _link_counts("leader", link))

    house = Housekeeper(link, "leader", describe, stop, say, parent)
    house.start()
    if wait_for_recorder and not wait_for_hello(link, {"recorder"}, stop, timeout=RECORDER_PATIENCE):
        say(f"leader: no recorder after {RECORDER_PATIENCE:g} s; going on without it")
    timer = LoopTimer(SAMPLE_PERIOD)
    woke, compute = 0, 0
    end = None if duration is None else time.monotonic_ns() + round(duration * 1e9)
    with _steady():
        while not stop.reason:
            now, _ = timer.wait()
            operator_ns = clock.read(now, coupled=state.telemetry.newest > 0)
            for name in ("model", "telemetry"):
                for arrival, message in link.take(name):
                    stage.push(arrival, message)
            if link.inboxes["settings"]:
                stage.delay = link.take("settings")[-1][1].force_delay
            if link.inboxes["stop"]:
                stop.set(link.take("stop")[-1][1].reason)
            if link.inboxes["handle"]:
                handle = link.take("handle")[-1][1]
                if mouse is not None:
                    mouse.take(handle.position, handle.held, operator_ns, clutched=handle.clutched)
            if end is not None and now >= end:
                stop.set("the duration is over")
            due = stage.pop_due(now)
            start = time.perf_counter_ns()
            inputs = leader.Inputs(
                operator.read(operator_ns),
                [message for message in due if type(message) is ModelUpdate],
                [message for message in due if type(message) is Telemetry],
                timer.woke_ns - woke if woke else 0,
                compute,
                operator.clutched,
                operator.exact_position,
                operator.intention,
            )
            woke = timer.woke_ns
            state, outputs = side.step(state, inputs, now)
            compute = time.perf_counter_ns() - start
            link.publish(outputs.command)
            operator.render(outputs.record.rendered_force)
            link.publish(outputs.record)
    house.close(stop.reason)


def _link_counts(role: str, link: ZenohLink) -> dict[str, int]:
    return {f"{role}_undecodable": link.undecodable, f"{role}_unsent": link.unsent}


def _as_text(counts: dict[str, int]) -> dict[str, str]:
    """Counters as texts of a `Hello`; the recorder tells them from settings by the prefix."""
    return {COUNT_PREFIX + name: str(value) for name, value in counts.items()}
