"""What somebody who was let in can do with words alone: other versions, floods, garbage, control characters."""

from __future__ import annotations

import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
from target import STARTING, Process, Score, Target, intruder, listen, sample, session, until

from foretouch.link import free_endpoint
from foretouch.link.zenoh_link import PATIENCE
from foretouch.messages import CHANNELS, VERSION, EmergencyStop, Hello, encode

MOST_GROWTH = 30.0
"""A process may grow by so much [MB] while it is flooded: what is under way, and what the interpreter keeps of it."""

HOSTILE = "\x1b]0;mine\x07\x1b[2J\x1b[31mall is well\x1b[0m\r\nfollower: released \u202edesaeler"

Words = Callable[[int], tuple[str, bytes]]


def flood(target: Target, words: Words, count: int) -> int:
    watcher, sides = target.identity("watcher"), (target.follower, target.leader)
    before = [side.memory for side in sides]
    import zenoh

    received: list[str] = []
    with (
        intruder(connect=target.at_follower, identity=watcher, trusts=target.authority) as one,
        intruder(connect=target.at_leader, identity=watcher, trusts=target.authority) as two,
    ):
        kept = [listen(one, "foretouch/telemetry", received), listen(two, "foretouch/leader", received)]
        until(lambda: {"foretouch/telemetry", "foretouch/leader"} <= set(received), 15.0, "a watcher hears both sides")
        for each in kept:
            each.undeclare()
        for number in range(count):
            key, data = words(number)
            for peer in (one, two):
                peer.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)
        time.sleep(1.5)
    time.sleep(0.5)
    return round(max(side.memory - was for side, was in zip(sides, before, strict=True)))


def of_46_kb(role: str, number: object) -> tuple[str, bytes]:
    names = tuple(f"n{number}-{i}" for i in range(120))
    return "foretouch/hello/watcher", encode(Hello(VERSION, 1, 1, role, names, ("v" * 380,) * 120))


def other_names(number: int) -> tuple[str, bytes]:
    return of_46_kb("recorder", number)


def other_version(number: int) -> tuple[str, bytes]:
    whole = encode(Hello(VERSION + 1, 1, 1, ("recorder", "leader", "follower")[number % 3], (), ()))
    return "foretouch/hello/watcher", whole if number % 2 else bytes((0x91, VERSION + 1))


def garbage(number: int) -> tuple[str, bytes]:
    """Noise, and heads that claim to be as long as can be said."""
    draw = random.Random(number)
    heads = (*(bytes((head, 255, 255, 255, 255)) for head in (0xDD, 0xDF, 0xDB, 0xC6)), b"\x91" * 9000)
    key = draw.choice(("hello/watcher", "stop", "emergency", "settings"))
    return f"foretouch/{key}", draw.choice(heads) + draw.randbytes(draw.choice((0, 20, 45_000)))


def starts_all_the_same(target: Target, folder: Path) -> tuple[int, bool]:
    watcher = target.identity("watcher")
    endpoint, tried = free_endpoint("tls"), 0
    with (
        intruder(connect=endpoint, identity=watcher, trusts=target.authority) as session,
        intruder(connect=target.at_follower, identity=watcher, trusts=target.authority) as other,
    ):
        options = (
            "--keys",
            target.keys.path,
            "--operator",
            "scripted",
            "--duration",
            60,
            "--material",
            "hunt-crossley",
        )
        leader = Process(
            folder, "leader", "--connect", target.at_follower, "--listen", endpoint,
            "--keys", target.keys.path, *options,
        )  # fmt: skip
        try:
            end = time.monotonic() + STARTING
            while leader.running and "control" not in leader.said and time.monotonic() < end:
                for peer in (session, other):
                    peer.put(*other_version(tried))
                tried += 1
                time.sleep(0.02)
            return tried, "holds control" not in leader.said
        finally:
            leader.end()


def ends_a_teleop(folder: Path) -> tuple[int, bool]:
    teleop = Process(
        folder, "teleop", "--operator", "scripted", "--material", "hunt-crossley", "--duration", 120,
        "--port", free_endpoint().rpartition(":")[2], "--recording", folder / "teleop.mcap",
    )  # fmt: skip
    try:
        until(lambda: "watches it with" in teleop.said and "console: http" in teleop.said, STARTING, "teleop runs")
        line = next(line for line in teleop.said.splitlines() if "watches it with" in line)
        endpoints = [word for word in line.split() if word.startswith("tcp/")]
        tried, end = 0, time.monotonic() + PATIENCE + 4.0
        from contextlib import ExitStack

        with ExitStack() as stack:
            peers = [stack.enter_context(intruder(connect=endpoint)) for endpoint in endpoints]
            while time.monotonic() < end:
                for peer in peers:
                    for name in CHANNELS:
                        peer.put(f"foretouch/{name}", bytes((0x91, VERSION + 1)))
                        tried += 1
                    peer.put("foretouch/hello", other_version(tried)[1])
                time.sleep(0.02)
        return tried, not teleop.running or "ended with" in teleop.said
    finally:
        teleop.end()


def control_characters(target: Target) -> tuple[int, int]:
    watcher = target.identity("watcher")
    tried = 0
    with intruder(connect=target.at_follower, identity=watcher, trusts=target.authority) as session:
        hello = msgspec.structs.replace(sample("hello"), role="recorder", names=(HOSTILE[:60],), values=(HOSTILE,))

        def stops() -> bool:
            nonlocal tried
            session.put("foretouch/emergency", encode(EmergencyStop(VERSION, 1, 1, HOSTILE, 5)))
            session.put("foretouch/hello/watcher", encode(hello))
            tried += 2
            return "all is well" in target.follower.said and "all is well" in target.leader.said

        until(stops, 15.0, "the stop is told at both sides")
    printed = target.follower.said + target.leader.said
    return tried, sum(not letter.isprintable() and letter != "\n" for letter in printed)


def main() -> int:
    score = Score()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print("peers: a watcher's certificate, over TLS")
        with session(folder) as target:
            rows: tuple[tuple[str, Words, int], ...] = (
                ("hellos of 46 kB, each in another role", lambda number: of_46_kb(f"r{number}", ""), 4000),
                ("hellos of 46 kB, each with other names", other_names, 2000),
                ("hellos of another version, or two bytes of it", other_version, 2000),
                ("garbage of up to 45 kB", garbage, 4000),
            )
            flood(target, other_names, 200)  # what the interpreter keeps once and for all
            for what, words, count in rows:
                grown = flood(target, words, count)
                traces = target.traces()
                whole = traces["running"] and not traces["stopped"]
                score.note(what, 2 * count, int(grown > MOST_GROWTH or not whole), f"grew by {grown} MB")
            score.note("a leader that starts meanwhile ends", *map(int, starts_all_the_same(target, folder)))
            score.note("control characters printed raw", *control_characters(target))
        print("peers: no certificates, on one machine")
        score.note("a teleop ends of another version", *map(int, ends_a_teleop(folder)))
    return score.end()


if __name__ == "__main__":
    sys.exit(main())
