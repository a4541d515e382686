"""Real-time runner: one process per side, joined by the network, with the same steps as in simulated time."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial

from foretouch.devices import Device, SpatialDevice
from foretouch.errors import SideError
from foretouch.link import ASKING_PERIOD_NS, FaultStage, ZenohLink, new_press
from foretouch.messages import PROCESS, SIDES, VERSION, Command, EmergencyStop, Message, Status
from foretouch.robot import Robot, SpatialRobot
from foretouch.session.network.lease import Contest, own_epoch
from foretouch.session.operators import close_operator
from foretouch.session.runners.driven import DrivenFollower, SpaceFollower, SpaceLeader, drive_follower, drive_leader
from foretouch.session.runners.housekeeping import LEAVING, ORPHANED, Housekeeper, Process, StopFlag, orphaned
from foretouch.session.runners.loop_timer import LoopTimer, let_pass, steady
from foretouch.session.runners.news import LoopWatch, all_of, follower_news, follower_says, leader_news, over
from foretouch.session.runners.warm_up import prepare
from foretouch.session.safety.safety import LEFT
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps.counting import (
    OperatorClock,
    as_texts,
    fault_texts,
    follower_counts,
    leader_counts,
    link_counts,
)

FOLLOWER_CHANNELS = ("command", "settings", "stop", "emergency", "hello")
"""Channels that the follower's link receives."""

LEADER_CHANNELS = ("model", "telemetry", "handle", "settings", "stop", "hello")
"""Channels that the leader's link receives."""

SPACE_FOLLOWER_CHANNELS = SpaceFollower.channels
"""Further channels that a follower's link receives in three dimensions."""

SPACE_LEADER_CHANNELS = SpaceLeader.channels
"""Further channels that a leader's link receives in three dimensions."""

MOST_PRESSES = 1024  # Number of emergency-stop presses remembered, so that a repeated message is recognised

ANSWERS = 1000
"""Follower ticks that must arrive, the newest confirming the stop, before an emergency stop is no longer sent."""

RECORDER_PATIENCE = 10.0  # Longest wait of a leader for a recorder that it was asked to wait for [s]


def wait_for_hello(
    link: ZenohLink, roles: set[str], stop: StopFlag, *, timeout: float | None = None, parent: int | None = None
) -> dict[str, dict[str, str]]:
    """Wait until each of these roles has sent a `Hello`; return the texts of each.

    Returns early, with what there is, when `stop` is set, after `timeout` [s], or when the process `parent` has gone.

    Raises:
        PeerVersionError: An awaited side speaks another version. Processes of one `parent` are of one version, and
            ignore a message of another.
    """
    texts_of: dict[str, dict[str, str]] = {}
    end = None if timeout is None else time.monotonic() + timeout
    while not stop.reason and not roles <= texts_of.keys():
        for _, hello in link.take("hello"):
            texts_of[hello.role] = hello.texts
        if parent is None and (error := link.other_version(roles & set(SIDES))) is not None:
            raise error
        if end is not None and time.monotonic() > end:
            break
        if orphaned(parent):
            stop.set(ORPHANED)
        time.sleep(0.01)
    return texts_of


