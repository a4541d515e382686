"""Commands and telemetry come out as they went in, and as nobody else's."""

from __future__ import annotations

import itertools
import math
import random
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from thin_ticks import EPOCH, MS, RUN, Direction, command_at, telemetry_at

from foretouch.messages import Command, Telemetry, decode, encode
from foretouch.session.thin.lines.kinds import Commands, Context
from foretouch.session.thin.lines.sides import CONTEXT, CONTEXT_PERIOD, TAKEN_OVER, Saying, unwrapped
from foretouch.session.thin.lines.stream import FORCE, LONGEST_GAP, PLACE, POSITION, REACH

NUMBERS = {
    "position": POSITION.bound,
    "place": POSITION.bound,
    "desired_position": PLACE.bound,
    "force": FORCE.bound + FORCE.share * 2.0,
    "space": FORCE.bound + FORCE.share * 2.0,
}
NOT_SAID = {"velocity", "sensor_force", "exact_force", "compute_ns"}
COUNTS = {"acknowledged_model", "telemetry_sequence", "command_sequence", "model_sequence"}
"""Numbers of messages: of the newest record, so that they may be as old as that."""

SMOOTHED = 4.0  # What is left of a step after a packet adds to the bound


def flat(value: Any) -> list[float]:
    if isinstance(value, (tuple, list)):
        return [number for one in value for number in flat(one)]
    return [float(value)]


def require_alike(out: Any, into: Any, *, counts: bool = False) -> None:
    """Exactly but for the numbers that have lines."""
    assert (out.sequence, out.time_ns) == (into.sequence, into.time_ns)
    for name in type(into).__struct_fields__:
        mine, theirs = getattr(out, name), getattr(into, name)
        bound = NUMBERS.get(name, PLACE.bound if type(into) is Telemetry and name == "position" else None)
        if name in NOT_SAID or (name in COUNTS and not counts):
            continue
        if bound is None:
            assert mine == theirs, name
        elif theirs is not None:
            pairs = (
                flat(msgspec.structs.astuple(mine) if name == "space" else mine),
                flat(msgspec.structs.astuple(theirs) if name == "space" else theirs),
            )
            for one, other in zip(*pairs, strict=True):
                assert math.isnan(other) or abs(one - other) < SMOOTHED * bound, name


@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize("kind", ["commands", "telemetry"])
def test_what_comes_out_is_what_went_in(kind: str, space: bool) -> None:
    direction = Direction(kind)
    for tick in range(1, 5000):
        message = direction.message_at(tick, space=space)
        direction.say(message, tick)
        out = direction.hear(tick)
        said = direction.hearing.tick == tick
        require_alike(out, message, counts=said)
        assert decode(encode(out), type(message)) == out or kind == "telemetry"
    assert direction.records < 5000 // 8


@pytest.mark.parametrize("kind", ["commands", "telemetry"])
def test_a_flag_or_a_status_is_told_in_its_tick(kind: str) -> None:
    direction = Direction(kind)
    changed = {"guarded": True} if kind == "commands" else {"status": 6}
    for tick in range(1, 200):
        other = changed if tick >= 150 else dict.fromkeys(changed, 0)
        message = direction.message_at(200, **other)
        message = msgspec.structs.replace(message, sequence=tick, time_ns=tick * MS)
        direction.say(message, tick)
        out = direction.hear(tick)
        name = next(iter(changed))
        assert getattr(out, name) == getattr(message, name)


