"""The ends: within their budget, alive, quick in an emergency, and deaf to what is none of their records."""

from __future__ import annotations

import random
import sys
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from thin_serial import BothEnds, SerialLink, hello_at, model_at, most_in_a_second
from thin_ticks import EPOCH, MS, RUN, command_at, telemetry_at

from foretouch.messages import (
    VERSION,
    Command,
    EmergencyStop,
    FieldUpdate,
    FollowerPacket,
    Hello,
    LeaderPacket,
    Message,
    Stop,
    Telemetry,
    decode,
    encode,
)
from foretouch.session import SessionSettings
from foretouch.session.network.pieces import PARITIES, PIECE, Outbox
from foretouch.session.thin import FollowerEnd, LeaderEnd, end_of
from foretouch.session.thin.ends import EMERGENCY, HELLO_NS, PROTECTIONS, USUAL
from foretouch.session.thin.lines.sides import CONTEXT, LINES
from foretouch.session.thin.lines.stream import LONGEST_GAP, REACH

SECONDS = 6
WEIGHTS: dict[str, dict[str, Any]] = {
    "silent": {},
    "noisy": {"noise": 5e-4},
    "saturated": {"noise": 5e-4, "heavy": True},
    "heavy": {"heavy": True},
    "images": {"images": True},
    "space": {"space": True},
    "noisy space": {"space": True, "noise": 2e-3},
    "saturated space": {"space": True, "noise": 2e-3, "heavy": True, "holder": "h" * 64, "images": True},
}


def at_once() -> tuple[SerialLink, SerialLink]:
    return SerialLink(1e9), SerialLink(1e9)


@pytest.mark.parametrize(
    ("budget", "protection"), [(1000.0, USUAL), (2000.0, "none"), (2000.0, "strong"), (5000.0, USUAL)]
)
@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.first
def test_no_second_has_more_bytes_than_the_budget_and_a_packet(weight: str, budget: float, protection: str) -> None:
    both = BothEnds(budget, at_once(), protection=protection, **WEIGHTS[weight])
    both.run(1000 * SECONDS)
    for end, sent in zip((both.leader, both.follower), both.sent, strict=True):
        largest = max(size for _, size in sent)
        assert most_in_a_second(sent) <= budget + largest
        assert 0 <= end.sent - sum(size for _, size in sent) <= 5 * end.packets  # a number may be shorter
        assert end.packets == len(sent)
        if "saturated" in weight:
            assert end.sent > 0.9 * budget * SECONDS


@pytest.mark.parametrize("weight", WEIGHTS)
def test_a_fast_hand_costs_no_more_than_the_budget(weight: str) -> None:
    """At 1 m/s its lines may go on for 5 ticks."""
    both = BothEnds(2000.0, at_once(), **WEIGHTS[weight])
    both._of_leader = lambda: [command_at(both.tick, position=1e-3 * both.tick)]  # type: ignore[method-assign]
    both.run(3000)
    assert most_in_a_second(both.sent[0]) <= 2000.0 + max(size for _, size in both.sent[0])


@pytest.mark.parametrize("budget", [1000.0, 2000.0])
@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.first
def test_a_sign_of_life_comes_at_the_latest_every_fifty_milliseconds(weight: str, budget: float) -> None:
    both = BothEnds(budget, at_once(), **WEIGHTS[weight])
    both.run(10)
    commands: list[Message] = []
    last = {"leader": 0, "follower": 0}
    for _ in range(1000 * SECONDS):
        commands, said = both.run(1)
        for side, hearing in (("follower", both.follower._hearing), ("leader", both.leader._hearing)):
            if hearing.tick != last[side]:
                assert hearing.tick - last[side] <= LONGEST_GAP
                last[side] = hearing.tick
        if both.tick > 500 and not both._noise:
            assert [type(one) for one in commands] == [Command]
            assert Telemetry in [type(one) for one in said]
    assert min(last.values()) > both.tick - LONGEST_GAP - 2


@pytest.mark.parametrize("weight", ["heavy", "saturated", "saturated space"])
@pytest.mark.first
def test_big_things_come_through_beside_noise(weight: str) -> None:
    both = BothEnds(2000.0, at_once(), **WEIGHTS[weight])
    models = 0
    for _ in range(8000):
        _, said = both.run(1)
        models += sum(type(one).__name__ == "ModelUpdate" for one in said)
    assert models >= 4
    assert sum(isinstance(message, Hello) for _, message in both.heard) >= 1


