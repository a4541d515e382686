"""What strangers say without end, or in another version, costs neither memory nor the session."""

from __future__ import annotations

import gc
import os
import threading
import time
import tracemalloc
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from running import until

from foretouch.console.watched import Watched
from foretouch.errors import PeerVersionError
from foretouch.link import ZenohLink, free_endpoint
from foretouch.link.zenoh_link import PATIENCE
from foretouch.messages import VERSION, Hello, Hellos, Message, ModelUpdate, encode
from foretouch.session import Housekeeper, Process, StopFlag, wait_for_hello
from foretouch.session.runners.housekeeping import NOT_RECORDED
from foretouch.session.steps.follower_view import MOST_FORMER, FollowerView

pytestmark = pytest.mark.network

SIZE = 46_000


def hello(number: int, role: str, texts: int, length: int) -> bytes:
    """Some 49 kB that are another's each time: their role, or the names of what they tell."""
    names = tuple(f"n{number}-{i}" for i in range(texts))
    return encode(Hello(VERSION, 1, 1, role, names, ("v" * length,) * texts))


@pytest.fixture
def stranger() -> Iterator[tuple[ZenohLink, Any]]:
    endpoint = free_endpoint()
    with ZenohLink(listen=[endpoint], subscribe=["hello"]) as link, ZenohLink(connect=[endpoint]) as other:
        session = other._session
        until(lambda: session.put("foretouch/hello", b"x") or link.undecodable)
        yield link, session


@pytest.mark.long  # a console's bound is tested in test_console_watched
@pytest.mark.parametrize("kind", ["other roles", "other names", "more than it may have"])
def test_memory_does_not_grow_with_hellos(stranger: tuple[ZenohLink, Any], kind: str) -> None:
    (link, session), count = stranger, 200
    output: list[str] = []
    house = Housekeeper(Process(link, StopFlag(), output.append), "follower", dict, news=lambda heard: str(len(heard)))
    watched, hellos = Watched(), Hellos()
    house.start()
    waiting = threading.Thread(target=wait_for_hello, args=(link, {"leader"}, flag := StopFlag()))
    waiting.start()
    gc.collect()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        sent = 0
        for number in range(count):
            role = {"other roles": f"r{number}", "other names": ("leader", "recorder", "camera")[number % 3]}
            many = kind == "more than it may have"
            data = hello(number, role.get(kind, "leader"), 129 if many else 120, 355 if many else 380)
            sent = max(sent, len(data))
            session.put("foretouch/hello", data)
            if kind == "other names":
                one = msgspec.msgpack.decode(data, type=Hello)
                watched.take(one, number * 1e-3)
                hellos.take(one)
        assert sent > SIZE
        until(lambda: not link.inboxes["hello"])
        time.sleep(1.0)
        gc.collect()
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
        flag.set("over")
        waiting.join()
        house.close("over")
    assert grown < 5e6, f"{grown * 1e-6:.1f} MB were kept of {count * sent * 1e-6:.0f} MB"


def test_followers_without_end_fill_nothing() -> None:
    received = FollowerView(5)
    update = ModelUpdate(VERSION, 1, 1, 0, "x", (), (), 0.0, False, "", "", b"")
    for run in range(1, 3 * MOST_FORMER):
        received.is_for_us(msgspec.structs.replace(update, run=run))
    for run in (2 * MOST_FORMER, 3 * MOST_FORMER - 2):  # of those before the newest, some are remembered
        assert not received.is_for_us(msgspec.structs.replace(update, run=run))
    assert received.records.nbytes < 50_000


def waits(link: ZenohLink, session: Any, *said: bytes, parent: int | None = None) -> dict[str, dict[str, str]]:
    ended = threading.Event()

    def speak() -> None:
        while not ended.wait(0.02):
            for one in said:
                session.put("foretouch/hello", one)

    speaker = threading.Thread(target=speak)
    speaker.start()
    try:
        return wait_for_hello(link, {"follower"}, StopFlag(), timeout=PATIENCE + 0.5, parent=parent)
    finally:
        ended.set()
        speaker.join()


def test_a_leader_that_starts_waits_on_whatever_strangers_say(stranger: tuple[ZenohLink, Any]) -> None:
    link, session = stranger
    others = (encode(Hello(VERSION + 1, 1, 1, role, (), ())) for role in ("recorder", "leader", "x"))
    assert waits(link, session, bytes((0x91, VERSION + 1)), *others) == {}
    assert link.foreign > 20


def test_a_follower_of_another_version_ends_the_wait(stranger: tuple[ZenohLink, Any]) -> None:
    link, session = stranger
    with pytest.raises(PeerVersionError, match=f"message version {VERSION + 1}, this side version {VERSION}"):
        waits(link, session, encode(Hello(VERSION + 1, 1, 1, "follower", (), ())))


def test_processes_of_one_parent_are_of_one_version(stranger: tuple[ZenohLink, Any]) -> None:
    link, session = stranger
    assert waits(link, session, encode(Hello(VERSION + 1, 1, 1, "follower", (), ())), parent=os.getppid()) == {}


def test_what_is_too_large_is_said_once_and_counted(stranger: tuple[ZenohLink, Any]) -> None:
    link, _ = stranger
    output: list[str] = []
    house = Housekeeper(Process(link, StopFlag(), output.append), "follower", dict)
    large: Message = ModelUpdate(VERSION, 1, 1, 0, "x", (0.5,) * 4000, (0.5,) * 4000, 0.0, True, "", "", b"")
    for _ in range(3):
        link.publish(large)
        house._report_link()
    size = len(encode(large))
    assert [line for line in output if "too" in line or "not sent" in line] == [
        f"follower: a ModelUpdate of {size} bytes was not sent: at most 48000 go over the network; "
        "it is counted as unsent, and others like it"
    ]
    assert link.unsent == 3


class Saying:
    def __init__(self, **texts: str) -> None:
        self.hello = Hello.of("leader", 1, 1, texts)

    def take(self, channel: str) -> list[tuple[int, Hello]]:
        return [(1, self.hello)]


@pytest.mark.parametrize("parent", [None, os.getppid()])
def test_a_side_without_a_parent_says_who_is_there_that_a_stop_is_over_and_why_it_ends(parent: int | None) -> None:
    output: list[str] = []
    trouble = ["", "emergency stop (asked)", ""]
    house = Housekeeper(
        Process(Saying(leader="anna"), StopFlag(), output.append, parent),  # type: ignore[arg-type]
        "follower",
        dict,
        lambda heard: trouble.pop(0),
        over=lambda: "the robot follows",
    )
    while trouble:
        house._tell_news()
    house.say_end("interrupted")
    ended = ["the session has ended: interrupted", NOT_RECORDED]
    alone = ["connected: the leader is anna", "", "the robot follows", *ended]
    lines = alone if parent is None else [""]
    assert output == [f"follower: {line or 'emergency stop (asked)'}" for line in lines]
