"""A recorded session through the bridge and a real router, message by message."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from ros2_router import Router, router, wait_until

from foretouch.errors import LinkError
from foretouch.link import free_endpoint
from foretouch.messages import (
    VERSION,
    CameraImage,
    FixtureBelief,
    FollowerSpace,
    LeaderState,
    Message,
    ModelUpdate,
    Telemetry,
)
from foretouch.recordings.formats.topics import STANDARD
from foretouch.ros2 import Bridge, Graph, Node, publisher_gid, type_hash, wall_offset_ns
from foretouch.session import SessionSettings, make_operator, make_session_robot, simulate

pytestmark = pytest.mark.network

CHANNEL = {Telemetry: "telemetry", LeaderState: "leader", ModelUpdate: "model"} | {
    FixtureBelief: "fixture",
    CameraImage: "image",
}
NODE = Node(3, "/robot1")
AT_ONCE = 25  # messages between two checks that what was sent has come
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def log() -> list[Message]:
    """All messages of a simulated session of a second."""
    settings = SessionSettings(material="hunt-crossley", operator="scripted", model="kelvin-voigt", estimator="rls")
    robot, reach = make_session_robot(settings)
    operator = make_operator(settings, surface=reach.surface, press_depth=reach.press_depth, say=print)
    sent: list[Message] = []
    simulate(settings, duration=2.0, operator=operator, robot=robot, record=lambda message, now: sent.append(message))
    return sent


@pytest.fixture
def there() -> Iterator[Router]:
    with router() as opened:
        yield opened


@pytest.fixture
def graph(there: Router) -> Iterator[Graph]:
    opened = Graph(there.endpoint, NODE)
    yield opened
    opened.close()


def bridge(graph: Graph, rate: float = 1e4, lines: list[str] | None = None) -> Bridge:
    made = Bridge(graph, rate=rate, router="the router", say=print if lines is None else lines.append)
    made.look()
    return made


def pass_on(
    made: Bridge, messages: list[Message], start_ns: int | None = None, received: Callable[[], bool] = lambda: True
) -> None:
    """As if they had come one after the other, each as late after it was made as the others.

    A full queue drops what comes next, as it should on a robot's network: every so often it is waited for.
    """
    begin = time.monotonic_ns() if start_ns is None else start_ns
    for number, message in enumerate(messages, start=1):
        if type(message) in CHANNEL:
            made.take(CHANNEL[type(message)], message, begin + message.time_ns)
        if number % AT_ONCE == 0:
            wait_until(received)


def all_received(graph: Graph, there: Router) -> Callable[[], bool]:
    """Whether the router has every sample that was sent."""
    return lambda: sum(graph.sent.values()) == len(there.samples)


def reader() -> Any:
    """The other implementation's deserialiser, which knows the types of ROS 2 and our schemas."""
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    for topic in STANDARD:
        if topic.type_name not in store.types:
            store.register(
                {
                    name: kind
                    for name, kind in typesys.get_types_from_msg(topic.schema, topic.type_name).items()
                    if name not in store.types
                }
            )
    return store


def test_every_number_of_a_session_is_read_by_another_implementation(
    log: list[Message], there: Router, graph: Graph
) -> None:
    made = bridge(graph)
    begin = time.monotonic_ns()
    pass_on(made, log, begin, all_received(graph, there))
    ticks = [message for message in log if isinstance(message, Telemetry)]
    leaders = [message for message in log if isinstance(message, LeaderState)]
    models = [message for message in log if isinstance(message, ModelUpdate)]
    assert len(ticks) > 1900
    assert max(tick.force for tick in ticks) > 1.0
    assert any(model.valid for model in models)
    assert graph.unsent == 0
    wait_until(all_received(graph, there))
    read = reader().deserialize_cdr
    offset = wall_offset_ns()
    for tick, (data, _) in zip(ticks, there.of("/robot1/follower/wrench"), strict=True):
        wrench = read(data, "geometry_msgs/msg/WrenchStamped")
        assert wrench.header.frame_id == "tip"
        force, torque = wrench.wrench.force, wrench.wrench.torque
        assert (force.x, force.y, force.z, torque.x, torque.y, torque.z) == (0.0, 0.0, tick.force, 0.0, 0.0, 0.0)
        stamp = wrench.header.stamp.sec * 10**9 + wrench.header.stamp.nanosec
        assert abs(stamp - (begin + tick.time_ns + offset)) < 1_000_000
    for tick, (data, _) in zip(ticks, there.of("/robot1/follower/joint_states"), strict=True):
        joints = read(data, "sensor_msgs/msg/JointState")
        assert joints.name == ["probe"]
        assert (joints.position[0], joints.velocity[0], joints.effort[0]) == (tick.position, tick.velocity, tick.force)
    for tick, (data, _) in zip(ticks, there.of("/robot1/follower/probe"), strict=True):
        pose = read(data, "geometry_msgs/msg/PoseStamped")
        position, turn = pose.pose.position, pose.pose.orientation
        assert pose.header.frame_id == "world"
        assert (position.x, position.y, position.z) == (0.0, 0.0, -tick.position)
        assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 1.0)
    for state, (data, _) in zip(leaders, there.of("/robot1/leader/joint_states"), strict=True):
        joints = read(data, "sensor_msgs/msg/JointState")
        assert (joints.position[0], joints.effort[0]) == (state.position, state.rendered_force)
    for model, (data, _) in zip(models, there.of("/robot1/follower/contact_model"), strict=True):
        message = read(data, "foretouch_msgs/msg/ContactModel")
        assert (message.law, message.reason, message.valid) == (model.law, model.reason, model.valid)
        assert (message.surface, message.sequence) == pytest.approx((model.surface, model.sequence), nan_ok=True)
        assert tuple(message.values) == model.parameters
        assert message.names == ["stiffness", "damping"] or not model.parameters


