"""The newest message of a topic, of bytes that another implementation makes, and of bytes that nobody means."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.recordings.formats.topics import (
    FOLLOWER_JOINTS,
    PROBE,
    WRENCH,
    Stamped,
    pack_stamped,
    unpack_stamped,
)
from foretouch.ros2.newest import ROUTER, GraphAddress, Newest

TYPES = [topic.type_name for topic in (WRENCH, PROBE, FOLLOWER_JOINTS)]
NUMBERS = st.floats(allow_nan=False)
TIMES, FRAMES = st.integers(0, 2**31 * 10**9 - 1), st.text(st.characters(exclude_characters="\0", codec="utf-8"))


def wrench(time_ns: int, force: float, frame: str = "base") -> bytes:
    return pack_stamped(WRENCH.type_name, Stamped(time_ns, frame, (0.0, 0.0, force, 0.0, 0.0, 0.0)))


def store() -> Any:
    typesys = pytest.importorskip("rosbags.typesys")
    return typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


@given(TIMES, FRAMES, st.lists(NUMBERS, min_size=7, max_size=7))
def test_another_implementation_reads_what_we_send_and_we_what_it_sends(
    time_ns: int, frame: str, numbers: list[float]
) -> None:
    other = store()
    for name, count in ((WRENCH.type_name, 6), (PROBE.type_name, 7)):
        message = Stamped(time_ns, frame, tuple(numbers[:count]))
        read = other.deserialize_cdr(pack_stamped(name, message), name)
        assert (read.header.stamp.sec, read.header.stamp.nanosec) == divmod(time_ns, 10**9)
        assert read.header.frame_id == frame
        assert unpack_stamped(name, bytes(other.serialize_cdr(read, name))) == message
    place, turn = (read.pose.position, read.pose.orientation)
    assert [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w] == numbers


@given(st.lists(FRAMES, max_size=8), st.lists(NUMBERS, max_size=8))
def test_joints_of_another_implementation_are_read(names: list[str], positions: list[float]) -> None:
    other, name = store(), FOLLOWER_JOINTS.type_name
    head, time, joints = (other.types[one] for one in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", name))
    none = np.empty(0)
    message = joints(head(time(1, 2), "base"), names, np.array(positions), none, none)
    read = unpack_stamped(name, bytes(other.serialize_cdr(message, name)))
    assert read == Stamped(1_000_000_002, "base", (tuple(names), tuple(positions), (), ()))


@given(st.sampled_from(TYPES), st.binary(max_size=200), st.booleans())
def test_bytes_that_are_no_message_are_refused_and_the_newest_stays(name: str, data: bytes, headed: bool) -> None:
    topic = Newest({WRENCH.type_name: WRENCH, PROBE.type_name: PROBE}.get(name, FOLLOWER_JOINTS))
    before = topic.heard
    topic.take((b"\0\1\0\0" if headed else b"") + data)
    assert (topic.heard is before) == bool(topic.problem)


def test_big_endian_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="begins with 00000000 and not with 00010000"):
        unpack_stamped(WRENCH.type_name, b"\0\0\0\0" + wrench(1, 1.0)[4:])


def test_a_sequence_that_claims_to_be_endless_ends_at_once() -> None:
    data = pack_stamped(FOLLOWER_JOINTS.type_name, Stamped(1, "base", ((), (), (), ())))
    with pytest.raises(ValueError, match="beyond its end"):
        unpack_stamped(FOLLOWER_JOINTS.type_name, data[:-16] + b"\xff" * 16)


def test_the_same_stamp_is_the_same_measurement_and_no_stamp_is_a_new_one() -> None:
    topic = Newest(WRENCH, ("base",))
    topic.take(wrench(5, 1.0))
    first = topic.heard
    topic.take(wrench(5, 2.0))
    assert topic.heard is first
    for force in (3.0, 4.0):
        topic.take(wrench(0, force))
        assert topic.heard is not None
        assert topic.heard.values[2] == force


def test_another_frame_is_a_problem_until_the_right_one_comes() -> None:
    topic = Newest(WRENCH, ("base", "fr3_link0"))
    topic.take(wrench(1, 1.0, "fr3_link0"))
    topic.take(wrench(2, math.nan, "tool0"))
    assert topic.problem == "/follower/wrench is in the frame 'tool0', and not in 'base' or 'fr3_link0'"
    topic.take(wrench(3, 2.0))
    assert topic.problem == ""
    unnamed = Newest(WRENCH)  # here the first message says which
    unnamed.take(wrench(1, 1.0, "omega_base"))
    unnamed.take(wrench(2, 1.0))
    assert unnamed.problem == "/follower/wrench is in the frame 'base', and not in 'omega_base'"


def test_topics_are_in_the_namespace_unless_they_begin_at_the_root() -> None:
    address = GraphAddress.read(
        "robot", "ros2@namespace=/left,wrench=/ft", {"wrench": "wrench", "pose": "current_pose"}
    )
    assert address.router == ROUTER
    assert address.topic("wrench", WRENCH).name == "/ft"
    assert address.topic("pose", PROBE).name == "/left/current_pose"
    assert GraphAddress.read("robot", "ros2", {"pose": "a/b"}).topic("pose", PROBE).name == "/a/b"
