"""Real-time runner: one process per side, joined by the network, with the same steps as in simulated time."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

from foretouch.devices import Device, SpatialDevice
from foretouch.errors import ForetouchError, SideError
from foretouch.identification import Estimator
from foretouch.link import ASKING_PERIOD_NS, FaultStage, ZenohLink, new_press
from foretouch.messages import COUNT_PREFIX, PROCESS, SIDES, SINCE, VERSION, EmergencyStop, Message, Status
from foretouch.robot import Robot, SpatialRobot
from foretouch.session.network.lease import Contest, own_epoch
from foretouch.session.operators import close_operator
from foretouch.session.runners.channels import hear_packets, join_thin, take_images
from foretouch.session.runners.driven import (
    Driven,
    DrivenFollower,
    Tick,
    drive_follower,
    drive_leader,
)
from foretouch.session.runners.housekeeping import LEAVING, ORPHANED, Housekeeper, Process, StopFlag, orphaned
from foretouch.session.runners.loop_timer import LoopTimer, steady
from foretouch.session.runners.news import LoopWatch, all_of, follower_news, follower_says, leader_news, over
from foretouch.session.runners.warm_up import prepare
from foretouch.session.safety.safety import LEFT
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.thin import FollowerEnd, LeaderEnd

PATIENCE_NS = 5_000_000_000  # Age from which on what asked for an emergency stop has given up [ns]
MOST_PRESSES = 1024  # Number of emergency-stop presses remembered, so that a repeated message is recognised

ANSWERS = 1000
"""Follower ticks that must arrive, the newest confirming the stop, before an emergency stop is no longer sent."""

RECORDER_PATIENCE = 10.0  # Longest wait of a leader for a recorder that it was asked to wait for [s]


def wait_for_hello(
    link: ZenohLink,
    roles: set[str],
    stop: StopFlag,
    *,
    timeout: float | None = None,
    parent: int | None = None,
    meanwhile: Callable[[], object] = bool,
) -> dict[str, dict[str, str]]:
    """Wait until each of these roles has sent a `Hello`; return the texts of each.

    Returns early, with what there is, when `stop` is set, after `timeout` [s], or when the process `parent` has gone.
    `meanwhile` is called again and again.

    Raises:
        PeerVersionError: An awaited side speaks another version. Processes of one `parent` are of one version, and
            ignore a message of another.
    """
    texts_of: dict[str, dict[str, str]] = {}
    end = None if timeout is None else time.monotonic() + timeout
    while not stop.reason and not roles <= texts_of.keys():
        meanwhile()
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


@contextmanager
def ended_in_order(house: Housekeeper, stop: StopFlag) -> Iterator[None]:
    """Send why a side ends as its last message, also where its loop raises, as a device's or robot's driver may.

    Raises:
        SideError: From whatever exception the loop raised.
    """
    try:
        yield
    except Exception as error:
        said = str(error) if isinstance(error, ForetouchError) else f"{type(error).__name__}: {error}"
        failed = SideError(f"the {house.role} failed: {said}")
        stop.set(str(failed))
        raise failed from error
    else:
        house.say_end(stop.reason)
    finally:
        house.close(stop.reason)


def link_counts(role: str, link: ZenohLink) -> dict[str, int]:
    """Messages that a side's link could not take or send."""
    return {f"{role}_undecodable": link.undecodable, f"{role}_unsent": link.unsent}


def as_texts(counts: dict[str, int]) -> dict[str, str]:
    """Counters as texts of a `Hello`; the recorder tells them from settings by the prefix."""
    return {COUNT_PREFIX + name: str(value) for name, value in counts.items()}


def fault_texts(stage: FaultStage[Any], delay: str, changed_ns: int, prefix: str = "") -> dict[str, str]:
    """Faults that a side applies to arriving messages, as settings of its `Hello`; no other side knows them.

    `delay` names the setting of their delay, `changed_ns` is their last change by the side's own clock, 0 for never,
    and `prefix` stands before the other names: ``"return_"`` for those of models and telemetry.
    """
    faults = {f"{prefix}{name}": str(getattr(stage.faults, name)) for name in ("jitter", "loss", "outage")}
    if stage.faults.network:
        faults[f"{prefix}network"] = stage.faults.network
    return {delay: str(stage.delay)} | faults | ({SINCE: str(changed_ns)} if changed_ns else {})