def test_every_message_says_its_number_its_time_and_by_whom(log: list[Message], there: Router, graph: Graph) -> None:
    before = time.time_ns()
    pass_on(bridge(graph), log[:3000], received=all_received(graph, there))
    wait_until(all_received(graph, there))
    wait_until(lambda: len(there.tokens) == 1 + len(graph.sent))
    tokens = {token.split("/")[9].replace("%", "/"): token for token in there.tokens if "/MP/" in token}
    assert set(tokens) == set(graph.sent)
    assert "/robot1/follower/wrench" in tokens
    for name, token in tokens.items():
        attached = [struct.unpack("<qqB16s", attached) for _, attached in there.of(name)]
        assert [number for number, _, _, _ in attached] == list(range(1, graph.sent[name] + 1))
        times = [sent for _, sent, _, _ in attached]
        assert before <= times[0]
        assert times == sorted(times)
        assert {(length, gid) for _, _, length, gid in attached} == {(16, publisher_gid(token))}


def test_tokens_and_keys_name_the_same_types(log: list[Message], there: Router, graph: Graph) -> None:
    pass_on(bridge(graph), log[:3000], received=all_received(graph, there))
    wait_until(lambda: len(there.tokens) == 7)
    node = next(token for token in there.tokens if "/NN/" in token)
    assert node.startswith("@ros2_lv/3/")
    assert node.endswith("/0/0/NN/%/%robot1/foretouch")
    publishers = {token for token in there.tokens if "/MP/" in token}
    numbers = {token.split("/")[4] for token in publishers}
    assert numbers == {str(number) for number in range(1, 7)}
    keys = {key for key, _, _ in there.samples}
    assert keys == {
        "/".join(["3", token.split("/")[9][1:].replace("%", "/"), *token.split("/")[10:12]]) for token in publishers
    }
    wanted = {topic.name: type_hash(topic.type_name, topic.schema) for topic in STANDARD}
    for token in publishers:
        name, kind, hashed, qos = token.split("/")[9:]
        assert hashed == wanted[name.removeprefix("%robot1").replace("%", "/")]
        assert kind.endswith("_")
        assert qos == ("::,10:,:,:,," if "contact_model" in name else "2::,5:,:,:,,")
    graph.close()
    wait_until(lambda: not there.tokens)
    assert publishers < there.gone


@pytest.mark.long  # another implementation reads every number below
def test_another_implementation_lists_the_topics(log: list[Message], there: Router, graph: Graph) -> None:
    pytest.importorskip("zenoh_ros2_sdk")
    pass_on(bridge(graph), log[:3000], received=all_received(graph, there))
    wait_until(lambda: len(there.tokens) == 7)
    command = [sys.executable, HERE / "topic_list.py", there.endpoint.rpartition(":")[2], "3"]
    listed = json.loads(subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout)
    assert {name: topic["types"] for name, topic in listed.items()} == {
        "/robot1" + topic.name: [topic.type_name] for topic in STANDARD if "/robot1" + topic.name in graph.sent
    }
    (publisher,) = listed["/robot1/follower/wrench"]["publishers"]
    assert (publisher["node_namespace"], publisher["node_name"]) == ("/robot1", "foretouch")
    assert publisher["type_hash"] == "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"
    assert publisher["qos"] == "2::,5:,:,:,,"


def test_at_most_the_rate_goes_out_evenly(log: list[Message], there: Router, graph: Graph) -> None:
    pass_on(bridge(graph, 50.0), log, received=all_received(graph, there))
    assert 98 <= graph.sent["/robot1/follower/wrench"] <= 102
    assert 98 <= graph.sent["/robot1/leader/joint_states"] <= 102
    wait_until(all_received(graph, there))
    read = reader().deserialize_cdr
    headers = [read(data, "geometry_msgs/msg/WrenchStamped").header for data, _ in there.of("/robot1/follower/wrench")]
    stamps = [header.stamp.sec * 10**9 + header.stamp.nanosec for header in headers]
    gaps = [late - early for early, late in pairwise(stamps)]
    assert all(abs(gap - 20_000_000) < 2_000_000 for gap in gaps)


