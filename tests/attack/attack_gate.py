"""What a program can do that connects to a gate: rubbish, wrong sizes, floods, names of others, reading nothing.

The gate stands beside a follower that obeys a leader over TLS; the program has no key, and the gate's is `leader.bob`.
"""

from __future__ import annotations

import random
import socket
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from target import Process, Score, Target, session, until

from foretouch.link import CHANNEL_NUMBERS, free_endpoint
from foretouch.messages import LARGEST_MESSAGE, VERSION, Command, Message, Settings, encode

MOST_GROWTH = 30.0
"""The gate may grow by so much [MB] while it is attacked."""

CLOSED = 5.0  # Time in which a connection has to be closed that breaks the rules [s]


def frame(channel: str, data: bytes) -> bytes:
    return struct.pack("<IB", 1 + len(data), CHANNEL_NUMBERS[channel]) + data


def said(channel: str, message: Message) -> bytes:
    return frame(channel, encode(message))


def command(epoch: int, holder: str = "leader", sequence: int = 1) -> Command:
    return Command(VERSION, sequence, time.monotonic_ns(), 0.02, 0, holder=holder, epoch=epoch)


def connected(port: int) -> socket.socket:
    """A connection, once the gate lets somebody in again."""
    program = socket.create_connection(("127.0.0.1", port), timeout=CLOSED)
    program.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return program


def is_closed(program: socket.socket) -> bool:
    """Whether the gate closes the connection soon."""
    end = time.monotonic() + CLOSED
    while time.monotonic() < end:
        try:
            if not program.recv(65_536):
                return True
        except TimeoutError:
            return False
        except OSError:
            return True
    return False


def refused(port: int, streams: list[bytes]) -> int:
    """How many of these streams leave the connection open."""
    stayed = 0
    for stream in streams:
        with connected(port) as program:
            try:
                program.sendall(stream)
            except OSError:
                continue
            stayed += not is_closed(program)
    return stayed


def streams(chance: random.Random) -> list[bytes]:
    whole = said("command", command(1))
    rubbish = [chance.randbytes(chance.randrange(16, 4000)) for _ in range(4)]
    heads = [struct.pack("<I", size) for size in (0, 1, LARGEST_MESSAGE + 2, 2**31, 2**32 - 1)]
    bodies = [
        frame("command", chance.randbytes(60)),
        frame("command", encode(command(1))[:-1]),
        frame("model", b"\x90"),
    ]
    others = [said("settings", Settings(VERSION, 1, 1, 0.0, 0.0)), struct.pack("<IB", 2, 99) + b"x"]
    return [whole + one for one in (*rubbish, *heads, *bodies, *others)]


def flooded(port: int, make: Callable[[int], bytes], count: int) -> None:
    """Send as fast as it is taken, and read nothing."""
    with connected(port) as program:
        for number in range(count):
            program.sendall(make(number))
        time.sleep(1.0)


def named_by_the_follower(target: Target, port: int) -> str:
    """Whom the follower names as asking for control, while a program claims to be the leader that has it."""
    target.watch.take("hello")
    with connected(port) as program:
        for number in range(2000):
            program.sendall(said("command", command(2**62, "leader", number + 1)))
            time.sleep(1e-3)
        hellos = [hello.texts for _, hello in target.watch.take("hello") if hello.role == "follower"]
    return next((texts["contest"] for texts in reversed(hellos) if texts.get("contest")), "nobody is named")


def attack(target: Target, folder: Path, score: Score) -> None:
    at, chance = free_endpoint(), random.Random(1)
    port = int(at.rpartition(":")[2])
    bob = folder / "bob"
    bob.mkdir(mode=0o700)
    for name in ("authority.crt", "allowed.txt", "leader.bob.pem"):
        copy = bob / name
        copy.touch(mode=0o600)
        copy.write_bytes((target.keys.path / name).read_bytes())
    gate = Process(folder, "gate", "--connect", target.at_follower, "--at", at, "--keys", bob)
    try:
        until(lambda: "may connect" in gate.said, 60.0, "the gate listens")
        flooded(port, lambda number: said("command", command(1, sequence=number + 1)), 2000)  # it has grown to its size
        before, memory = target.traces(), gate.memory
        tried = streams(chance)
        score.note("a frame that is none, or that no leader says", len(tried), refused(port, tried))
        known = named_by_the_follower(target, port)
        score.note("a command in the name of who holds control", 2000, int("leader.bob" not in known), known)
        flooded(port, lambda number: said("command", command(2, sequence=number + 1)), 50_000)
        others = [socket.create_connection(("127.0.0.1", port), timeout=CLOSED) for _ in range(50)]
        time.sleep(1.0)
        for one in others:
            one.close()
        after = target.traces()
        changed = {name for name in after if after[name] != before[name] and name in ("running", "obeyed", "stopped")}
        score.note("control, a stop, or an end by any of this", len(tried) + 52_000, len(changed), f"{changed or ''}")
        grown = round(gate.memory - memory)
        score.note("more memory of the gate than is bounded", 1, int(grown > MOST_GROWTH), f"grew by {grown} MB")
        score.note("the gate's own end", 1, int(not gate.running))
        lines = len(gate.said.splitlines())
        score.note("more than a few lines a connection", 1, int(lines > 3 * (len(tried) + 60)), f"{lines} lines")
    finally:
        gate.end()


def main() -> int:
    score = Score()
    with tempfile.TemporaryDirectory() as name, session(Path(name)) as target:
        print("a program at a gate, beside a session over TLS", flush=True)
        attack(target, Path(name), score)
    return score.end()


if __name__ == "__main__":
    sys.exit(main())
