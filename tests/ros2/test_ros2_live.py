"""A running session, the bridge, a router and an independent ROS 2 subscriber, each where it would be: live."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ros2_router import router, wait_until
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.errors import ForetouchError
from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import VERSION, Stop
from foretouch.ros2 import BRIDGE_CHANNELS

HERE = Path(__file__).parent
SESSION = ("--material", "hunt-crossley", "--force-delay", "0.1")


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


@pytest.mark.live
def test_an_independent_subscriber_sees_a_running_session(running: list[subprocess.Popen[str]], tmp_path: Path) -> None:
    pytest.importorskip("zenoh_ros2_sdk")
    there, back = free_endpoint(), free_endpoint()
    with router() as hub:
        echo = start(HERE / "echo.py", hub.endpoint.rpartition(":")[2], "/robot1", tmp_path / "heard")
        running.append(echo)
        assert echo.stdout is not None
        assert echo.stdout.readline() == "listening\n"
        options = ("--router", hub.endpoint, "--domain", 5, "--namespace", "/robot1", "--rate", 200)
        bridge = foretouch("bridge", "ros2", "--connect", there, "--connect", back, *options)
        follower = foretouch("follower", "--listen", there, *SESSION)
        leader = foretouch("leader", "--connect", there, "--listen", back, "--duration", 4, *SESSION)
        running += [bridge, follower, leader]
        begun = time.time_ns()
        ends = [process.communicate(timeout=60) for process in (leader, follower, bridge)]
        assert [process.returncode for process in (leader, follower, bridge)] == [0, 0, 0], ends
        wait_until(lambda: not any("%robot1/foretouch" in token for token in hub.tokens))  # the node has left the graph
        hub_count = len(hub.samples)
    echo.send_signal(signal.SIGTERM)
    echo.communicate(timeout=10)
    lines = [json.loads(line) for line in (tmp_path / "heard").read_text().splitlines() if line.endswith("]")]
    said: dict[str, list[dict[str, Any]]] = {}
    for topic, heard_ns, message in lines:
        said.setdefault(topic, []).append(message | {"heard": heard_ns})
    bridge_says = ends[2][1].splitlines()
    assert bridge_says[0] == f"bridge: on the ROS 2 graph, through {hub.endpoint}"
    sent = {line.split()[1]: int(line.split()[2]) for line in bridge_says[1:]}
    assert sum(sent.values()) == hub_count
    assert {name.removeprefix("/robot1") for name in sent} == set(said)
    for name, count in sent.items():  # it was there before the first, and best effort is reliable on this machine
        assert count - 5 <= len(said[name.removeprefix("/robot1")]) <= count
    _is_a_session(said, begun)


def _is_a_session(said: dict[str, list[dict[str, Any]]], begun: int) -> None:
    wrenches, joints = said["/follower/wrench"], said["/follower/joint_states"]
    poses, leaders = said["/follower/probe"], said["/leader/joint_states"]
    assert len(wrenches) > 400
    assert max(wrench["force"][2] for wrench in wrenches) > 0.5  # it presses
    assert {wrench["frame"] for wrench in wrenches} == {"probe"}
    assert {pose["frame"] for pose in poses} == {"world"}
    by_stamp = {joint["stamp"]: joint for joint in joints}
    same = [(wrench, by_stamp[wrench["stamp"]]) for wrench in wrenches if wrench["stamp"] in by_stamp]
    assert len(same) > 0.95 * len(wrenches)  # both of one tick have one stamp
    assert all(wrench["force"][2] == joint["effort"][0] for wrench, joint in same)
    assert all(
        pose["place"][2] == -by_stamp[pose["stamp"]]["position"][0] for pose in poses if pose["stamp"] in by_stamp
    )
    for messages in (wrenches, joints, leaders):
        stamps = [message["stamp"] for message in messages]
        assert stamps == sorted(stamps)
        assert begun < stamps[0]
        late = sorted(message["heard"] - message["stamp"] for message in messages)
        assert -1_000_000 < late[len(late) // 2] < 100_000_000  # ROS time, and what the bridge and the network take
    assert {leader["name"][0] for leader in leaders} == {"probe"}
    models = said["/follower/contact_model"]
    assert {model["law"] for model in models} <= {"", "contact-map"}  # "" before it has learnt
    assert any(model["valid"] for model in models)
    numbers = [model["values"] for model in models]
    assert all(array["data"] in numbers for array in said["/follower/contact_model/values"])


@pytest.mark.live
def test_without_a_router_it_says_so_once_and_ctrl_c_ends_it(running: list[subprocess.Popen[str]]) -> None:
    session, hub = free_endpoint(), free_endpoint()
    bridge = foretouch("bridge", "ros2", "--connect", session, "--router", hub)
    running.append(bridge)
    assert bridge.stderr is not None
    line = bridge.stderr.readline()
    assert line == f"bridge: no ROS 2 router at {hub}: goes on trying; one is `ros2 run rmw_zenoh_cpp rmw_zenohd`\n"
    time.sleep(2.5)
    assert bridge.poll() is None
    bridge.send_signal(signal.SIGINT)
    out, err = bridge.communicate(timeout=10)
    assert (bridge.returncode, out, err) == (0, "", "")


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
