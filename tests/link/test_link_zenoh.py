"""A real Zenoh link on loopback."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

import pytest

from foretouch.errors import LinkError, PeerVersionError
from foretouch.link import ZenohLink, check_endpoint, free_endpoint
from foretouch.messages import VERSION, Command, Message, Stop

pytestmark = pytest.mark.live


def until(condition: Callable[[], object], seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.01)


def command(sequence: int) -> Command:
    return Command(VERSION, sequence, time.monotonic_ns(), 0.01, 0)


def test_messages_arrive_whole_and_in_order() -> None:
    endpoint = free_endpoint()
    with ZenohLink(listen=[endpoint], subscribe=["command"]) as near, ZenohLink(connect=[endpoint]) as far:
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
    import zenoh

    endpoint = free_endpoint()
    config = zenoh.Config()
    for key, value in {
        "mode": '"peer"',
        "connect/endpoints": f'["{endpoint}"]',
        "scouting/multicast/enabled": "false",
        "transport/unicast/lowlatency": "true",
        "transport/unicast/qos/enabled": "false",
    }.items():
        config.insert_json5(key, value)
    with ZenohLink(listen=[endpoint], subscribe=["stop"]) as link, zenoh.open(config) as stranger:
        until(lambda: stranger.put("foretouch/stop", b"garbage") or link.undecodable)
        assert link.version_error is None
        other = Stop(VERSION + 1, 1, 1, "from the future")
        from foretouch.messages import encode

        until(lambda: stranger.put("foretouch/stop", encode(other)) or link.version_error)
        assert isinstance(link.version_error, PeerVersionError)
        assert not link.take("stop")


def test_a_port_in_use_is_refused_in_one_line() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(LinkError, match=f"port {port} on 127.0.0.1 is in use"):
            ZenohLink(listen=[f"tcp/127.0.0.1:{port}"])


@pytest.mark.parametrize("endpoint", ["tcp/192.0.2.1:7447", "tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/robot.lab:7447"])
def test_endpoints_off_this_machine_need_insecure(endpoint: str) -> None:
    with pytest.raises(LinkError, match=r"off this machine .*--insecure"):
        check_endpoint(endpoint)
    check_endpoint(endpoint, insecure=True)


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:7447", "tcp/localhost:7447", "tcp/[::1]:7447", "tcp/127.5.5.5:1"])
def test_loopback_is_allowed(endpoint: str) -> None:
    check_endpoint(endpoint)


@pytest.mark.parametrize("endpoint", ["127.0.0.1:7447", "udp/127.0.0.1:7447", "tcp/127.0.0.1", "tcp/127.0.0.1:0", ""])
def test_malformed_endpoints_say_how_to_write_one(endpoint: str) -> None:
    with pytest.raises(LinkError, match="write it as tcp/HOST:PORT"):
        check_endpoint(endpoint)
