"""How a session ends and how a robot is stopped: who may say so, how long it is said, and what it leaves behind."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import numpy as np
import pytest
from lap import MS, Lap
from step_links import Ticks

from foretouch.devices import ScriptedOperator
from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import VERSION, Command, EmergencyStop, Message, Status, Stop, Telemetry
from foretouch.robot import FaultySensor, Robot, RobotSample, SensorFault, make_robot
from foretouch.session import (
    FOLLOWER_CHANNELS,
    LEADER_CHANNELS,
    Process,
    SessionSettings,
    StopFlag,
    run_follower,
    run_leader,
)
from foretouch.session.runners import live
from foretouch.session.runners.driven import LineFollower
from foretouch.session.runners.news import LoopWatch
from foretouch.session.safety.kernel import REST_FORCE
from foretouch.session.steps.follower_view import MOST_OF_FORMER, FollowerView

SETTINGS = SessionSettings(material="hunt-crossley", position_delay=0.0, force_delay=0.0)
TELEMETRY = Telemetry(VERSION, 1, 1, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, False, 0, 1, 1)


# --- a session that ends in contact -----------------------------------------------------------------------------------


class Deaf(Robot):
    def __init__(self, robot: Robot) -> None:
        self.robot, self.specification = robot, robot.specification
        self.sample = robot.read()

    def read(self) -> RobotSample:
        return self.sample

    def exchange(self, desired_position: float) -> RobotSample:
        noise = 0.01 * float(np.sin(1e3 * time.perf_counter()))
        return self.sample._replace(sensor_force=self.sample.sensor_force + noise)


def pressing() -> Lap:
    lap = Lap.led(6.0)
    for _ in range(600):
        if lap.run(0.01)[-1].force > 2.0:
            return lap
    raise AssertionError("nothing was pressed")


def driven(lap: Lap, robot: Any) -> LineFollower:
    made = LineFollower(robot, SessionSettings(), 1)
    made.state = lap.following
    return made


def leave(follower: LineFollower, timer: Any) -> tuple[LoopWatch, list[Message]]:
    loop, output = LoopWatch(0.5), []
    live._leave(follower, loop, output.append, lambda line: None, timer)
    return loop, output


def test_a_robot_in_contact_is_unloaded_as_a_session_leaves_it_and_one_in_free_air_is_left_at_once() -> None:
    lap = pressing()
    timer: Any = Ticks(begin_ns=lap.now)
    loop, output = leave(driven(lap, lap.robot), timer)
    assert lap.following.learner.sample.force < REST_FORCE
    assert lap.robot.read().exact_force < REST_FORCE + 0.1
    assert 5 < timer.count < 1000
    assert lap.following.safety.status == Status.UNLOADING
    assert loop.ticked == timer.woke_ns  # a driver that hangs now is noticed
    assert sum(isinstance(message, Telemetry) for message in output) == timer.count
    lap = Lap.led(0.5)
    timer: Any = Ticks(begin_ns=lap.now)
    leave(driven(lap, lap.robot), timer)
    assert timer.count == 0


def test_one_that_does_not_come_out_keeps_nobody_for_longer_than_that(monkeypatch: pytest.MonkeyPatch) -> None:
    assert live.LEAVING == 3.0
    monkeypatch.setattr(live, "LEAVING", 0.2)
    lap = pressing()
    timer: Any = Ticks(begin_ns=lap.now)
    begun = time.monotonic()
    leave(driven(lap, Deaf(lap.robot)), timer)
    assert 0.2 <= time.monotonic() - begun < 1.0
    assert lap.following.learner.sample.force > REST_FORCE


# --- the follower's loop ----------------------------------------------------------------------------------------------


class Operator(threading.Thread):
    """Commands a follower as a leader of one epoch does, 500 times a second: in free air, or deeper."""

    def __init__(self, link: ZenohLink, surface: float, epoch: int) -> None:
        super().__init__()
        self.link, self.surface, self.epoch = link, surface, epoch
        self.deepest = -0.003
        self.heard: list[Telemetry] = []
        self.ended = threading.Event()

    def run(self) -> None:
        begun, depth = time.monotonic_ns(), -0.003
        while not self.ended.wait(0.002):
            now = time.monotonic_ns()
            number = 1 + (now - begun) // MS
            depth = min(depth + 5e-5, self.deepest) if depth < self.deepest else max(depth - 5e-5, self.deepest)
            command = Command(VERSION, number, now, self.surface + depth, 0, False, "anna", self.epoch)
            self.link.publish(command)
            self.heard += [telemetry for _, telemetry in self.link.take("telemetry")]

    def until(self, holds: Callable[[Telemetry], bool], seconds: float = 5.0) -> Telemetry:
        begun, end = len(self.heard), time.monotonic() + seconds
        while time.monotonic() < end:
            for telemetry in self.heard[begun:]:
                if holds(telemetry):
                    return telemetry
            time.sleep(0.005)
        raise AssertionError(f"not within {seconds} s; the newest: {self.heard[-1:]}")


@contextmanager
def following() -> Iterator[tuple[Operator, StopFlag, threading.Thread, Robot]]:
    robot = make_robot("hunt-crossley", seed=0)
    endpoint, stop, epoch = free_endpoint(), StopFlag(), 2**40
    with (
        ZenohLink(listen=[endpoint], subscribe=FOLLOWER_CHANNELS) as link,
        ZenohLink(connect=[endpoint], subscribe=["telemetry"]) as other,
    ):
        process = Process(link, stop, lambda line: None)
        arguments: dict[str, Any] = {"description": {}, "duration": 30.0}
        loop = threading.Thread(target=run_follower, args=(process, robot, SETTINGS), kwargs=arguments)
        operator = Operator(other, robot.surface, epoch)
        loop.start()
        operator.start()
        try:
            yield operator, stop, loop, robot
        finally:
            operator.ended.set()
            operator.join()
            stop.set("the test is over")
            loop.join()


@pytest.mark.live
def test_only_who_has_control_or_nobody_s_leader_ends_the_session_and_it_ends_unloaded() -> None:
    with following() as (operator, stop, loop, robot):
        operator.until(lambda telemetry: telemetry.epoch == operator.epoch)
        operator.link.publish(Stop(VERSION, 1, 1, "bert goes home", operator.epoch + 1))
        operator.deepest = 0.006
        operator.until(lambda telemetry: telemetry.force > 2.0 * REST_FORCE)
        assert stop.reason == ""  # a leader without control ends nobody's session
        operator.link.publish(Stop(VERSION, 2, 1, "anna goes home", operator.epoch))
        loop.join(10.0)
        assert not loop.is_alive()
        assert stop.reason == "anna goes home"
        assert 0.0 < robot.read().exact_force < 2.0 * REST_FORCE


@pytest.mark.live
def test_a_press_of_the_emergency_stop_that_comes_again_after_the_release_stops_nobody() -> None:
    def asks(press: int) -> None:
        operator.link.publish(EmergencyStop(VERSION, 1, 1, "somebody shouted", press))

    def stopped(telemetry: Telemetry) -> bool:
        return telemetry.status == Status.STOPPED

    def release() -> None:
        end = time.monotonic() + 5.0
        while stopped(operator.heard[-1]):  # a moving robot is not released
            assert time.monotonic() < end
            stop.release = True
            time.sleep(0.05)

    with following() as (operator, stop, _, _):
        operator.until(lambda telemetry: telemetry.epoch == operator.epoch)
        asks(7)
        operator.until(stopped)
        release()
        for _ in range(3):
            asks(7)  # it was under way for long
        newest = operator.heard[-1].sequence
        told = operator.until(lambda telemetry: telemetry.sequence > newest + 150)
        assert not stopped(told)
        assert not any(stopped(one) for one in operator.heard[-100:])
        asks(8)
        operator.until(stopped)
        release()
        asks(0)  # one without a number is always meant
        operator.until(stopped)
        release()
        asks(0)
        operator.until(stopped)


# --- the leader's loop ------------------------------------------------------------------------------------------------


@pytest.mark.live
def test_a_leader_asks_until_a_thousand_ticks_after_the_press_say_that_the_robot_has_stopped() -> None:
    endpoint, stop = free_endpoint(), StopFlag()
    asked: list[EmergencyStop] = []
    sequence = 0

    def tell(ticks: int, status: Status) -> None:
        nonlocal sequence
        for _ in range(ticks):
            sequence += 1
            link.publish(msgspec.structs.replace(TELEMETRY, sequence=sequence, status=status, run=5))

    def asks_on(seconds: float = 0.3) -> bool:
        link.take("emergency")
        time.sleep(seconds)
        new = [message for _, message in link.take("emergency")]
        asked.extend(new)
        return bool(new)

    with (
        ZenohLink(listen=[endpoint], subscribe=["emergency"]) as link,
        ZenohLink(connect=[endpoint], subscribe=LEADER_CHANNELS) as own,
    ):
        process = Process(own, stop, lambda line: None)
        arguments: dict[str, Any] = {"description": {}, "name": "anna"}
        loop = threading.Thread(
            target=run_leader, args=(process, ScriptedOperator(0.01, 0.004), SETTINGS), kwargs=arguments
        )
        loop.start()
        try:
            tell(200, Status.STOPPED)  # of an earlier stop: it counts for nothing
            time.sleep(0.2)
            assert not asks_on()
            stop.emergency = "a button"
            assert asks_on()
            tell(900, Status.STOPPED)
            time.sleep(0.2)
            assert asks_on()
            tell(150, Status.FOLLOWING)  # enough, but not stopped
            time.sleep(0.2)
            assert asks_on()
            tell(1, Status.STOPPED)
            time.sleep(0.2)
            assert not asks_on()
            assert stop.emergency == ""
            first = {message.press for message in asked}
            assert len(first) == 1
            assert {message.reason for message in asked} == {"a button at anna"}
            stop.emergency = "another"
            assert asks_on()
            assert asked[-1].press not in first
        finally:
            stop.set("the test is over")
            loop.join()


# --- by steps alone ---------------------------------------------------------------------------------------------------


def say(heard: FollowerView, run: int, sequence: int, position: float = 0.0) -> None:
    heard.take_telemetry(msgspec.structs.replace(TELEMETRY, run=run, sequence=sequence, position=position))


def test_a_process_that_was_thought_to_be_gone_is_heard_again_once_it_alone_speaks() -> None:
    received = FollowerView(1)
    say(received, 3, 1)
    say(received, 4, 1, 0.01)
    assert (received.run, received.take_renewed()) == (4, True)
    taken = received.telemetry.received
    for sequence in range(2, 2 + MOST_OF_FORMER - 1):
        say(received, 3, sequence)
    assert (received.run, received.telemetry.received, received.take_renewed()) == (4, taken, False)
    say(received, 3, 1000)
    assert (received.run, received.take_renewed()) == (3, True)
    assert received.telemetry.newest == 1000
    assert not received.has_relearnt  # it has not been as deep as the other
    for sequence in range(2, 2 + MOST_OF_FORMER):  # the other is the former one now
        say(received, 4, sequence)
    assert received.run == 4


def test_while_the_other_speaks_too_it_stays_a_former_one() -> None:
    received = FollowerView(1)
    say(received, 3, 1)
    say(received, 4, 1)
    for sequence in range(2, 3 * MOST_OF_FORMER):
        say(received, 3, sequence)
        if sequence % (MOST_OF_FORMER - 1) == 0:
            say(received, 4, sequence)
    assert received.run == 4


def test_a_release_with_faulty_sensors_mends_the_watch_and_keeps_the_stop() -> None:
    lap = Lap()
    lap.robot = FaultySensor(lap.robot, SensorFault("stuck", 3.0, 4.0), seed=1)
    lap.start_leader("anna", 11)
    lap.run(3.9)
    lap.stop = "somebody shouted"
    sequence = lap.run(1.0)
    assert sequence[-1].validity  # a stuck sensor is not believed until somebody says that it is mended
    assert lap.following.safety.stop_reason == "somebody shouted"
    lap.release = True
    sequence = lap.run(0.5)
    assert sequence[-1].validity == 0
    assert lap.following.safety.stop_reason == "somebody shouted"
    assert sequence[-1].status == Status.STOPPED
    lap.run(2.0)  # now it feels again what it pressed, and unloads
    lap.release = True
    sequence = lap.run(1.0)
    assert lap.following.safety.stop_reason == ""
    assert sequence[-1].status in (Status.FOLLOWING, Status.RETURNING)