@pytest.mark.parametrize(
    ("weight", "trials", "protection"),
    [
        ("silent", 200, USUAL),
        ("images", 200, USUAL),
        pytest.param("saturated", 1000, USUAL, marks=pytest.mark.long),
        pytest.param("saturated space", 200, USUAL, marks=pytest.mark.long),
        ("heavy", 200, "none"),
        ("saturated", 200, "strong"),
    ],
)
def test_an_emergency_stop_is_heard_within_sixty_milliseconds_beside_all_else(
    weight: str, trials: int, protection: str
) -> None:
    """Over a serial link of the budget's rate, in simulated time; what it takes, in milliseconds."""
    delay = 30
    links = SerialLink(2000.0, delay * MS), SerialLink(2000.0, delay * MS)
    both, draw, took = (
        BothEnds(2000.0, links, protection=protection, **(WEIGHTS[weight] | {"holder": "somebody@a-machine"})),
        random.Random(1),
        [],
    )
    both.run(300)
    for press in range(1, trials + 1):
        both.run(draw.randint(60, 160))
        asked = both.tick
        both.leader.offer(EmergencyStop(VERSION, 1, asked * MS, "a reason that is longer than a word", press))
        both.heard.clear()
        while not (stops := [message for _, message in both.heard if isinstance(message, EmergencyStop)]):
            both.run(1)
            assert both.tick < asked + 1000
        assert stops[0].press == press
        took.append(both.tick - asked - delay)
    parts = np.quantile(took, (0.5, 0.9, 0.99, 1.0))
    queues = tuple(round(1e3 * link.longest_queue) for link in links)
    sys.stdout.write(
        f"{weight}: 50, 90, 99, 100 % of stops within {parts} ms beyond the delay; longest queues {queues} ms\n"
    )
    assert parts[2] <= 60.0


def test_the_stop_says_its_reason_and_goes_alone() -> None:
    leader, follower, heard = LeaderEnd(2000.0), FollowerEnd(2000.0), []
    follower.deliver = heard.append
    leader.offer(hello_at("leader", 1))
    leader.offer(EmergencyStop(VERSION, 1, 5, "ä" * 30, (1 << 63) - 1))
    (packet,) = leader.said([command_at(1)], MS)[1:]
    assert len(encode(packet)) <= 35
    follower.heard([packet], MS)
    assert [(type(one), one.press) for one in heard] == [(EmergencyStop, (1 << 63) - 1)]
    assert heard[0].reason == "ä" * 6
    assert decode(encode(heard[0]), EmergencyStop) == heard[0]


def real_packets() -> tuple[list[Any], list[Any]]:
    """Of a session with all there is, from the leader and from the follower."""
    kept: tuple[list[Any], list[Any]] = [], []

    class Keeping(SerialLink):
        def push(self, now_ns: int, packet: Message) -> None:
            kept[self is links[1]].append(packet)
            super().push(now_ns, packet)

    links = Keeping(1e9), Keeping(1e9)
    both = BothEnds(3000.0, links, **WEIGHTS["saturated"])
    both.leader.offer(EmergencyStop(VERSION, 1, 1, "now", 7))
    both.leader.offer(Stop(VERSION, 1, 1, "over"))
    both.run(1500)
    return kept


PACKETS = real_packets()


def mutated(content: bytes, draw: random.Random) -> bytes:
    data = bytearray(content)
    for _ in range(draw.randint(1, 6)):
        place = draw.randrange(len(data)) if data else 0
        match draw.randrange(6):
            case 0:
                del data[place:]
            case 1 if data:
                data[place] ^= 1 << draw.randrange(8)
            case 2 if data:
                data[place] = draw.choice((0, 1, 0x7F, 0x80, 0xFF))
            case 3:
                data[place:place] = draw.randbytes(draw.randint(1, 9))
            case 4:
                data += draw.choice(PACKETS[draw.randrange(2)]).content
            case 5:
                data[place : place + 9] = b"\xcf" + draw.choice((b"\xff" * 8, b"\x7f" + b"\xff" * 7, bytes(8)))
    return bytes(data[:4096])


def hostile(side: int, draw: random.Random) -> bytes:
    match draw.randrange(4):
        case 0:
            return draw.randbytes(draw.randint(0, 300))
        case 1:
            return bytes((draw.choice((CONTEXT, LINES, PIECE, *PARITIES, EMERGENCY)),)) + draw.randbytes(
                draw.randint(0, 40)
            )
        case 2:
            return mutated(draw.choice(PACKETS[side]).content, draw)
        case _:
            return bytes(draw.choice(PACKETS[draw.randrange(2)]).content)


