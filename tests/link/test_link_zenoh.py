"""A real Zenoh link on loopback."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import msgspec
import pytest
from intruders import intruder, until

from foretouch.errors import LinkError, PeerVersionError
from foretouch.link import ZenohLink, check_endpoint, free_endpoint
from foretouch.link.zenoh_link import PATIENCE
from foretouch.messages import CHANNELS, LARGEST_MESSAGE, VERSION, Command, Hello, Message, ModelUpdate, Stop, encode

pytestmark = pytest.mark.network


def command(sequence: int) -> Command:
    return Command(VERSION, sequence, time.monotonic_ns(), 0.01, 0)


def hello(version: int, role: str) -> bytes:
    return encode(Hello(version, 1, 1, role, (), ()))


@contextmanager
def joined(*channels: str) -> Iterator[tuple[ZenohLink, ZenohLink]]:
    endpoint = free_endpoint()
    with ZenohLink(listen=[endpoint], subscribe=channels) as near, ZenohLink(connect=[endpoint]) as far:
        yield near, far


@contextmanager
def visited(*channels: str) -> Iterator[tuple[ZenohLink, Any]]:
    endpoint = free_endpoint()
    with ZenohLink(listen=[endpoint], subscribe=channels) as link, intruder(connect=endpoint) as stranger:
        yield link, stranger


def test_messages_arrive_whole_and_in_order() -> None:
    with joined("command") as (near, far):
        until(lambda: far.publish(command(1)) or near.take("command"))
        time.sleep(0.2)
        near.take("command")
        sent = [command(n) for n in range(2, 502)]
        for message in sent:
            far.publish(message)
            time.sleep(1e-4)
        received: list[Message] = []
        until(lambda: received.extend(m for _, m in near.take("command")) or len(received) >= 500)
        assert received == sent
        assert near.undecodable == 0


def test_a_link_waits_for_a_peer_that_comes_later() -> None:
    endpoint = free_endpoint()
    with ZenohLink(connect=[endpoint]) as early:
        early.publish(command(1))  # nobody there: dropped, no error
        with ZenohLink(listen=[endpoint], subscribe=["command"]) as late:
            until(lambda: early.publish(command(2)) or late.take("command"))


def test_what_does_not_decode_is_counted_and_dropped() -> None:
    with visited("stop", "hello") as (link, stranger):
        until(lambda: stranger.put("foretouch/stop", b"garbage") or link.undecodable)
        assert link.foreign == 0
        other = Stop(VERSION + 1, 1, 1, "from the future")
        until(lambda: stranger.put("foretouch/stop", encode(other)) or link.foreign)
        assert not link.take("stop")


@pytest.mark.long
def test_a_stranger_of_another_version_is_counted_and_ends_nothing() -> None:
    """Two bytes count as another version; so does an old recorder, on its own key, and a side that spoke too late."""
    with visited("hello") as (link, stranger):

        def say_for_long(*words: bytes) -> None:
            end = time.monotonic() + PATIENCE + 0.5
            while time.monotonic() < end:
                for data in words:
                    stranger.put("foretouch/hello", data)
                time.sleep(0.02)

        say_for_long(b"\x91\x07", hello(VERSION + 1, "recorder"), b"\x94\x07\x01\x01\x07")
        assert link.foreign > 30
        assert link.other_version() is None
        until(lambda: stranger.put("foretouch/hello", hello(VERSION, "leader")) or link.take("hello"))
        foreign = link.foreign
        say_for_long(hello(VERSION + 1, "leader"))
        assert link.foreign > foreign
        assert link.other_version() is None


def test_a_side_of_another_version_is_told_of_once_nobody_else_has_spoken() -> None:
    with visited("hello") as (link, old):
        until(lambda: old.put("foretouch/hello", hello(VERSION + 1, "follower")) or link.foreign)
        assert link.other_version({"follower"}) is None, "a moment is left for the true one to speak"
        until(lambda: link.other_version({"follower"}))
        assert isinstance(link.other_version(), PeerVersionError)
        assert link.other_version({"leader"}) is None


@pytest.mark.parametrize("size", [LARGEST_MESSAGE - 5, LARGEST_MESSAGE])
def test_what_is_as_large_as_allowed_arrives(size: int) -> None:
    message = update_of(size)
    with joined("model") as (near, far):
        until(lambda: far.publish(message) or near.inboxes["model"])
        near.take("model")
        arrived: list[Message] = []
        until(lambda: far.publish(message) or arrived.extend(m for _, m in near.take("model")) or len(arrived) >= 20)
        assert arrived[0] == message
        assert len(encode(message)) == size
        assert (far.unsent, far.too_large, near.undecodable) == (0, "", 0)


def test_what_is_too_large_is_said_at_the_sender() -> None:
    with joined("model") as (near, far):
        until(lambda: far.publish(update_of(100)) or near.take("model"))
        for size in (LARGEST_MESSAGE + 1, 60_000, 100_000):
            far.publish(update_of(size))
        assert far.unsent == 3
        first = f"a ModelUpdate of {LARGEST_MESSAGE + 1} bytes was not sent"
        assert far.too_large == f"{first}: at most {LARGEST_MESSAGE} go over the network"
        until(lambda: far.publish(update_of(100)) or near.take("model"))  # the connection is none the worse


def update_of(size: int) -> ModelUpdate:
    numbers = (0.5,) * max(size // 9 - 60, 0)
    parts = (numbers[:2000], numbers[2000:4000], numbers[4000:])
    update = ModelUpdate(VERSION, 1, 1, 0, "x", parts[0], parts[1], 0.0, True, "", "", b"", standard_errors=parts[2])
    for _ in range(2):  # the head of a longer byte string is longer, too
        update = msgspec.structs.replace(update, map=b"x" * (len(update.map) + size - len(encode(update))))
    return update


def test_an_inbox_holds_what_comes_in_some_seconds() -> None:
    with ZenohLink(listen=[free_endpoint()], subscribe=list(CHANNELS)) as link:
        lengths = {name: inbox.maxlen for name, inbox in link.inboxes.items()}
    assert lengths["command"] == lengths["telemetry"] == 20_000
    assert (lengths["model"], lengths["image"], lengths["hello"]) == (1000, 600, 64)


def test_a_port_in_use_is_refused_in_one_line() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(LinkError, match=f"port {port} on 127.0.0.1 is in use"):
            ZenohLink(listen=[f"tcp/127.0.0.1:{port}"])


@pytest.mark.parametrize(
    ("endpoint", "message"),
    [
        *((f"tcp/{host}:7447", "off this .*--insecure") for host in ("192.0.2.1", "0.0.0.0", "[::]", "robot.lab")),
        *((f"tcp/{host}:7447", "") for host in ("127.0.0.1", "localhost", "[::1]", "127.5.5.5")),
        *((wrong, "write it as tcp/HOST:PORT") for wrong in ("127.0.0.1:7447", "udp/127.0.0.1:7447", "tcp/127.0.0.1")),
        *((wrong, "write it as tcp/HOST:PORT") for wrong in ("tcp/127.0.0.1:0", "")),
    ],
)
def test_endpoints_are_on_this_machine_or_insecure_and_written_as_they_should_be(endpoint: str, message: str) -> None:
    with pytest.raises(LinkError, match=message) if message else nullcontext():
        check_endpoint(endpoint)
    if "insecure" in message:
        check_endpoint(endpoint, insecure=True)
