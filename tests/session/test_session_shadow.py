"""A follower that watches a robot which somebody else moves: it learns and predicts, and commands nothing."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from watched_robot import MS, watched

from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import VERSION, Command, EmergencyStop, SessionLog, Status
from foretouch.report import session_figures
from foretouch.robot import MovedRobot, Robot, RobotSample, make_robot
from foretouch.session import (
    SHADOW_CHANNELS,
    Process,
    SessionSettings,
    StopFlag,
    framed_robot,
    make_moved_robot,
    make_operator,
    run_shadow,
    simulate,
)
from foretouch.session.network.freshness import Arrival
from foretouch.session.runners.driven import Tick
from foretouch.session.runners.news import leader_news, shadow_news
from foretouch.session.runners.shadow import SCORED_AFTER, Shadow, ShadowScore
from foretouch.session.settings import shadow_settings
from foretouch.session.steps import leader

SETTINGS = SessionSettings(material="hunt-crossley", force_delay=0.3)


class Noting(Robot):
    def __init__(self, robot: Robot) -> None:
        self.robot, self.specification = robot, robot.specification
        self.told: list[float] = []

    def read(self) -> RobotSample:
        return self.robot.read()

    def exchange(self, desired_position: float) -> RobotSample:
        self.told.append(desired_position)
        return self.robot.exchange(desired_position)


@pytest.fixture(scope="module")
def day() -> tuple[SessionLog, Shadow]:
    return watched(SETTINGS, 7.0)


def test_a_moved_robot_goes_its_own_way_and_leaves_out_what_it_is_told() -> None:
    def motion(time: float) -> float:
        return 0.004 * math.sin(2.0 * math.pi * time)

    def moved(commands: Callable[[int], float]) -> list[RobotSample]:
        robot = MovedRobot(make_robot("hunt-crossley", seed=2), motion)
        return [robot.exchange(commands(tick)) for tick in range(500)]

    nothing, nonsense = moved(lambda _: math.nan), moved(lambda tick: 0.05 * (-1) ** tick)
    assert nothing == nonsense
    expected = np.array([motion(tick * 1e-3) for tick in range(500)])
    assert np.abs([one.position for one in nothing] - expected).max() < 1e-3  # a drive is late


def test_what_is_said_is_a_session_at_equal_positions_with_nothing_commanded_and_all_fresh(
    day: tuple[SessionLog, Shadow],
) -> None:
    log, _ = day
    assert set(log.follower["status"]) == {Status.SHADOW}
    assert np.isnan(log.follower["desired_position"]).all()
    np.testing.assert_array_equal(log.follower["command_sequence"], log.leader["sequence"])
    np.testing.assert_array_equal(log.leader["position"], log.follower["position"])
    assert not log.follower["guarded"].any()
    assert log.leader["engaged"].all()
    assert len(log.models) > 300
    following = day[1].follows.state
    assert following.freshness.counts[Arrival.FRESH] == 7_000
    assert following.lease.refused == 0
    assert following.held_ticks == following.faulty_ticks == 0


def test_models_and_forces_come_as_late_as_the_settings_say(day: tuple[SessionLog, object]) -> None:
    leading = day[0].leader
    behind = leading["sequence"] - leading["telemetry_sequence"]
    assert set(behind[400:]) == {300}
    received = leading["telemetry_sequence"][400:] - 1
    np.testing.assert_array_equal(leading["delayed_force"][400:], day[0].follower["force"][received])
    sent = {model.sequence: model.time_ns for model in day[0].models}
    used = leading[leading["model_sequence"] > 0]
    ages = used["time_ns"] - [sent[number] for number in used["model_sequence"].tolist()]
    assert ages.min() >= 300 * MS
    assert ages.max() <= 325 * MS


@pytest.mark.long
def test_it_predicts_as_a_session_does(day: tuple[SessionLog, Shadow]) -> None:
    log, state = day
    report = session_figures(log)
    assert report["status"] == "ok"
    assert report["tracking_error"]["max_mm"] == 0.0
    robot = make_robot("hunt-crossley", seed=0)
    hand = make_operator(SETTINGS, surface=robot.surface, press_depth=robot.material.press_depth, say=pytest.fail)
    session = session_figures(simulate(SETTINGS, duration=7.0, operator=hand, robot=robot).log)
    assert report["prediction_error_percent"] < 1.2 * session["equal_position"]["prediction_error_percent"] + 1.0
    assert report["delayed_force_error_percent"] > 5.0 * report["prediction_error_percent"]
    score = state.score
    assert score.figures()["contact_force_rms_N"] == pytest.approx(report["contact_force_rms_N"], rel=0.1)
    assert score.figures()["prediction_error_percent"] == pytest.approx(report["prediction_error_percent"], abs=2.0)
    assert score.figures()["delayed_force_error_percent"] == pytest.approx(
        report["delayed_force_error_percent"], rel=0.1
    )
    assert "s in contact at" in score.sentence(0.3)


@pytest.mark.long
def test_the_hand_s_settings_have_no_part_in_it() -> None:
    odd = replace(
        SETTINGS, grip="soft", position_scale=0.5, force_scale=2.0, clutch="1:2", leader_frame="0.01,-1", seed=3
    )
    plain = replace(SETTINGS, seed=3)
    ours, theirs = watched(odd, 2.2)[0], watched(plain, 2.2)[0]
    for name in ("position", "predicted_force", "rendered_force"):
        np.testing.assert_array_equal(ours.leader[name], theirs.leader[name])


def test_a_robot_that_counts_outwards_is_watched_like_any_other() -> None:
    settings = replace(SETTINGS, follower_frame="0.1,-1")
    robot, material = make_moved_robot(settings, say=pytest.fail)
    robot = framed_robot(robot, settings.follower_frame)
    deepest = max(robot.exchange(math.nan).position for _ in range(3000))
    assert material.surface < deepest < material.surface + 1.2 * material.press_depth


@pytest.mark.long
def test_a_failing_sensor_stops_the_learning_and_is_told() -> None:
    log, state = watched(replace(SETTINGS, sensor_fault="stuck:3:3.6"), 4.0)
    bad = log.follower["validity"] != 0
    assert bad.any()
    assert set(log.follower["status"]) == {Status.SHADOW}
    assert "nothing is learnt: the force stands" in shadow_news(state.follows.state, "")
    assert "stop the robot where it is moved" in shadow_news(state.follows.state, "somebody shouted")
    assert shadow_news(watched(SETTINGS, 0.1)[1].follows.state, "") == ""


def test_a_leader_that_hears_a_shadow_is_told_and_lets_go() -> None:
    robot, _ = make_moved_robot(SETTINGS, say=pytest.fail)
    watching = Shadow(robot, shadow_settings(SETTINGS), 5)
    other = leader.start(replace(SETTINGS, grip="normal"), holder="anna", epoch=6)
    for tick in range(2000):
        watching.pass_time(1)
        _, telemetry, *models = watching.tick(Tick(tick * MS, MS))
        other, led = leader.step(other, leader.Inputs(0.02, [telemetry, *models], MS, 0), tick * MS)
        assert led.record.rendered_force == 0.0
        assert not led.record.engaged
        assert math.isnan(led.command.position)
    assert other.follower_view.shadows
    assert not other.follower_view.had_control
    assert "commands nothing" in leader_news(other.follower_view, {})


FORCES = st.floats(0.0, 20.0).map(lambda force: round(force, 4))
TICKS = st.lists(st.tuples(FORCES, FORCES, FORCES, st.booleans()), min_size=1, max_size=60)


@given(TICKS)
def test_the_score_is_what_the_arrays_give(ticks: list[tuple[float, float, float, bool]]) -> None:
    score, begin = ShadowScore(), round(SCORED_AFTER * 1e9)
    score.add(0, 1.0, 2.0, 3.0, True)  # before scoring begins
    for number, (force, predicted, delayed, touching) in enumerate(ticks):
        score.add(begin + number * MS, force, predicted, delayed, touching)
    force, predicted, delayed, touching = map(np.array, zip(*ticks, strict=True))
    contact = touching.astype(bool)
    if not contact.any() or not force[contact].any():
        assert math.isnan(score.figures()["prediction_error_percent"])
        return
    scored = contact | (predicted > 0.05)
    rms = np.sqrt(np.mean(force[contact] ** 2))
    assert score.figures()["contact_force_rms_N"] == pytest.approx(rms)
    assert score.figures()["prediction_error_percent"] == pytest.approx(
        100.0 * np.sqrt(np.mean((predicted - force)[scored] ** 2)) / rms
    )
    assert score.figures()["delayed_force_error_percent"] == pytest.approx(
        100.0 * np.sqrt(np.mean((delayed - force)[scored] ** 2)) / rms
    )


def test_nothing_touched_is_nothing_to_compare() -> None:
    score = ShadowScore()
    for tick in range(3000):
        score.add(tick * MS, 0.0, 0.0, math.nan, False)
    assert "nothing was touched" in score.sentence(0.3)


@pytest.mark.live
def test_whatever_comes_over_the_network_the_robot_is_told_nothing() -> None:
    robot = Noting(make_moved_robot(SETTINGS, say=pytest.fail)[0])
    endpoint, output = free_endpoint(), list[str]()
    with (
        ZenohLink(listen=[endpoint], subscribe=SHADOW_CHANNELS) as link,
        ZenohLink(connect=[endpoint], subscribe=["telemetry", "leader", "hello", "stop"]) as other,
    ):
        ended = threading.Event()

        def insist() -> None:
            number = 0
            while not ended.wait(0.01):
                number += 1
                other.publish(Command(VERSION, number, number * MS, 0.03, 0, holder="anna", epoch=2**62))
                other.publish(EmergencyStop(VERSION, number, number * MS, "anna shouted"))

        insistent = threading.Thread(target=insist)
        insistent.start()
        try:
            run_shadow(Process(link, StopFlag(), output.append), robot, SETTINGS, description={}, duration=2.5)
        finally:
            ended.set()
            insistent.join()
        time.sleep(0.2)
        received = [telemetry for _, telemetry in other.take("telemetry")]
        hello = other.take("hello")[-1][1]
        texts = dict(zip(hello.names, hello.values, strict=True))
        assert other.take("leader")
        assert other.take("stop")
    assert len(robot.told) > 1500
    assert all(math.isnan(told) for told in robot.told)
    assert {telemetry.status for telemetry in received} == {Status.SHADOW}
    assert (texts["operator"], texts["control"]) == ("shadow", "nobody")
    trouble = "emergency stop (anna shouted): nothing is commanded from here, so stop the robot where it is moved"
    assert texts["trouble"] == trouble
    assert output[0] == f"follower: {trouble}"
    assert "s in contact at" in output[-1]