@given(seed=st.integers(0, 10**9), follower=st.booleans())
@settings(max_examples=100)
def test_hostile_bytes_raise_nothing_and_nothing_comes_of_them_that_is_no_message(seed: int, follower: bool) -> None:
    draw = random.Random(seed)
    end: Any = FollowerEnd(2000.0) if follower else LeaderEnd(2000.0)
    packet, wanted = (
        (LeaderPacket, (Command,)) if follower else (FollowerPacket, (Telemetry, "ModelUpdate", FieldUpdate))
    )
    out: list[Message] = []
    end.deliver = out.append
    for tick in range(1, 400):
        packets = [
            packet(VERSION, draw.choice((tick, 1, 0, 2**63 - 1, draw.randrange(2**63))), 0, hostile(not follower, draw))
            for _ in range(draw.choice((0, 1, 1, 3)))
        ]
        due = end.heard(packets, tick * MS)
        assert all(type(one) in wanted or type(one).__name__ in wanted for one in due)
        out += due
        end.said([telemetry_at(tick) if follower else command_at(tick)], tick * MS)
    for message in out:
        again = decode(encode(message), type(message))
        assert encode(again) == encode(message)
    assert sum(len(begun.pieces) + len(begun.parities) for begun in end._inbox._begun.values()) <= 5 * 263


def test_an_end_that_heard_nonsense_hears_who_speaks_then() -> None:
    """Random bytes for a second, then real packets: at the latest 1.5 s on commands come."""
    draw, end = random.Random(4), FollowerEnd(2000.0)
    end.deliver = lambda message: None
    for tick in range(1000):
        end.heard([LeaderPacket(VERSION, tick + 1, 0, draw.randbytes(40))], tick * MS)
    leader, first = LeaderEnd(2000.0), 0
    for tick in range(1, 2000):
        packets = leader.said([command_at(tick)], tick * MS)[1:]
        if end.heard(packets, (1000 + tick) * MS) and not first:
            first = tick
    assert 0 < first <= 1500


def pieces_of(name: str, data: bytes) -> list[bytes]:
    names = ("stop", "model", "field", "hello")
    outbox, records = Outbox(names, 200, PROTECTIONS[USUAL], 2), []
    outbox.put(name, data)
    while record := outbox.next(200):
        records.append(record)
    return records


@pytest.mark.parametrize(
    ("name", "data", "kinds"),
    [
        ("hello", encode(hello_at("follower", 1)), []),  # a leader that says it is the follower
        ("hello", encode(hello_at("leader", 1)), [Hello]),
        ("field", encode(FieldUpdate(VERSION, 1, 1, b"12345678", RUN)), []),
        ("model", encode(model_at(1)), []),
        ("stop", encode(Stop(VERSION, 1, 1, "over")), [Stop]),
        ("stop", encode(Stop(VERSION + 1, 1, 1, "of another version")), []),
        ("stop", b"no message", []),
    ],
)
def test_a_follower_takes_of_pieces_what_a_leader_may_say(name: str, data: bytes, kinds: list[type]) -> None:
    end, heard = FollowerEnd(2000.0), []
    end.deliver = heard.append
    for number, record in enumerate(pieces_of(name, data)):
        assert end.heard([LeaderPacket(VERSION, number + 1 if number else 2, 0, record)], MS) == []
    assert [type(one) for one in heard] == kinds


def test_texts_of_a_stop_and_a_holder_are_printable() -> None:
    end, heard = FollowerEnd(2000.0), []
    end.deliver = heard.append
    end.heard([LeaderPacket(VERSION, 1, 0, bytes((EMERGENCY, 4)) + bytes(8) + b"\x1b[2J")], MS)
    assert heard[0].reason.isprintable()
    leader = LeaderEnd(2000.0)
    packets = leader.said([command_at(1, holder="\x1b[2J")], MS)[1:]
    assert end.heard(packets, MS) == []


def test_telemetry_that_goes_on_by_itself_is_not_acknowledged() -> None:
    """A command says that a release was heard of only if a packet said so (`commands_before_release`)."""
    leader, follower, other = LeaderEnd(2000.0), FollowerEnd(2000.0), FollowerEnd(2000.0)
    newest, acknowledged = 0, 0
    for tick in range(1, 400):
        packets = follower.said([telemetry_at(tick, status=0, validity=0)], tick * MS)[1:]
        for one in leader.heard(packets if tick < 300 else [], tick * MS):
            newest = one.sequence
        said = leader.said([command_at(tick, telemetry_sequence=newest)], tick * MS)[1:]
        for one in other.heard(said, tick * MS):
            acknowledged = one.telemetry_sequence
            assert acknowledged <= leader._hearing.tick
    assert newest > acknowledged > 200


