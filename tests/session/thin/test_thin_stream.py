"""Lines: what is said of numbers that change in every tick is what they were, within the bound."""

from __future__ import annotations

import hashlib
import math
import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from thin_lines import MOTIONS, LinePair, motion

from foretouch.session.thin.lines import stream
from foretouch.session.thin.lines.stream import (
    DUE,
    FORCE,
    KEPT,
    LONGEST_GAP,
    NOTHING,
    PLACE,
    POSITION,
    REACH,
    RUN_ON,
    SOON,
    WORTH,
)

seeds = st.integers(0, 10**6)


@given(kind=st.sampled_from(MOTIONS), seed=seeds, delay=st.integers(0, 300))
def test_without_loss_each_tick_is_within_the_bound_but_for_the_smoothing(kind: str, seed: int, delay: int) -> None:
    path = motion(kind, seed, 1500)
    pair = LinePair(offered=lambda tick: (tick + delay,))
    given_before = 0
    for now in range(1, 1500):
        pair.say(now, (path[now],))
        tick = pair.hear(now)
        assert tick == (now - delay if now > delay else 0)
        if tick:
            wrong = abs(pair.given[0] - path[tick])
            assert wrong <= POSITION.bound + POSITION.step + abs(pair.smoothing[0])
        assert tick >= given_before
        given_before = tick


@given(height=st.floats(1e-3, 0.02), frequency=st.floats(0.1, 3.0), count=st.sampled_from((1e-9, 1e-5, 2e-5)))
def test_the_motion_of_a_hand_is_within_thrice_the_bound_with_the_smoothing(
    height: float, frequency: float, count: float
) -> None:
    """From rest on, as a hand begins."""
    pair = LinePair()
    for now in range(1, 1500):
        place = count * round(height * (1.0 - math.cos(2e-3 * math.pi * frequency * now)) / count)
        pair.say(now, (place,))
        assert pair.hear(now) == now
        assert abs(pair.given[0] - place) < 3.0 * POSITION.bound


@given(height=st.floats(1.2e-3, 0.1), sign=st.sampled_from((-1.0, 1.0)))
def test_a_step_is_there_after_some_ticks(height: float, sign: float) -> None:
    pair = LinePair()
    for now in range(1, 400):
        pair.say(now, (0.0 if now < 200 else sign * height,))
        pair.hear(now)
        since = now - 200
        if since >= 0:
            assert abs(pair.given[0] - sign * height) <= height * KEPT ** (since + 1) + POSITION.bound + POSITION.step
        else:
            assert abs(pair.given[0]) <= POSITION.bound


@given(kind=st.sampled_from(MOTIONS), seed=seeds)
def test_a_packet_comes_at_the_latest_every_longest_gap(kind: str, seed: int) -> None:
    pair = LinePair()
    for now, place in enumerate(motion(kind, seed, 1000), 1):
        pair.say(now, (place,))
    ticks = [tick for tick, _, _ in pair.packets]
    assert ticks[0] == 1
    assert max(np.diff(ticks)) <= LONGEST_GAP
    assert 1000 - ticks[-1] < LONGEST_GAP


def test_what_is_still_says_only_signs_of_life() -> None:
    pair = LinePair()
    urgencies = [pair.say(now, (0.01,)) for now in range(1, 1001)]
    assert set(urgencies[1:]) <= {NOTHING, DUE}
    assert len(pair.packets) <= 1000 // LONGEST_GAP + 2


@given(speed=st.floats(0.0, 1.0), sign=st.sampled_from((-1.0, 1.0)))
def test_a_position_runs_on_no_further_than_it_may_and_no_number_longer_than_its_reach(
    speed: float, sign: float
) -> None:
    """The link breaks while it moves at constant speed [m/s]; at most 5 ticks are gone on in any case."""
    pair = LinePair(offered=lambda tick: (tick,) if tick < 300 else ())
    given_ticks, places, last = [], [], 0
    for now in range(1, 700):
        pair.say(now, (sign * speed * 1e-3 * now,))
        if tick := pair.hear(now):
            given_ticks.append(tick)
            places.append(float(pair.given[0]))
    last = max(tick for tick, _, _ in pair.packets if tick < 300)
    assert given_ticks[-1] - last <= REACH
    gone = abs(places[-1] - sign * speed * 1e-3 * last)
    assert gone <= max(RUN_ON, 5e-3 * speed) + POSITION.bound + REACH * POSITION.slope_step + abs(pair.smoothing[0])
    if speed < 0.04:
        assert given_ticks[-1] - last == REACH


def test_a_fast_hand_speaks_before_its_receiver_must_stop() -> None:
    pair = LinePair()
    urgencies = [pair.say(now, (2e-4 * now,)) for now in range(1, 400)]
    reach = RUN_ON / 2e-4
    ticks = [tick for tick, _, _ in pair.packets[3:]]
    assert max(np.diff(ticks)) <= math.ceil(0.5 * reach)
    assert SOON in urgencies