TICK = Telemetry(VERSION, 1, 1, 0, 0.0, 0.01, 0.0, 2.0, 2.0, float("nan"), True, False, 0, 1, 1, epoch=7)
STATE = LeaderState(VERSION, 1, 1, 0.01, 0.0, 1.0, 1.0, 1.0, 0, 0, 0.0, False, 1, 1)


def at(message: Any, tick: int, **changes: Any) -> Any:
    return msgspec.structs.replace(message, sequence=tick, time_ns=tick * 1_000_000, **changes)


def test_of_several_leaders_that_one_goes_on_which_is_obeyed(there: Router, graph: Graph) -> None:
    others = [at(STATE, tick, epoch=tick % 2 + 7) for tick in range(1, 21)]
    pass_on(bridge(graph), [TICK, *others])
    assert graph.sent["/robot1/leader/joint_states"] == 10


def test_samples_of_sensors_that_are_not_to_be_trusted_stay_here(there: Router, graph: Graph) -> None:
    pass_on(bridge(graph), [at(TICK, tick, validity=tick % 2) for tick in range(1, 21)])
    assert graph.sent == dict.fromkeys(
        ("/robot1/follower/wrench", "/robot1/follower/joint_states", "/robot1/follower/probe"), 10
    )


def test_a_clock_that_is_far_ahead_and_comes_back_ends_nothing(there: Router, graph: Graph) -> None:
    made = bridge(graph)
    wrong = msgspec.structs.replace(TICK, time_ns=2**63 - 1)
    for tick, message in enumerate([at(TICK, 1), wrong, at(TICK, 3), msgspec.structs.replace(TICK, time_ns=0)]):
        made.take("telemetry", message, time.monotonic_ns() + tick)
    assert graph.unsent == 0
    wait_until(lambda: len(there.samples) == sum(graph.sent.values()) > 0)


def test_in_a_scene_the_probe_is_where_the_follower_says(there: Router, graph: Graph) -> None:
    space = FollowerSpace(0.1, -0.2, 0.3, *(0.0,) * 16)
    belief = FixtureBelief(VERSION, 1, 1, *_fields_of(FixtureBelief))
    pass_on(bridge(graph), [at(TICK, 1, space=space), belief])
    wait_until(lambda: sum(graph.sent.values()) == len(there.samples) == 4)
    read = reader().deserialize_cdr
    position = read(there.of("/robot1/follower/probe")[0][0], "geometry_msgs/msg/PoseStamped").pose.position
    assert (position.x, position.y, position.z) == (0.1, -0.2, 0.3)
    assert len(there.of("/robot1/camera/fixture/pose")) == 1


def _fields_of(kind: type[Message]) -> list[Any]:
    """A pose of six numbers; anything else that a field without a default asks for."""
    values: list[Any] = []
    for field in msgspec.structs.fields(kind)[3:]:
        if not field.required:
            break
        described = msgspec.inspect.type_info(field.type)
        if isinstance(described, msgspec.inspect.VarTupleType):
            values.append((0.0,) * 6 if field.name == "pose" else ())
        else:
            kinds = {msgspec.inspect.FloatType: 0.0, msgspec.inspect.BoolType: True, msgspec.inspect.StrType: ""}
            values.append(kinds.get(type(described), 0))
    return values


def test_where_no_router_is_it_says_so_once_and_goes_on() -> None:
    endpoint, lines = free_endpoint(), []
    graph = Graph(endpoint, NODE)
    made = bridge(graph, lines=lines)
    made.look()
    assert lines == [
        "bridge: no ROS 2 router at the router: goes on trying; one is `ros2 run rmw_zenoh_cpp rmw_zenohd`"
    ]
    pass_on(made, [at(TICK, 1)])
    graph.publish(STANDARD[0], b"")
    assert graph.sent == {}
    assert graph.unsent == 1
    with router(endpoint) as there:
        wait_until(lambda: made.look() or len(lines) == 2)
        pass_on(made, [at(TICK, 2)])
        wait_until(lambda: len(there.samples) == 3)
    wait_until(lambda: made.look() or len(lines) == 3)
    with router(endpoint) as there:  # it comes back: everything is offered again
        wait_until(lambda: made.look() or len(lines) == 4)
        wait_until(lambda: len(there.tokens) == 4)
        pass_on(made, [at(TICK, 3)])
        wait_until(lambda: len(there.samples) == 3)
    graph.close()
    assert lines[1:] == [
        "bridge: on the ROS 2 graph, through the router",
        "bridge: the ROS 2 router at the router is gone: goes on trying",
        "bridge: on the ROS 2 graph, through the router",
    ]


@pytest.mark.parametrize(
    ("endpoint", "message"),
    [
        ("127.0.0.1:7447", "write it as tcp/HOST:PORT"),
        ("tcp/192.0.2.1:7447", "--insecure"),
        ("tls/127.0.0.1:7447", "write it as tcp/HOST:PORT; keys for a ROS 2 graph are not read here"),
    ],
)
def test_a_router_that_cannot_be_used_is_refused(endpoint: str, message: str) -> None:
    with pytest.raises(LinkError, match=message):
        Graph(endpoint, NODE)