@pytest.mark.parametrize("heard", [True, False])
def test_a_hello_that_says_nothing_new_is_said_seldom_where_the_other_end_is_heard(heard: bool) -> None:
    end, other, hellos = LeaderEnd(2000.0), FollowerEnd(2000.0), 0
    texts = {"name": "value" * 20}
    for tick in range(1, 12_000):
        if tick % 500 == 0:
            end.offer(Hello.of("leader", tick, tick * MS, texts | {"count_of": str(tick)}))
            hellos += not end._outbox.is_empty
        end.said([command_at(tick)], tick * MS)
        end.heard(other.said([telemetry_at(tick)], tick * MS)[1:] if heard else [], tick * MS)
    assert hellos == (1 + 11_500 * MS // HELLO_NS if heard else 11_500 // 500)


def test_a_restarted_sides_hello_is_heard_though_it_counts_anew() -> None:
    follower, heard = FollowerEnd(2000.0), []
    follower.deliver = heard.append
    for begin, name in ((0, "first"), (3000, "second")):
        leader = LeaderEnd(2000.0)
        leader.offer(Hello.of("leader", 1, MS, {"leader": name}))
        for tick in range(1, 1500):
            packets = leader.said([command_at(tick, epoch=EPOCH + begin)], (begin + tick) * MS)[1:]
            follower.heard(packets, (begin + tick) * MS)
    assert [hello.texts["leader"] for hello in heard] == ["first", "second"]


def test_a_hello_that_nobody_heard_is_said_again_to_who_comes_later() -> None:
    leader, follower, heard = LeaderEnd(2000.0), FollowerEnd(2000.0), []
    follower.deliver = heard.append
    for tick in range(1, 3000):
        if tick % 500 == 1:
            leader.offer(Hello.of("leader", tick, tick * MS, {"leader": "anna"}))
        packets = leader.said([command_at(tick)], tick * MS)[1:]
        if tick > 1200:
            follower.heard(packets, tick * MS)
            leader.heard(follower.said([telemetry_at(tick)], tick * MS)[1:], tick * MS)
    assert 1 <= len(heard) <= 2
    assert {hello.texts["leader"] for hello in heard} == {"anna"}


def test_a_hello_beyond_all_bounds_stops_nothing() -> None:
    leader, follower, heard = LeaderEnd(1000.0), FollowerEnd(1000.0), []
    follower.deliver = heard.append
    leader.offer(hello_at("leader", 1, size=128, longest=1024))
    for tick in range(1, 3000):
        if tick == 100:
            leader.offer(Hello.of("leader", 2, MS, {"leader": "short"}))
        packets = leader.said([command_at(tick)], tick * MS)[1:]
        assert bool(follower.heard(packets, tick * MS)) or tick < 10
    assert [hello.texts for hello in heard] == [{"leader": "short"}]


def test_there_is_no_end_without_a_budget() -> None:
    assert end_of("leader", SessionSettings()) is None
    assert isinstance(end_of("leader", SessionSettings(budget=1000.0)), LeaderEnd)
    assert isinstance(end_of("follower", SessionSettings(budget=1000.0)), FollowerEnd)


def test_a_packet_counts_for_the_certificate_that_sent_it_alone() -> None:
    said, heard = LeaderEnd(4000.0), FollowerEnd(4000.0)
    came: dict[str, int] = {}
    for tick in range(1, 400):
        now_ns = tick * 1_000_000
        command = Command(VERSION, tick, now_ns, 0.001 * tick, 0, False, "leader.anna", 7)
        packets = [one for one in said.said([command], now_ns) if isinstance(one, LeaderPacket)]
        sender = "leader.anna" if tick < 200 else "leader.bob"
        packets = [msgspec.structs.replace(one, sender=sender) for one in packets]
        for message in heard.heard(packets, now_ns):
            came[sender] = came.get(sender, 0) + 1
            assert isinstance(message, Command)
            assert message.sequence <= 200 + REACH
    assert came["leader.anna"] > 150
    assert came["leader.bob"] <= REACH  # the lines of before go on for a while


def test_a_robot_s_side_asks_no_leader_to_stop() -> None:
    """An emergency stop goes to the robot: what comes back as one is nothing."""
    record = bytes((EMERGENCY, 0)) + (7).to_bytes(8, "little")
    for end, packet, taken in ((LeaderEnd(2000.0), FollowerPacket, 0), (FollowerEnd(2000.0), LeaderPacket, 1)):
        given: list[Message] = []
        end.deliver = given.append
        end.heard([packet(VERSION, 1, 0, record)], MS)
        assert len(given) == taken
