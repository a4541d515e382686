"""Taking control from a leader that holds it: with a key of one's own, and on one machine without keys."""

from __future__ import annotations

import sys
import tempfile
import time
from collections import deque
from pathlib import Path
from typing import Any

import msgspec
from target import STARTING, Process, Score, Target, intruder, session, until

from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import VERSION, Command, Telemetry, decode, encode

SECONDS = 4.0
"""Control is tried to be taken for so long [s]."""

DEEP = 0.045
"""Where the robot is sent [m]: far deeper than the operator presses."""

DEEPER = 1e-3
"""[m] that the robot may go deeper by itself than before."""


def commands(telemetry: Telemetry, holder: str, clock: int, ahead: int, begun: float) -> Command:
    passed = round((time.monotonic() - begun) * 1000)
    sequence = telemetry.command_sequence + passed + ahead
    return Command(VERSION, sequence, clock + passed * 1_000_000, DEEP, 0, False, holder, telemetry.epoch)


def deepest(rows: list[Any]) -> float:
    return max((one.desired_position for one in rows), default=0.0)


def with_a_key_of_its_own(target: Target, score: Score) -> None:
    received: deque[Command] = deque(maxlen=10)
    rows: list[Any] = []
    target.telemetry()
    bob = target.identity("leader.bob")
    with (
        intruder(connect=target.at_follower, identity=bob, trusts=target.authority) as session,
        intruder(connect=target.at_leader, identity=bob, trusts=target.authority) as listening,
    ):
        kept = listening.declare_subscriber(
            "foretouch/command/leader", lambda one: received.append(decode(one.payload.to_bytes(), Command))
        )
        until(lambda: received, 15.0, "a leader's commands are heard by another leader, as documented")
        time.sleep(4.0)  # presses of the operator, to know how deep they go
        before = target.telemetry()
        newest, clock, begun = before[-1], received[-1].time_ns, time.monotonic()
        holder, end, tried = received[-1].holder, begun + SECONDS, 0
        while time.monotonic() < end:
            for ahead in (1, 700, -20):
                forged = commands(newest, holder, clock, ahead, begun)
                own = msgspec.structs.replace(forged, holder="leader.bob")
                for key in ("command", "command/leader", "command/leader.bob"):
                    for one in (forged, own):
                        session.put(f"foretouch/{key}", encode(one))
                        tried += 1
            rows += target.telemetry()
            time.sleep(0.002)
        kept.undeclare()
    time.sleep(1.0)
    rows += target.telemetry()
    taken = deepest(rows) > deepest(before) + DEEPER or len({one.epoch for one in rows}) != 1
    score.note("control taken by leader.bob, who copies all that it hears", tried, int(taken))
    for process, name in ((target.follower, "follower"), (target.leader, "leader")):
        shouted = "CONTROL CONTESTED: leader.bob would command too" in process.said
        score.note(f"tried unseen at the {name}'s terminal", 1, int(not shouted))


def without_keys(folder: Path, score: Score) -> None:
    endpoint = free_endpoint()
    common = ("--material", "hunt-crossley", "--duration", 120)
    follower = Process(folder, "follower", "--listen", endpoint, "--position-delay", 0, *common)
    leader = Process(folder, "leader", "--connect", endpoint, "--operator", "scripted", "--name", "anna", *common)
    try:
        with ZenohLink(connect=[endpoint], subscribe=["telemetry"]) as watch, intruder(connect=endpoint) as session:
            rows: list[Any] = []

            def follows() -> bool:
                rows.extend(message for _, message in watch.take("telemetry"))
                return any(one.command_sequence > 1000 for one in rows)

            until(follows, STARTING, "the robot follows")
            newest, begun, tried = rows[-1], time.monotonic(), 0
            while time.monotonic() < begun + SECONDS:
                clock = time.monotonic_ns() - round((time.monotonic() - begun) * 1e9)
                session.put("foretouch/command", encode(commands(newest, "anna", clock, 700, begun)))
                tried += 1
                time.sleep(0.01)
            time.sleep(1.5)
        shout, warning = "CONTROL CONTESTED: two command as anna", "every user of this machine may command"
        score.note("commands in the holder's name, unseen at the robot", tried, int(shout not in follower.said))
        score.note("... unseen by the operator", tried, int(shout not in leader.said))
        score.note("a follower that does not say who may command", 1, int(follower.said.count(warning) != 1))
    finally:
        leader.end()
        follower.end()


def main() -> int:
    score = Score()
    with tempfile.TemporaryDirectory() as folder:
        print("control: another leader's certificate")
        with session(Path(folder)) as target:
            with_a_key_of_its_own(target, score)
        print("control: no certificates, on one machine")
        without_keys(Path(folder), score)
    return score.end()


if __name__ == "__main__":
    sys.exit(main())
