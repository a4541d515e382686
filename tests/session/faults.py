"""The faults that a live session is put to, each once: what it does, and what came of it."""

from __future__ import annotations

import random
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from fire import Fire, Outcome

from foretouch.messages import CHANNELS, VERSION, encode
from foretouch.session.network.lease import RANDOM_BITS

sys.path.append(str(Path(__file__).parents[1] / "link"))
from intruders import intruder, sample

PAUSE, CUT, STALL, NOISE = 3.0, 10.0, 1.0, 2.0
"""How long a process stands still, and the network is cut, and holds up; and strangers speak [s]."""

HOUR = 3600.0

CONNECTS = 100


def leader_killed(fire: Fire) -> Outcome:
    """Kill the leader and start it again, with a wall clock that is an hour behind what it was."""
    with fire.fault("leader killed", felt=True) as outcome:
        fire.kill("leader")
        fire.step_wall_clock(-HOUR)
        outcome.returned_ns = fire.restarted("leader")
    fire.step_wall_clock(0.0)
    assert fire.watcher.leader is not None
    began_ms = fire.watcher.leader.epoch >> RANDOM_BITS
    assert began_ms < 1e3 * (time.time() - 0.9 * HOUR), "the wall clock was not behind"
    return outcome


def follower_killed(fire: Fire) -> Outcome:
    """Kill the follower, and with it the simulated robot, which begins anew in free air."""
    with fire.fault("follower killed", felt=not fire.closed_loop) as outcome:
        outcome.relearns = True
        fire.kill("follower")
        outcome.returned_ns = fire.restarted("follower")
    return outcome


def leader_stands_still(fire: Fire) -> Outcome:
    return _stands_still(fire, "leader")


def follower_stands_still(fire: Fire) -> Outcome:
    return _stands_still(fire, "follower")


def _stands_still(fire: Fire, role: str) -> Outcome:
    with fire.fault(f"{role} stands still for {PAUSE:g} s") as outcome:
        fire.signal(role, signal.SIGSTOP)
        time.sleep(PAUSE)
        fire.signal(role, signal.SIGCONT)
    return outcome


def network_cut(fire: Fire) -> Outcome:
    with fire.fault(f"network cut for {CUT:g} s", felt=True) as outcome:
        fire.relay.cut()
        time.sleep(CUT)
        fire.relay.mend()
    return outcome


def network_stalls(fire: Fire) -> Outcome:
    with fire.fault(f"network stalls for {STALL:g} s", lossless=True) as outcome:
        fire.relay.hold(STALL)
        time.sleep(STALL)
    return outcome


def wall_clock_stepped(fire: Fire) -> Outcome:
    with fire.fault("wall clock stepped by an hour", lossless=True) as outcome:
        outcome.returned_ns = outcome.begin_ns
        fire.step_wall_clock(HOUR)
        time.sleep(0.5)
        fire.step_wall_clock(0.0)
    return outcome


def garbage(fire: Fire) -> Outcome:
    """Strangers say what is no message, half a message, or one of another version, a thousand times a second."""
    chance = random.Random(1)
    words = [msgspec.structs.replace(sample(name), version=VERSION + 1) for name in CHANNELS]
    output: list[tuple[str, bytes]] = [
        *((name, encode(word)) for name, word in zip(CHANNELS, words, strict=True)),
        *((name, encode(sample(name))[:-1]) for name in CHANNELS),
        *((name, chance.randbytes(chance.randrange(200))) for name in CHANNELS),
    ]
    with fire.fault("garbage and other versions at 1 kHz", lossless=True) as outcome:
        outcome.returned_ns = outcome.begin_ns

        def speak(endpoint: str) -> None:
            with intruder(connect=endpoint) as session:
                end = time.monotonic() + NOISE
                while time.monotonic() < end:
                    name, content = chance.choice(output)
                    session.put(f"foretouch/{name}", content)
                    time.sleep(1e-3)

        before = fire.undecodable()
        _at_both(fire, speak)
        fire.until(lambda: fire.undecodable() > before, "the garbage is counted")
        outcome.grown = {"undecodable": fire.undecodable() - before}
    return outcome


def connects(fire: Fire) -> Outcome:
    """Peers come, hear something, and go; `grown` says what the processes have more of than after the first."""
    with fire.fault(f"{CONNECTS} peers come and go", lossless=True) as outcome:
        outcome.returned_ns = outcome.begin_ns
        for count in (CONNECTS // 10, CONNECTS):
            _at_both(fire, lambda endpoint, count=count: _come_and_go(endpoint, count))
            time.sleep(0.5)
            if not fire.footprint:
                fire.footprint = fire.footprints()
        outcome.grown = fire.grown()
    return outcome


def _come_and_go(endpoint: str, count: int) -> None:
    for _ in range(count):
        heard = threading.Event()

        def hear(_: Any, heard: threading.Event = heard) -> None:
            heard.set()

        with intruder(connect=endpoint) as session:
            kept = [session.declare_subscriber(f"foretouch/{name}", hear) for name in ("telemetry", "leader")]
            assert heard.wait(10.0), "a peer hears nothing"
            assert len(kept) == 2


def _at_both(fire: Fire, action: Callable[[str], None]) -> None:
    threads = [
        threading.Thread(target=action, args=[endpoint]) for endpoint in (fire.follower_endpoint, fire.leader_endpoint)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


STAY: dict[str, Callable[[Fire], Outcome]] = {
    "network stalls": network_stalls,
    "wall clock": wall_clock_stepped,
    "garbage": garbage,
    "connects": connects,
    "follower stands still": follower_stands_still,
    "leader stands still": leader_stands_still,
    "network cut": network_cut,
}
"""Faults that all processes outlive."""

KILL: dict[str, Callable[[Fire], Outcome]] = {"leader killed": leader_killed, "follower killed": follower_killed}
"""In this order: after the second a scripted hand may not come to press again."""


def nothing(fire: Fire) -> Outcome:
    with fire.fault("nothing", felt=True, lossless=True) as outcome:
        outcome.returned_ns = outcome.begin_ns
    return outcome


def follower_killed_behind_a_cut(fire: Fire) -> Outcome:
    """Two faults at a time: the network is cut, the follower killed and started again, and then the network mended."""
    with fire.fault("follower killed while the network is cut", felt=not fire.closed_loop) as outcome:
        outcome.relearns = True
        fire.relay.cut()
        fire.kill("follower")
        fire.restarted("follower")
        time.sleep(PAUSE)
        fire.relay.mend()
    return outcome


def leader_killed_as_it_starts(fire: Fire) -> Outcome:
    with fire.fault("leader killed twice", felt=True) as outcome:
        fire.kill("leader")
        fire.restarted("leader")
        fire.kill("leader")
        outcome.returned_ns = fire.restarted("leader")
    return outcome