class Loop:
    """The loop of a side in real time: every sample period it takes messages, lets the side act and publishes.

    Args:
        process: Process of the side.
        role: Role of the side.
        driven: The side with its machine.
        prefix: Prefix of the names of the faults of what arrives, its delay apart.
    """

    def __init__(self, process: Process, role: str, driven: Driven, prefix: str = "") -> None:
        self._link, self._stop, self._role = process.link, process.stop, role
        join_thin(process.link, driven.end)
        self._driven, self._prefix, self._changed_ns = driven, prefix, 0

    def counts(self) -> dict[str, int]:
        """Counters of the side and its link, by name."""
        return self._driven.counts() | link_counts(self._role, self._link)

    def texts(self) -> dict[str, str]:
        """Faults of what arrives, and the counters, for the `Hello`."""
        driven = self._driven
        return fault_texts(driven.arriving, driven.delay, self._changed_ns, self._prefix) | as_texts(self.counts())

    def choose(self, now_ns: int) -> bool:
        """Apply faults that were chosen at the console; return whether any were."""
        if not self._link.inboxes["settings"]:
            return False
        chosen, driven = self._link.take("settings")[-1][1], self._driven
        delay = getattr(chosen, driven.delay)
        driven.arriving.change(delay=delay, jitter=chosen.jitter, loss=chosen.loss, outage=chosen.outage)
        self._changed_ns = now_ns
        return True

    def run(
        self,
        house: Housekeeper,
        hear: Callable[[int], tuple[str, bool]],
        duration: float | None,
        leave: Callable[[LoopTimer], None] = lambda timer: None,
    ) -> dict[str, Any]:
        """Run until the process's `stop` is set or `duration` [s] is over; return why, and the counters.

        Args:
            house: The work beside the loop, already begun.
            hear: Takes the messages that have come by this time [ns]; returns why an emergency stop is requested, and
                whether its end is.
            duration: Duration [s], None for no end.
            leave: Leaves the machine, however the loop ends.

        Raises:
            SideError: The loop raised.
        """
        stop, driven, loop = self._stop, self._driven, house.loop
        timer, woke = LoopTimer(SAMPLE_PERIOD), 0
        end = None if duration is None else time.monotonic_ns() + round(duration * 1e9)
        # The last message is sent last: until then the watch detects a driver that hangs while the robot unloads.
        with ended_in_order(house, stop), steady(), contextlib.ExitStack() as last:
            last.callback(leave, timer)
            while not stop.reason:
                now, periods = timer.wait()
                loop.ticked = now
                driven.pass_time(periods)
                stopped, released = hear(now)
                if end is not None and now >= end:
                    stop.set("the duration is over")
                period, woke = timer.woke_ns - woke if woke else 0, timer.woke_ns
                for message in driven.tick(Tick(now, period, driven.computed_ns, stopped, released)):
                    self._link.publish(message)
        return {"ended": stop.reason} | self.counts()


def run_follower(
    process: Process,
    robot: Robot | SpatialRobot,
    settings: SessionSettings,
    *,
    description: dict[str, str],
    duration: float | None = None,
    keep: Callable[[Estimator], object] | None = None,
) -> dict[str, Any]:
    """Run the follower's loop until a `Stop` arrives, the process's `stop` is set, or `duration` [s] is over.

    Args:
        process: Its link has `FOLLOWER_CHANNELS`.
        robot: Robot to command; it counts as the settings' follower frame says.
        settings: Session settings.
        description: Texts for the `Hello` messages.
        duration: Duration [s], None for no end.
        keep: Called with what has learnt, after an end in order.

    Returns:
        Reason for the end, as ``ended``, and the counters, by name.

    Raises:
        SideError: The loop raised.
    """
    link, stop, say, parent, _ = process
    if never_begun := prepare(settings, stop, say, parent):
        return {"ended": never_begun}
    presses: deque[int] = deque(maxlen=MOST_PRESSES)
    driven = drive_follower(robot, settings, own_epoch())
    state = driven.state
    contest = Contest(state.lease)

    def describe() -> dict[str, str]:
        contested = contest.sentence(time.monotonic_ns())
        return description | loop.texts() | follower_says(state, contested, robot.says, anew=house.leader_leaves)

    def news(_: Mapping[str, Mapping[str, str]]) -> str:
        contested = contest.sentence(time.monotonic_ns())
        return all_of(contested, follower_news(state, robot.says, anew=house.leader_leaves))

    def hear(now: int) -> tuple[str, bool]:
        for arrival, message in link.take("command" if driven.end is None else driven.end.from_other):
            if driven.end is None:
                contest.hear(message, arrival)
            driven.arriving.push(arrival, message)
        take_images(link, driven.end)
        if loop.choose(now):
            state.freshness.begin_way()
        for _, last_word in link.take("stop"):
            if last_word.epoch in (0, state.lease.epoch):
                stop.set(last_word.reason or "the session was ended")
        emergency, release = stop.take()
        for _, asked in link.take("emergency"):  # no simulated fault delays it
            if asked.press not in presses:
                emergency = emergency or asked.reason or "no reason given"
                if asked.press:
                    presses.append(asked.press)
        for channel in driven.channels:
            driven.beliefs = [belief for _, belief in link.take(channel)]
        return emergency, release

    loop = Loop(process, "follower", driven)
    house = Housekeeper(process, "follower", describe, news, release=robot.close, over=lambda: over(state))
    house.start()
    ran = loop.run(house, hear, duration, leave=partial(_leave, driven, house.loop, link.publish, say))
    if keep is not None:
        keep(state.learner.estimator)
    return ran