def run_follower(
    process: Process,
    robot: Robot | SpatialRobot,
    settings: SessionSettings,
    *,
    description: dict[str, str],
    duration: float | None = None,
) -> dict[str, str | int]:
    """Run the follower's loop until a `Stop` arrives, the process's `stop` is set, or `duration` [s] is over.

    Args:
        process: Its link has `FOLLOWER_CHANNELS`, and in three dimensions `SPACE_FOLLOWER_CHANNELS`.
        robot: Robot to command; along a line it counts as the settings' follower frame says.
        settings: Session settings.
        description: Texts for the `Hello` messages.
        duration: Duration [s], None for no end.

    Returns:
        Reason for the end, as ``ended``, and the counters, by name.

    Raises:
        SideError: The loop raised.
    """
    link, stop, say, parent = process
    if never_begun := prepare(settings, stop, say, parent):
        return {"ended": never_begun}
    stage: FaultStage[Command] = FaultStage(settings.command_faults)
    presses: deque[int] = deque(maxlen=MOST_PRESSES)
    driven = drive_follower(robot, settings, own_epoch())
    state = driven.state
    contest = Contest(state.lease)
    changed_ns = 0

    def describe() -> dict[str, str]:
        contested = contest.sentence(time.monotonic_ns())
        reported = follower_says(state, contested, anew=house.leader_leaves) | as_texts(
            follower_counts(state) | link_counts("follower", link)
        )
        return description | fault_texts(stage, "position_delay", changed_ns) | reported

    def news(_: Mapping[str, Mapping[str, str]]) -> str:
        return all_of(contest.sentence(time.monotonic_ns()), follower_news(state, anew=house.leader_leaves))

    house = Housekeeper(process, "follower", describe, news, release=robot.close, over=lambda: over(state))
    house.start()
    loop = house.loop
    timer = LoopTimer(SAMPLE_PERIOD)
    simulated = robot.specification.simulated
    woke, compute = 0, 0
    end = None if duration is None else time.monotonic_ns() + round(duration * 1e9)
    # The last message is sent last: until then the watch detects a driver that hangs while the robot unloads.
    with ended_in_order(house, stop), steady(), contextlib.ExitStack() as last:
        last.callback(_leave, driven, timer, loop, link.publish, say)
        while not stop.reason:
            now, periods = timer.wait()
            loop.ticked = now
            let_pass(driven.exchange, periods, simulated=simulated)
            for arrival, command in link.take("command"):
                contest.hear(command, arrival)
                stage.push(arrival, command)
            if link.inboxes["settings"]:
                chosen = link.take("settings")[-1][1]
                stage.change(delay=chosen.position_delay, jitter=chosen.jitter, loss=chosen.loss, outage=chosen.outage)
                changed_ns = now
                state.freshness.begin_way()
            for _, last_word in link.take("stop"):
                if last_word.epoch in (0, state.lease.epoch):
                    stop.set(last_word.reason or "the session was ended")
            if end is not None and now >= end:
                stop.set("the duration is over")
            # Cleared only if set: a signal may come at any moment and must not be lost.
            emergency, release = stop.emergency, stop.release
            if emergency:
                stop.emergency = ""
            if release:
                stop.release = False
            for _, asked in link.take("emergency"):  # no simulated fault delays it
                if asked.press not in presses:
                    emergency = emergency or asked.reason or "no reason given"
                    if asked.press:
                        presses.append(asked.press)
            driven.listen(link)
            due, period = stage.pop_due(now), timer.woke_ns - woke if woke else 0
            woke = timer.woke_ns
            start = time.perf_counter_ns()
            messages = driven.tick(due, period, compute, now, stop=emergency, release=release)
            compute = time.perf_counter_ns() - start
            for message in messages:
                link.publish(message)
    return {"ended": stop.reason} | follower_counts(state) | link_counts("follower", link)


def _leave(
    driven: DrivenFollower,
    timer: LoopTimer,
    loop: LoopWatch,
    publish: Callable[[Message], None],
    say: Callable[[str], None],
) -> None:
    """Leave no robot pressing, however a loop ends, including by an exception of its own or of the robot's driver.

    It acts as after a long silence, until the robot feels next to nothing, for at most `LEAVING`. A driver that raised
    may accept the next command. Where a tick raises, the robot retreats according to the force in its newest sample.
    """
    end = time.monotonic() + LEAVING
    failures = driven.state.failures
    learns, failures.learns = failures.learns, False  # learning may be what raised
    deaf = False
    while _presses(driven) and time.monotonic() < end:
        now, _ = timer.wait()
        loop.ticked = now
        try:
            driven.exchange()
            deaf = False
        except Exception:
            deaf = True
            continue
        try:
            messages = driven.tick([], 0, 0, now, ended=True)
        except Exception:
            with contextlib.suppress(Exception):  # it holds its position
                driven.back_off()
            continue
        with contextlib.suppress(Exception):  # unloading comes first, whether or not it is published
            for message in messages:
                publish(message)
    failures.learns = learns  # the last message reports the session as it was
    if deaf:
        say("follower: the robot takes no commands any more and pressed last: stop it by its own switch")


def _presses(driven: DrivenFollower) -> bool:
    """Whether the robot feels more than next to nothing or, if its force is unknown, has not yet retraced its path."""
    safety, sample = driven.state.safety, driven.state.learner.sample
    if safety.status is Status.SENSOR_FAULT:
        return safety.pressing
    return sample.in_contact and sample.force > LEFT