@given(data=st.data(), kind=st.sampled_from(MOTIONS), seed=seeds, loss=st.floats(0.0, 0.9))
def test_no_network_makes_a_number_that_is_not_finite_or_a_tick_that_goes_back(
    data: st.DataObject, kind: str, seed: int, loss: float
) -> None:
    draw = random.Random(data.draw(seeds))
    held = draw.choice((0, 0, 800, 1200))

    def arrives(tick: int) -> list[int]:
        if draw.random() < loss:
            return []
        times = [tick + draw.choice((0, 5, 80, 400)) for _ in range(draw.choice((1, 1, 2, 3)))]
        return [max(time, held) if time < held else time for time in times]  # a late burst

    numbers = (POSITION, POSITION, PLACE, FORCE)
    pair = LinePair(numbers, 2, offered=arrives)
    paths = [motion(kind, seed + index, 1500) for index in range(4)]
    before = 0
    for now in range(1, 1500):
        pair.say(now, tuple(path[now] for path in paths))
        tick = pair.hear(now)
        assert tick == 0 or before < tick <= now + REACH
        before = tick or before
        if tick:
            assert np.isfinite(pair.given).all()


@given(seed=seeds)
@pytest.mark.long
def test_a_lost_packet_is_repaired_by_the_next_ones(seed: int) -> None:
    """One lost in ten: soon after each loss all numbers are within their bounds again."""
    draw = random.Random(seed)
    pair = LinePair((POSITION,) * 4, 4, offered=lambda tick: () if draw.random() < 0.1 else (tick,))
    paths = [motion("walk", seed + index, 3000) for index in range(4)]
    wrong = []
    for now in range(1, 3000):
        numbers = tuple(path[now] for path in paths)
        pair.say(now, numbers)
        if pair.hear(now) == now:
            wrong.append(max(abs(pair.given - numbers)))
    assert np.median(wrong) < 2.0 * POSITION.bound
    assert np.quantile(wrong, 0.95) < 20.0 * POSITION.bound


def test_what_was_said_in_an_outage_is_not_gone_on_from_after_it() -> None:
    """A hand moves along one axis, stops while nothing arrives, and stands: nobody hears of the old slope again."""
    pair = LinePair((POSITION,) * 4, 4, offered=lambda tick: () if 300 <= tick < 2300 else (tick,))
    for now in range(1, 3000):
        x = 1e-4 * min(now, 400)
        pair.say(now, (0.0, x, 0.0, 0.0))
        tick = pair.hear(now)
        if tick > 2300:
            assert abs(pair.given[1] - x) <= POSITION.bound + POSITION.step
    assert tick == 2999


def test_numbers_that_were_missing_come_back_all_at_once() -> None:
    pair = LinePair((POSITION,) * 4, 4)
    for now in (*range(1, 200), *range(900, 1000)):
        pair.say(now, (1e-4 * now, 0.01, 0.02, 0.03))
        tick = pair.hear(now)
        assert tick == now
        assert np.isfinite(pair.given).all()
    packet = next(packet for packet in pair.packets if packet[0] == 900)
    assert packet[1] == 0b1111


def test_at_most_so_many_numbers_are_said_and_the_others_follow() -> None:
    pair = LinePair((POSITION,) * 8, 8, most=2)
    for now in range(1, 100):
        pair.say(now, tuple(1e-3 * index for index in range(8)))
        pair.hear(now)
    assert max(chosen.bit_count() for _, chosen, _ in pair.packets) == 2
    assert np.allclose(pair.given, 1e-3 * np.arange(8), atol=POSITION.bound)


@pytest.mark.parametrize("rhythm", [0.98, 0.999, 1.0, 1.001, 1.02])
@pytest.mark.parametrize("jitter", [0, 8])
def test_a_sender_of_another_rhythm_is_followed_without_drift(rhythm: float, jitter: int) -> None:
    """The sender makes so many ticks in each of the receiver's; its newest packet is never far from what is given."""
    draw = random.Random(3)
    clock = [0]
    pair = LinePair(offered=lambda tick: (clock[0] + 20 + draw.randint(0, jitter),))
    ahead, sent, missing = [], 0, 0
    for now in range(1, 20_000):
        clock[0] = now
        while sent < int(rhythm * now):
            sent += 1
            pair.say(sent, (0.02 * math.sin(2e-3 * math.pi * sent),))
        tick = pair.hear(now)
        missing += now > 1000 and not tick
        if tick and now > 2000:
            ahead.append(tick - rhythm * (now - 20))
    assert min(ahead) > -15 - jitter
    assert max(ahead) < 15 + jitter
    drift = np.mean(ahead[-3000:]) - np.mean(ahead[:3000])
    assert abs(drift) < 2.0
    assert missing < (1.5 * max(1.0 - rhythm, 0.0) + (0.02 if jitter else 0.001)) * 19_000


def test_urgencies_have_an_order() -> None:
    assert NOTHING < WORTH < SOON < DUE


def digest() -> str:
    """Of all that comes out of some motions over a network that loses packets."""
    result = hashlib.sha256()
    for index, kind in enumerate(MOTIONS):
        draw = random.Random(index)
        pair = LinePair(
            (POSITION, PLACE, FORCE),
            1,
            offered=lambda tick, draw=draw: [tick + draw.randint(0, 9)][: draw.random() < 0.8],
        )
        path = motion(kind, index, 600)
        for now in range(1, 600):
            pair.say(now, (path[now], 2.0 * path[now], 100.0 * path[now]))
            pair.hear(now)
            result.update(pair.heard.tobytes() + pair.said.tobytes())
    return result.hexdigest()


@pytest.mark.long
def test_interpreted_and_compiled_give_the_same_bits() -> None:
    code = "import test_thin_stream; print(test_thin_stream.digest())"
    environment = os.environ | {
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONPATH": os.pathsep.join((str(Path(__file__).parent), *sys.path)),
    }
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == digest()
    assert stream.note.types.startswith("i8")
