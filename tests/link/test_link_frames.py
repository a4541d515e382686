"""Frames over a real TCP connection, from programs that mean well and from others."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from foretouch.errors import LinkError
from foretouch.link import CHANNEL_NUMBERS, FrameServer, free_endpoint
from foretouch.link.frames import PAUSE, QUEUED, UNANSWERED_MS
from foretouch.messages import LARGEST_MESSAGE

Served = tuple[FrameServer, int, list[str]]


@pytest.fixture
def served() -> Iterator[Served]:
    endpoint, said = free_endpoint(), list[str]()
    server = FrameServer(endpoint, said.append)
    yield server, int(endpoint.rpartition(":")[2]), said
    server.close()


def frame(channel: str | int, data: bytes) -> bytes:
    number = CHANNEL_NUMBERS[channel] if isinstance(channel, str) else channel
    return struct.pack("<IB", 1 + len(data), number) + data


def until(server: FrameServer, condition: Callable[[list[tuple[str, bytes]]], Any]) -> list[tuple[str, bytes]]:
    end, came = time.monotonic() + 5.0, list[tuple[str, bytes]]()
    while not condition(came):
        assert time.monotonic() < end, "it did not happen in time"
        came += server.exchange(0.01)
    return came


def connected(served: Served) -> socket.socket:
    server, port, _ = served
    program = socket.create_connection(("127.0.0.1", port))
    until(server, lambda _: server.connected)
    program.settimeout(5.0)
    return program


def test_frames_go_both_ways_whole_and_in_order(served: Served) -> None:
    server = served[0]
    with connected(served) as program:
        sent = [("command", bytes([number])) for number in range(200)] + [("leader", b"x" * LARGEST_MESSAGE)]
        stream = b"".join(frame(*one) for one in sent)
        for at in range(0, 3000, 7):  # however TCP cuts them
            program.sendall(stream[at : at + 7])
        program.sendall(stream[3003:])
        assert until(server, lambda came: len(came) == len(sent)) == sent
        for number in range(10):
            server.hand("telemetry", bytes([number]))
        server.hand("stop", b"end")
        server.exchange(0.0)
        wanted = frame("stop", b"end") + b"".join(frame("telemetry", bytes([number])) for number in range(10))
        assert program.recv(len(wanted), socket.MSG_WAITALL) == wanted
    until(server, lambda _: not server.connected)
    assert (server.taken, server.handed, server.dropped) == (201, 11, 0)
    assert len(served[2]) == 1
    assert "a program has connected" in served[2][0]


@pytest.mark.parametrize(
    ("begin", "line"),
    [
        (struct.pack("<IB", 0, 0), "a frame of 0 bytes"),
        (struct.pack("<IB", 1, 0), "a frame of 1 bytes"),
        (struct.pack("<I", LARGEST_MESSAGE + 2), f"a frame of {LARGEST_MESSAGE + 2} bytes"),
        (b"\xff\xff\xff\xff", "a frame of 4294967295 bytes"),
        (b"GET / HTTP/1.1\r\n\r\n", "a frame of 542393671 bytes"),
        (frame(len(CHANNEL_NUMBERS), b"x"), "which there is not"),
        (frame(255, b"x"), "a frame for channel 255"),
    ],
)
def test_what_cannot_be_a_frame_closes_the_connection_with_one_line(served: Served, begin: bytes, line: str) -> None:
    server, port, said = served
    with connected(served) as program:
        program.sendall(frame("command", b"good") + begin)
        assert until(server, lambda _: not server.connected) == [("command", b"good")]
        assert program.recv(1) == b""
    assert line in said[1]
    assert len(said) == 2
    begun = time.monotonic()
    with socket.create_connection(("127.0.0.1", port)):  # it waits for a moment, and is let in
        until(server, lambda _: server.connected)
        assert time.monotonic() - begun > 0.5 * PAUSE


def test_nobody_is_let_in_as_another_is_sent_away(served: Served) -> None:
    server, port, said = served
    with connected(served) as program:
        program.sendall(frame("command", b"good") + frame(200, b"bad"))
        with socket.create_connection(("127.0.0.1", port)):
            time.sleep(0.05)
            assert server.exchange(0.01) == [("command", b"good")]
            assert not server.connected
            until(server, lambda _: server.connected)
    assert "closed the connection" in said[-2]


def test_one_program_at_a_time(served: Served) -> None:
    server, port, said = served
    with connected(served) as program:
        for _ in range(3):
            with socket.create_connection(("127.0.0.1", port)) as second:
                second.settimeout(0.01)
                end, gone = time.monotonic() + 5.0, False
                while not gone:
                    server.exchange(0.01)
                    assert time.monotonic() < end
                    try:
                        gone = second.recv(1) == b""
                    except TimeoutError:
                        continue
        program.sendall(frame("command", b"still here"))
        assert until(server, bool) == [("command", b"still here")]
    assert sum("one at a time" in line for line in said) == 1


def test_who_does_not_read_loses_the_oldest_and_holds_nobody_up(served: Served) -> None:
    server = served[0]
    with connected(served) as program:
        begun, waits = time.monotonic(), list[int]()
        for number in range(40_000):
            server.hand("telemetry", struct.pack("<I", number) + bytes(200))
            server.exchange(0.0)
            waits.append(len(server._under_way) + sum(map(len, server._queues["telemetry"])))
        server.hand("stop", b"end")
        assert time.monotonic() - begun < 20.0
        assert server.dropped > 1000
        assert max(waits) < 65_536 + 500 + QUEUED * 210
        stream = bytearray()
        while b"end" not in stream:
            server.exchange(0.0)
            stream += program.recv(65_536)
        server.exchange(0.0)
        while True:
            try:
                program.settimeout(0.1)
                stream += program.recv(65_536)
            except TimeoutError:
                break
            server.exchange(0.0)
        numbers, at = list[int](), 0
        while at < len(stream):  # frames are whole, whatever was left out between them
            size, channel = struct.unpack_from("<IB", stream, at)
            if channel == CHANNEL_NUMBERS["telemetry"]:
                numbers.append(struct.unpack_from("<I", stream, at + 5)[0])
            at += 4 + size
        assert numbers == sorted(numbers)
        assert numbers[-1] == 39_999


@pytest.mark.long
def test_who_reads_nothing_for_seconds_is_taken_for_gone(served: Served) -> None:
    server, _, said = served
    with connected(served):
        begun = time.monotonic()
        while server.connected:
            server.hand("telemetry", bytes(200))
            server.exchange(0.001)
            assert time.monotonic() - begun < 30.0
    assert time.monotonic() - begun > UNANSWERED_MS / 1000
    assert said[-1].endswith("has read nothing for 5 s")


def test_a_ring_ends_a_wait(served: Served) -> None:
    server = served[0]
    for _ in range(100_000):
        server.ring()
    begun = time.monotonic()
    server.exchange(5.0)
    assert time.monotonic() - begun < 1.0


def test_nothing_is_kept_for_a_program_that_is_not_there(served: Served) -> None:
    server = served[0]
    server.hand("telemetry", b"old")
    with connected(served) as program:
        server.hand("telemetry", b"new")
        server.exchange(0.0)
        assert program.recv(100) == frame("telemetry", b"new")


@pytest.mark.parametrize("endpoint", ["tls/127.0.0.1:7460", "tcp/192.0.2.1:7460", "127.0.0.1:7460"])
def test_an_address_that_is_not_allowed_is_refused(endpoint: str) -> None:
    with pytest.raises(LinkError, match=endpoint):
        FrameServer(endpoint, print)


def test_a_port_in_use_is_refused(served: Served) -> None:
    with pytest.raises(LinkError, match="cannot listen on"):
        FrameServer(f"tcp/127.0.0.1:{served[1]}", print)