@given(
    begin=st.sampled_from((1, 65_000, 10**6, 10**9)),
    silence=st.integers(0, 30_000),
    ago=st.integers(0, 10**15),
    faster=st.sampled_from((0.99, 1.0, 1.01)),
)
@pytest.mark.long
def test_ticks_times_and_counts_come_round_also_in_a_silence_of_half_a_minute(
    begin: int, silence: int, ago: int, faster: float
) -> None:
    """All are said by 16 bits: 65 s of ticks, and 16 s of time, whose clock runs a little differently."""

    def message_at(tick: int) -> Command:
        time_ns = ago + round(faster * tick) * MS
        counts = {"acknowledged_model": tick // 20 + 40_000, "telemetry_sequence": tick + 70_000}
        return command_at(tick, time_ns=time_ns, **counts)

    end = begin + 300 + silence
    direction = Direction("commands", lambda tick: () if begin + 300 <= tick < end else (tick,))
    last = None
    # What is said in the silence is not heard, and is made here only where it matters.
    for tick in (*range(begin, begin + 420), *range(max(end - 60, begin + 420), end + 200)):
        message = message_at(tick)
        direction.say(message, tick)
        out = direction.hear(tick)
        if out is not None and direction.hearing.tick == tick:
            last = tick
            assert (out.sequence, out.acknowledged_model) == (tick, tick // 20 + 40_000)
            assert out.telemetry_sequence == tick + 70_000
            assert abs(out.time_ns - message.time_ns) < MS
    assert last is not None
    assert last > end


@given(low=st.integers(0, 2**40), near=st.integers(0, 2**40), bits=st.sampled_from((8, 16)))
def test_unwrapped_is_the_nearest(low: int, near: int, bits: int) -> None:
    span = 1 << bits
    number = unwrapped(low % span, bits, near)
    assert number >= 0
    assert number % span == low % span
    assert abs(number - near) <= span // 2 or number < span


def heard_by(direction: Direction, ticks: range, message_at: Any, saying: Any = None) -> list[Any]:
    out = []
    for now in ticks:
        message = message_at(now)
        if message is not None:
            direction.say(message, now, saying)
        out.append(direction.hear(now))
    return out


@pytest.mark.parametrize("pause", [0, 50, 150, 900, 3000])
@pytest.mark.parametrize("lost", [0, 3])
def test_a_restarted_leader_is_understood_within_a_second_and_a_half(pause: int, lost: int) -> None:
    """Also where its first packets are lost: from its first tick, or from when the old one was silent for 1 s."""
    direction = Direction("commands")
    heard_by(direction, range(1, 2000), command_at)
    begin, packets = 2000 + pause, 0

    def arrives(now: int) -> tuple[int, ...]:
        nonlocal packets
        packets += now >= begin
        return (now,) if packets > lost else ()

    direction.arrives = arrives
    saying = Saying(Commands())

    def of_the_new(now: int) -> Command | None:
        tick = now - begin + 1
        return command_at(tick, epoch=EPOCH + 9, holder="another") if tick > 0 else None

    out = heard_by(direction, range(2000, begin + 2500), of_the_new, saying)
    first = next(index for index, one in enumerate(out) if one is not None and one.epoch == EPOCH + 9)
    assert 2000 + first <= begin + 1500
    assert out[first].holder == "another"
    assert out[-1].sequence == 2500
    assert all(one.holder == ("another" if one.epoch == EPOCH + 9 else "somebody@here") for one in out if one)


def test_a_restarted_follower_is_understood_within_a_second_and_a_half() -> None:
    direction = Direction("telemetry")
    heard_by(direction, range(1, 70_000, 10), lambda now: telemetry_at(now // 10 + 1))
    saying = Saying(direction.saying._kind)
    begin = 70_000

    def of_the_new(now: int) -> Telemetry:
        return telemetry_at(now - begin + 1, run=RUN + 5, model_sequence=0, command_sequence=now)

    out = heard_by(direction, range(begin, begin + 2000), of_the_new, saying)
    first = next(index for index, one in enumerate(out) if one is not None and one.run == RUN + 5)
    assert first <= 1500
    assert out[-1].model_sequence == 0
    assert abs(out[-1].command_sequence - (begin + 1999)) <= LONGEST_GAP


def test_a_leader_of_a_long_session_is_understood_by_who_begins_to_hear() -> None:
    """Its numbers of messages are beyond what 16 bits say."""
    direction = Direction("commands")
    out = heard_by(direction, range(10**6, 10**6 + 60), lambda now: command_at(now, telemetry_sequence=5 * now))
    assert out[0].telemetry_sequence == 5 * 10**6
    assert out[0].time_ns == 10**6 * MS


@given(seed=st.integers(0, 10**6), gap=st.integers(0, 900))
@settings(max_examples=15)
def test_two_leaders_at_a_time_are_not_mixed(seed: int, gap: int) -> None:
    """The second speaks all the time, the first pauses for less than a lease: nothing is under the other's name."""
    draw = random.Random(seed)
    direction = Direction("commands", lambda now: [now + draw.randint(0, 20) for _ in range(draw.choice((0, 1, 1, 2)))])
    second, out = Saying(Commands()), []
    pause = draw.randint(300, 1500)
    for now in range(1, 3000):
        if not pause <= now < pause + gap:
            direction.say(command_at(now), now)
        if now > 100:
            other = command_at(now, epoch=EPOCH + 2, holder="other", position=0.5)
            direction.say(other, now, second)
        out.append(direction.hear(now))
    said = [one for one in out if one is not None]
    assert {one.holder for one in said} == {"somebody@here"}
    assert all(one.epoch == EPOCH and abs(one.position) < 0.1 for one in said)


def test_the_second_is_heard_once_the_first_is_silent_for_a_lease() -> None:
    direction, second = Direction("commands"), Saying(Commands())
    out = []
    for now in range(1, 4000):
        if now < 1000:
            direction.say(command_at(now), now)
        direction.say(command_at(now, epoch=EPOCH + 2, holder="other", position=0.5), now, second)
        out.append(direction.hear(now))
    first = next(index for index, one in enumerate(out) if one is not None and one.holder == "other")
    assert 999 + TAKEN_OVER - LONGEST_GAP <= first <= 999 + TAKEN_OVER + LONGEST_GAP
    assert out[-1].position == pytest.approx(0.5, abs=POSITION.bound)
    assert all(abs(one.position) < 0.1 or one.holder == "other" for one in out if one)


def test_who_spoke_long_ago_does_not_take_the_place_of_who_is_silent() -> None:
    direction, second = Direction("commands"), Saying(Commands())
    out = []
    for now in range(1, 8000):
        if not 5000 <= now < 6100:
            direction.say(command_at(now), now)
        if now < 1000:
            direction.say(command_at(now, epoch=EPOCH + 2, holder="other"), now, second)
        out.append(direction.hear(now))
    assert {one.holder for one in out if one} == {"somebody@here"}
    assert all(one is not None for one in out[6150:])


@pytest.mark.parametrize("begin", [1, 300])
def test_a_device_that_gives_no_number_is_said_so_and_ticks_go_on(begin: int) -> None:
    draw = random.Random(5)
    direction = Direction("commands", lambda now: (now + draw.randint(0, 60),))
    out = []
    for now in range(1, 2000):
        missing = begin <= now < begin + 400 or now % 700 < 30
        direction.say(command_at(now, position=math.nan if missing else 0.01), now)
        out.append(direction.hear(now))
    ticks = [one.sequence for one in out if one is not None]
    assert ticks == sorted(set(ticks))
    assert any(one is not None and math.isnan(one.position) for one in out)
    assert all(one is None or math.isnan(one.position) or abs(one.position - 0.01) < 1e-4 for one in out)


@given(kind=st.sampled_from(("commands", "telemetry")), seed=st.integers(0, 10**6), space=st.booleans())
def test_no_network_makes_ticks_go_back_or_a_message_that_is_none(kind: str, seed: int, space: bool) -> None:
    draw = random.Random(seed)
    loss = draw.choice((0.0, 0.3, 0.8))

    def arrives(now: int) -> list[int]:
        return [now + draw.choice((0, 3, 90, 1500)) for _ in range(draw.choice((1, 1, 2)))] * (draw.random() > loss)

    direction, before = Direction(kind, arrives), 0
    for now in range(1, 2500):
        direction.say(direction.message_at(now, space=space), now)
        out = direction.hear(now)
        if out is not None:
            assert before < out.sequence <= now + REACH
            assert abs(out.time_ns - out.sequence * MS) < MS
            decode(encode(out), type(out))
            before = out.sequence


def test_a_context_is_said_again_every_second_and_where_it_changes() -> None:
    direction, ticks = Direction("commands"), []
    for tick in range(1, 5001):
        direction.saying.note(command_at(tick, run=RUN + tick // 2500))
        if direction.saying.urgency:
            record = direction.saying.record()
            if record[0] == CONTEXT:
                ticks.append(tick)
    assert ticks[:3] == [1, 2, 3]
    assert max(second - first for first, second in itertools.pairwise(ticks)) <= CONTEXT_PERIOD + 1
    assert {2500, 2501, 2502} <= set(ticks)


def test_a_place_in_space_is_heard_as_soon_as_there_is_one() -> None:
    """A leader in space commands no place before its hand is coupled."""
    direction = Direction("commands")
    out = heard_by(direction, range(1, 1000), lambda now: command_at(now, space=now >= 500))
    assert [one.sequence for one in out] == list(range(1, 1000))
    assert all(len(one.place) == (3 if one.sequence >= 500 else 0) for one in out)


def test_an_old_context_replaces_no_newer_one() -> None:
    direction = Direction("commands")
    old = msgspec.msgpack.encode(Context(7, 2, 2 * MS, (0, 0), False, EPOCH, RUN, "somebody@here"))
    heard_by(direction, range(1, 200), command_at)
    direction.hearing.context(old)
    out = heard_by(direction, range(200, 300), command_at)
    assert [one.sequence for one in out] == list(range(200, 300))
