"""Sides with a budget as real processes, in real time."""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from foretouch.console.panels.space import draw_over
from foretouch.link import ZenohLink, free_endpoint
from foretouch.link.zenoh_link import STOPPING_CHANNELS, ask_to_stop
from foretouch.messages import VERSION, CameraImage, Handle, Status
from foretouch.recordings import read_session
from foretouch.session import SessionSettings
from foretouch.session.spatial import make_camera, make_scene

sys.path.append(str(Path(__file__).resolve().parents[1]))
from running import Running, until

pytestmark = pytest.mark.live

BUDGET = ("--budget", 3000)


def test_a_session_with_a_budget_ends_in_order_with_a_report(tmp_path: Path) -> None:
    options = ("--headless", "--duration", 6, *BUDGET, "--operator", "scripted", "--json", "--report", tmp_path / "out")
    with Running("teleop", *options) as teleop:
        code, out, err = teleop.wait(90)
    assert code == 0, err
    assert "Traceback" not in err
    assert "no recorder" not in err  # it was waited for, and heard
    report = json.loads(out)
    assert report["status"] == "ok"
    assert report["messages"]["undecodable"] == 0
    assert any((tmp_path / "out").glob("*.html"))
    log = read_session(tmp_path / "out" / "session.mcap")
    assert log.settings["budget"] == "3000.0"
    led = log.follower[log.follower["command_sequence"] > 0]
    assert np.isin(led["status"], (Status.FOLLOWING, Status.GUARDED)).mean() > 0.5
    assert log.counts["models_refused"] == 0
    seconds = len(log.leader) * 1e-3
    for side in ("leader", "follower"):
        assert 100 < log.counts[f"{side}_thin_bytes"] <= 3000 * (seconds + 3.0)


@pytest.fixture
def watched() -> Iterator[tuple[str, Running, ZenohLink]]:
    """A follower with a budget, and who watches it."""
    endpoint = free_endpoint()
    with (
        Running("follower", "--listen", endpoint, *BUDGET) as follower,
        ZenohLink(connect=[endpoint], subscribe=["telemetry", "hello"]) as watcher,
    ):
        yield endpoint, follower, watcher


def statuses(watcher: ZenohLink) -> set[int]:
    return {telemetry.status for _, telemetry in watcher.take("telemetry")}


def stays_stopped(watcher: ZenohLink) -> bool:
    watcher.take("telemetry")
    time.sleep(0.2)
    return statuses(watcher) == {Status.STOPPED}


def test_sides_with_a_budget_find_each_other_and_anybody_stops_the_robot(
    watched: tuple[str, Running, ZenohLink],
) -> None:
    endpoint, follower, watcher = watched
    with Running("leader", "--connect", endpoint, "--operator", "scripted", "--name", "anna", *BUDGET) as leader:
        assert follower.process.stderr is not None
        assert "follower: connected: the leader is anna\n" in iter(follower.process.stderr)
        until(lambda: statuses(watcher) & {Status.FOLLOWING, Status.GUARDED}, 40.0)
        with Running("stop", "--connect", endpoint) as stop:
            code, out, err = stop.wait(20)
        assert (code, err) == (0, "")
        assert out.startswith("the robot has stopped: ")
        assert stays_stopped(watcher)
        leader.process.send_signal(signal.SIGINT)
        code, _, err = leader.wait(20)
        assert code == 0, err
    code, _, err = follower.wait(20)
    assert code == 0, err


def test_an_emergency_stop_at_the_leader_reaches_the_follower(watched: tuple[str, Running, ZenohLink]) -> None:
    endpoint, _, watcher = watched
    with Running("leader", "--connect", endpoint, "--operator", "scripted", *BUDGET) as leader:
        until(lambda: statuses(watcher) & {Status.FOLLOWING, Status.GUARDED}, 40.0)
        leader.process.send_signal(signal.SIGUSR1)
        until(lambda: Status.STOPPED in statuses(watcher), 2.0)
        assert stays_stopped(watcher)


def test_a_leader_with_a_budget_says_that_its_follower_needs_one() -> None:
    endpoint = free_endpoint()
    with (
        Running("follower", "--listen", endpoint, "--duration", 6),
        Running("leader", "--connect", endpoint, "--operator", "scripted", *BUDGET) as leader,
    ):
        assert leader.process.stderr is not None
        line = next(iter(leader.process.stderr))
        assert line == "leader: waiting for a follower that has a --budget, too\n"
        time.sleep(4.0)
        assert leader.process.poll() is None
        leader.process.send_signal(signal.SIGINT)
        code, _, err = leader.wait(20)
    assert code == 0, err


@pytest.mark.long
def test_an_image_of_the_robot_s_site_arrives_at_the_leader_s_while_the_hand_rests(tmp_path: Path) -> None:
    """The recorder is connected to the leader alone; a hand that rests leaves bytes for images."""
    follower_at, camera_at, leader_at = free_endpoint(), free_endpoint(), free_endpoint()
    scene, path = ("--scene", "phantom", "--budget", 2000), tmp_path / "at-the-leader.mcap"
    if make_camera(SessionSettings(scene="phantom"), make_scene("phantom", 0.0), say=print) is None:
        pytest.skip("nothing here draws")
    came: list[CameraImage] = []
    with (
        Running("follower", "--listen", follower_at, *scene),
        Running("camera", "--listen", camera_at, "--connect", follower_at, *scene),
        Running("leader", "--connect", follower_at, "--listen", leader_at, "--relay", *scene) as leader,
        Running("record", path, "--connect", leader_at) as recorder,
        ZenohLink(connect=[leader_at], subscribe=["image"]) as watcher,
    ):

        def rest() -> bool:
            watcher.publish(Handle(VERSION, 1, time.monotonic_ns(), 0.0, True, place=(0.0, 0.0, 0.05)))
            came.extend(image for _, image in watcher.take("image"))
            time.sleep(0.1)
            return len(came) >= 2

        until(rest, 120.0)
        leader.process.send_signal(signal.SIGINT)
        for process in (leader, recorder):  # a robot that holds ends by no leader's word, nor does the camera beside it
            code, _, err = process.wait(30)
            assert code == 0, err
    log = read_session(path)
    assert log.follower.size > 1000  # the leader tells its site what it hears
    assert np.all(np.diff(log.follower["sequence"]) > 0)
    images = log.images
    assert [image.tick for image in images[:2]] == [image.tick for image in came[:2]]
    for image in images:
        assert 300 < len(image.jpeg) < 2000
        assert draw_over(image.jpeg, image.camera, (0.0, 0.0, 0.05), (0.0,) * 6, np.eye(3)) is not None


def test_an_emergency_stop_at_the_leader_s_site_stops_the_robot(watched: tuple[str, Running, ZenohLink]) -> None:
    """Who is connected to the leader alone sees the robot there, and stops it."""
    follower_at, _, beside = watched
    leader_at = free_endpoint()
    with (
        Running(
            "leader", "--connect", follower_at, "--listen", leader_at, "--relay", *BUDGET, "--operator", "scripted"
        ),
        ZenohLink(connect=[leader_at], subscribe=STOPPING_CHANNELS) as watcher,
    ):
        until(lambda: Status.FOLLOWING in statuses(watcher), 60.0)
        assert ask_to_stop(watcher, "tried") == Status.STOPPED
        assert Status.STOPPED in statuses(beside)
