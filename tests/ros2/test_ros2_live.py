"""A running session, the bridge, a router and an independent ROS 2 subscriber, each where it would be: live."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ros2_node import other_node
from ros2_router import router, wait_until
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.errors import ForetouchError
from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import VERSION, SessionLog, Stop
from foretouch.recordings import read_session
from foretouch.ros2 import BRIDGE_CHANNELS

HERE = Path(__file__).parent
SESSION = ("--material", "hunt-crossley", "--operator", "scripted", "--force-delay", "0.1")


def start(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def foretouch(*arguments: object) -> subprocess.Popen[str]:
    return start("-m", "foretouch", *arguments)


@pytest.fixture
def running() -> Iterator[list[subprocess.Popen[str]]]:
    """Processes that the test starts; none stays behind."""
    processes: list[subprocess.Popen[str]] = []
    yield processes
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.mark.long  # beside the others of this file: quicker ones are in test_ros2_bridge.py
@pytest.mark.live
def test_an_independent_subscriber_sees_a_running_session(running: list[subprocess.Popen[str]], tmp_path: Path) -> None:
    pytest.importorskip("zenoh_ros2_sdk")
    recording = tmp_path / "session.mcap"
    begun = time.time_ns()
    with router() as hub:
        echo = start(HERE / "echo.py", hub.endpoint.rpartition(":")[2], "/robot1", tmp_path / "heard")
        running.append(echo)
        assert echo.stdout is not None
        assert echo.stdout.readline() == "listening\n"
        session = foretouch("teleop", "--headless", "--duration", 8, "--recording", recording, *SESSION)
        running.append(session)
        options = ("--router", hub.endpoint, "--domain", 5, "--namespace", "/robot1", "--rate", 200)
        bridge = foretouch("bridge", "ros2", *_watching(session), *options)
        running.append(bridge)
        ends = [process.communicate(timeout=120) for process in (session, bridge)]
        assert [process.returncode for process in (session, bridge)] == [0, 0], ends
        wait_until(lambda: not any("%robot1/foretouch" in token for token in hub.tokens))  # it has left the graph
        count = len(hub.samples)
    echo.send_signal(signal.SIGTERM)
    echo.communicate(timeout=10)
    topics: dict[str, list[dict[str, Any]]] = {}
    for line in (tmp_path / "heard").read_text().splitlines():
        topic, heard_ns, message = json.loads(line)
        topics.setdefault(topic, []).append(message | {"heard": heard_ns})
    first, *others = ends[1][1].splitlines()
    assert first == f"bridge: on the ROS 2 graph, through {hub.endpoint}"
    sent = {line.split()[1].removeprefix("/robot1"): int(line.split()[2].replace(",", "")) for line in others}
    assert sum(sent.values()) == count
    assert {topic: len(messages) for topic, messages in topics.items()} == pytest.approx(sent, abs=5)
    _is_on_time(topics, begun)
    _is_the_session(topics, read_session(recording))


def _watching(session: subprocess.Popen[str]) -> list[str]:
    """The options that a session says for others that watch it."""
    assert session.stderr is not None
    for line in session.stderr:
        if line.startswith("Another process watches it with "):
            return line.split()[5:]
    raise AssertionError("the session has not said it")


def _is_on_time(topics: dict[str, list[dict[str, Any]]], begun: int) -> None:
    """Stamps are ROS time, in order, and the same for both topics of a tick."""
    for topic in ("/follower/wrench", "/follower/joint_states", "/follower/probe", "/leader/joint_states"):
        stamps = [message["stamp"] for message in topics[topic]]
        late = sorted(message["heard"] - message["stamp"] for message in topics[topic])
        assert len(stamps) > 400
        assert stamps == sorted(stamps)
        assert begun < stamps[0]
        assert -1_000_000 < late[len(late) // 2] < 100_000_000  # what bridge, network and reading take
    pushed = {wrench["stamp"]: wrench["force"][2] for wrench in topics["/follower/wrench"]}
    both = [joint for joint in topics["/follower/joint_states"] if joint["stamp"] in pushed]
    assert len(both) > 0.95 * len(pushed)
    assert all(pushed[joint["stamp"]] == joint["effort"][0] for joint in both)


def _is_the_session(topics: dict[str, list[dict[str, Any]]], log: SessionLog) -> None:
    """Every number that was heard stands in the recording of the same session."""
    follower, leader = log.follower, log.leader
    ticks = set(zip(follower["position"], follower["velocity"], follower["force"], strict=True))
    joints = [(*joint["position"], *joint["velocity"], *joint["effort"]) for joint in topics["/follower/joint_states"]]
    assert len(set(joints) & ticks) > 0.99 * len(set(joints))  # a recorder may miss one, too
    assert max(force for _, _, force in joints) > 0.05  # it presses, as far as a busy machine lets it
    assert {wrench["force"][2] for wrench in topics["/follower/wrench"]} <= {force for _, _, force in joints}
    assert {pose["place"][2] for pose in topics["/follower/probe"]} <= {-position for position, _, _ in joints}
    commands = set(zip(leader["position"], leader["rendered_force"], strict=True))
    rendered = {(state["position"][0], state["effort"][0]) for state in topics["/leader/joint_states"]}
    assert len(rendered & commands) > 0.99 * len(rendered)
    models = topics["/follower/contact_model"]
    learnt = {(model.law, model.parameters) for model in log.models}
    assert {(model["law"], tuple(model["values"])) for model in models} <= learnt
    assert any(model["valid"] for model in models)
    numbers = [model["values"] for model in models]
    assert all(array["data"] in numbers for array in topics["/follower/contact_model/values"])


@pytest.mark.long
@pytest.mark.live
def test_without_a_router_it_says_so_once_and_ctrl_c_ends_it(running: list[subprocess.Popen[str]]) -> None:
    session, hub = free_endpoint(), free_endpoint()
    bridge = foretouch("bridge", "ros2", "--connect", session, "--router", hub)
    running.append(bridge)
    assert bridge.stderr is not None
    line = bridge.stderr.readline()
    assert line == f"bridge: no ROS 2 router at {hub}: goes on trying; one is `ros2 run rmw_zenoh_cpp rmw_zenohd`\n"
    time.sleep(1.0)
    assert bridge.poll() is None
    bridge.send_signal(signal.SIGINT)
    out, err = bridge.communicate(timeout=10)
    assert (bridge.returncode, out, err) == (0, "", "")


@pytest.mark.long
@pytest.mark.live
def test_it_ends_with_the_session(running: list[subprocess.Popen[str]]) -> None:
    session = free_endpoint()
    with router() as hub, ZenohLink(listen=[session], subscribe=BRIDGE_CHANNELS) as link:
        bridge = foretouch("bridge", "ros2", "--connect", session, "--router", hub.endpoint)
        running.append(bridge)
        wait_until(lambda: hub.tokens)
        assert {token.split("/")[1] for token in hub.tokens} == {"0"}
        wait_until(lambda: link.publish(Stop(VERSION, 1, 1, "enough")) or bridge.poll() is not None)
        assert (bridge.returncode, bridge.communicate()[0]) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "no endpoint: give --listen or --connect"),
        (("--connect", "tcp/127.0.0.1:7447"), "cannot be the session's and the ROS 2 router's"),
        (("--connect", "tcp/127.0.0.1:7451", "--domain", 500), "domain = 500: must be 0 to 232, as ROS_DOMAIN_ID"),
        (("--connect", "tcp/127.0.0.1:7451", "--namespace", "robot"), "namespace = 'robot': must be /, or names"),
        (("--connect", "tcp/127.0.0.1:7451", "--rate", 0), "rate = 0.0: must be above 0 messages a second"),
        (("--connect", "tcp/127.0.0.1:7451", "--router", "localhost"), "endpoint 'localhost': write it as"),
        (("--connect", "tcp/127.0.0.1:7451", "--router", "tcp/192.0.2.1:7447"), "--insecure"),
        (("--connect", "tls/127.0.0.1:7451", "--keys", "/nowhere"), "keys"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    arguments: tuple[object, ...], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("foretouch.session.give_way", lambda: None)  # this process is the tests' own
    result = CliRunner().invoke(app, ["bridge", "ros2", *map(str, arguments)])
    assert isinstance(result.exception, ForetouchError)
    assert message in str(result.exception)
    assert "\n" not in str(result.exception)


@pytest.mark.long
@pytest.mark.live
def test_a_session_between_a_device_and_an_arm_that_are_both_on_the_graph(
    running: list[subprocess.Popen[str]], tmp_path: Path
) -> None:
    pytest.importorskip("zenoh_ros2_sdk")
    with router() as hub, other_node("arm", hub.endpoint) as arm, other_node("hand", hub.endpoint) as hand:
        there, recording = f"ros2@{hub.endpoint},domain=5", tmp_path / "session.mcap"
        session = foretouch(
            *("teleop", "--headless", "--duration", 12, "--recording", recording, "--device-damping", 2),
            *("--robot", f"{there},wrench=/ft/wrench", "--operator", there),
        )
        running.append(session)
        wait_until(lambda: hand.says()["heard"] > 50 or session.poll() is not None, 300.0)
        begun, felt, pressed = time.monotonic(), [0.0], [0.0]
        while session.poll() is None:  # the hand goes 16 mm down and up again in 6 s: 6 mm below the floor
            hand.set(z=0.192 + 0.008 * math.cos(math.pi / 3.0 * (time.monotonic() - begun)))
            felt.append((hand.got() or [0.0])[-1])
            pressed.append(1000.0 * (0.19 - arm.says()["z"]))
            time.sleep(0.01)
        out = session.communicate()
        assert session.returncode == 0, out
        assert max(felt) > 2.0
        assert 2.0 < max(pressed) < 8.0
        assert pressed[-1] < 0.5  # it has left the contact
        assert hand.got() == [0.0, 0.0, 0.0]