def _leave(
    driven: DrivenFollower,
    loop: LoopWatch,
    publish: Callable[[Message], None],
    say: Callable[[str], None],
    timer: LoopTimer,
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
            messages = driven.act([], Tick(now, ended=True))
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
) -> dict[str, Any]:
    """Run the leader's loop until a `Stop` arrives, `stop` is set, or `duration` [s] is over.

    Arguments as for `run_follower`; the link has `LEADER_CHANNELS`. `operator` moves the handle, and
    counts as the settings' leader frame says. With `wait_for_recorder` the loop begins once a recorder listens, or
    after `RECORDER_PATIENCE`. Other leaders receive the `name` of this one. Returns and raises as that does.
    """
    link, stop, say, parent, _ = process
    if never_begun := prepare(settings, stop, say, parent):
        return {"ended": never_begun}
    driven = drive_leader(operator, settings, name, own_epoch())
    if process.end is not None:
        driven.end = process.end
    channels = ("model", "telemetry", *driven.channels) if driven.end is None else (driven.end.from_other,)
    view, epoch = driven.state.follower_view, driven.state.epoch
    heard_ns, lost_before = time.monotonic_ns(), 0
    asked, asked_ns, press, answered, passed = 0, 0, 0, 0, 0

    def news(texts_of: Mapping[str, Mapping[str, str]]) -> str:
        nonlocal lost_before
        nowhere, lost_before = driven.nowhere > lost_before, driven.nowhere
        silence = (time.monotonic_ns() - heard_ns) * 1e-9
        return leader_news(view, texts_of.get("follower", {}), silence, nowhere=nowhere, told_here=parent is not None)

    def hear(now: int) -> tuple[str, bool]:
        nonlocal heard_ns, asked, asked_ns, press, answered, passed
        for channel in channels:
            for arrival, message in link.take(channel):
                driven.arriving.push(arrival, message)
                heard_ns = arrival
        for arrival, asks in link.take("emergency"):  # over a thin link this is who asks the robot
            if asks.press != passed and now - arrival < PATIENCE_NS and not press:
                stop.emergency, press, passed = asks.reason or "no reason given", asks.press, asks.press
                answered = view.telemetry.received + ANSWERS
        if stop.emergency and not press:
            press, answered = new_press(), view.telemetry.received + ANSWERS
        if press and now - asked_ns >= ASKING_PERIOD_NS:
            asked, asked_ns = asked + 1, now
            link.publish(EmergencyStop(VERSION, asked, now, f"{stop.emergency} at {name}", press))
        # A message that it has stopped may have been under way since an earlier stop.
        if press and view.stopped and view.telemetry.received >= answered:
            stop.emergency, press = "", 0
        loop.choose(now)
        if link.inboxes["stop"]:
            stop.set(link.take("stop")[-1][1].reason or "the session was ended")
        if link.inboxes["handle"]:
            driven.take(link.take("handle")[-1][1], now)
        return stop.emergency, False

    loop = Loop(process, "leader", driven, "return_")
    house = Housekeeper(
        process,
        "leader",
        lambda: description | {"leader": name, PROCESS: str(epoch)} | loop.texts(),
        news,
        epoch=epoch,
        release=partial(close_operator, operator),
        over=lambda: "that is over: the robot follows this leader",
    )
    house.start()
    if wait_for_recorder and not _recorder_listens(link, driven.end, stop, parent):
        say(f"leader: no recorder after {RECORDER_PATIENCE:g} s; going on without it")
    return loop.run(house, hear, duration)


def _recorder_listens(link: ZenohLink, end: LeaderEnd | FollowerEnd | None, stop: StopFlag, parent: int | None) -> bool:
    """Wait for a recorder; whether one listens. Over a thin link hellos are heard for that time alone."""
    wait = partial(wait_for_hello, link, {"recorder"}, stop, timeout=RECORDER_PATIENCE, parent=parent)
    if end is None:
        return bool(wait())
    with link.hearing("hello"):
        return bool(wait(meanwhile=partial(hear_packets, link, end)))