def run_leader(
    process: Process,
    operator: Device | SpatialDevice,
    settings: SessionSettings,
    *,
    description: dict[str, str],
    duration: float | None = None,
    wait_for_recorder: bool = False,
    name: str = "leader",
) -> dict[str, str | int]:
    """Run the leader's loop until a `Stop` arrives, `stop` is set, or `duration` [s] is over.

    Arguments as for `run_follower`; the link has `LEADER_CHANNELS`, and in three dimensions `SPACE_LEADER_CHANNELS`;
    `operator` moves the handle, and along a line counts as the settings' leader frame says; with `wait_for_recorder`
    the loop begins once a recorder listens, or after `RECORDER_PATIENCE`. Other leaders receive the `name` of this
    one. Returns and raises as that does.
    """
    link, stop, say, parent = process
    if never_begun := prepare(settings, stop, say, parent):
        return {"ended": never_begun}
    stage: FaultStage[Message] = FaultStage(settings.return_faults)
    driven = drive_leader(operator, settings, name, own_epoch())
    state = driven.state
    clock = OperatorClock(operator)
    changed_ns = 0

    def describe() -> dict[str, str]:
        own = {"leader": name, PROCESS: str(state.epoch)} | fault_texts(stage, "force_delay", changed_ns, "return_")
        return description | own | as_texts(leader_counts(state) | link_counts("leader", link))

    heard_ns = time.monotonic_ns()

    lost_before = 0

    def news(texts_of: Mapping[str, Mapping[str, str]]) -> str:
        nonlocal lost_before
        nowhere, lost_before = driven.nowhere > lost_before, driven.nowhere
        silence = (time.monotonic_ns() - heard_ns) * 1e-9
        return leader_news(
            state.follower_view, texts_of.get("follower", {}), silence, nowhere=nowhere, told_here=parent is not None
        )

    house = Housekeeper(
        process,
        "leader",
        describe,
        news,
        epoch=state.epoch,
        release=partial(close_operator, operator) if isinstance(operator, Device) else None,
        over=lambda: "that is over: the robot follows this leader",
    )
    house.start()
    loop = house.loop
    if wait_for_recorder and not wait_for_hello(link, {"recorder"}, stop, timeout=RECORDER_PATIENCE, parent=parent):
        say(f"leader: no recorder after {RECORDER_PATIENCE:g} s; going on without it")
    timer = LoopTimer(SAMPLE_PERIOD)
    woke, compute = 0, 0
    asked, asked_ns, press, answered = 0, 0, 0, 0
    end = None if duration is None else time.monotonic_ns() + round(duration * 1e9)
    with ended_in_order(house, stop), steady():
        while not stop.reason:
            now, _ = timer.wait()
            loop.ticked = now
            operator_ns = clock.read(now, coupled=state.follower_view.run > 0)
            for channel in ("model", "telemetry", *driven.channels):
                for arrival, message in link.take(channel):
                    stage.push(arrival, message)
                    heard_ns = arrival
            if stop.emergency and not press:
                press, answered = new_press(), state.follower_view.telemetry.received + ANSWERS
            if press and now - asked_ns >= ASKING_PERIOD_NS:
                asked, asked_ns = asked + 1, now
                link.publish(EmergencyStop(VERSION, asked, now, f"{stop.emergency} at {name}", press))
            # A message that it has stopped may have been under way since an earlier stop.
            if press and state.follower_view.stopped and state.follower_view.telemetry.received >= answered:
                stop.emergency, press = "", 0
            if link.inboxes["settings"]:
                chosen = link.take("settings")[-1][1]
                stage.change(delay=chosen.force_delay, jitter=chosen.jitter, loss=chosen.loss, outage=chosen.outage)
                changed_ns = now
            if link.inboxes["stop"]:
                stop.set(link.take("stop")[-1][1].reason or "the session was ended")
            if link.inboxes["handle"]:
                driven.take(link.take("handle")[-1][1], operator_ns)
            if end is not None and now >= end:
                stop.set("the duration is over")
            due, period = stage.pop_due(now), timer.woke_ns - woke if woke else 0
            woke = timer.woke_ns
            start = time.perf_counter_ns()
            messages = driven.tick(due, operator_ns, period, compute, now, stop=bool(stop.emergency))
            compute = time.perf_counter_ns() - start
            for message in messages:
                link.publish(message)
    return {"ended": stop.reason} | leader_counts(state) | link_counts("leader", link)


@contextmanager
def ended_in_order(house: Housekeeper, stop: StopFlag) -> Iterator[None]:
    """Send why a side ends as its last message, also where its loop raises, as a device's or robot's driver may.

    Raises:
        SideError: From whatever exception the loop raised.
    """
    try:
        yield
    except Exception as error:
        failed = SideError(f"the {house.role} failed: {type(error).__name__}: {error}")
        stop.set(str(failed))
        raise failed from error
    else:
        house.say_end(stop.reason)
    finally:
        house.close(stop.reason)
