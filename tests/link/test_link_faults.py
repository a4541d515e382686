"""Seeded faults: exact without randomness, as asked on average with it, the same on repeat."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from itertools import groupby, pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.link import Faults, FaultStage, SequenceCounter
from foretouch.link.sequence import REMEMBERED

MS = 1_000_000


def run(faults: Faults, messages: int = 5000, at_ms: int = -1, **changes: float) -> list[tuple[int, int]]:
    """Send one message a millisecond, from one on with other faults; (arrival tick, message) in order of arrival."""
    stage: FaultStage[int] = FaultStage(faults)
    arrived = []
    for tick in range(messages + 2000):
        if tick == at_ms:
            stage.change(**{"delay": 0.0, "jitter": 0.0, "loss": 0.0, "outage": 0.0, **changes})
        if tick < messages:
            stage.push(tick * MS, tick)
        arrived += [(tick, message) for message in stage.pop_due(tick * MS)]
    return arrived


@given(st.integers(0, 500))
def test_a_delay_is_exact(delay_ms: int) -> None:
    assert run(Faults(delay=delay_ms * 1e-3), 20) == [(n + delay_ms, n) for n in range(20)]


def test_jitter_spreads_within_its_bounds_and_reorders() -> None:
    arrived = run(Faults(delay=0.08, jitter=0.01, seed=1))
    late = np.array([tick - message for tick, message in arrived])
    assert len(arrived) == 5000
    assert late.min() >= 70
    assert late.max() <= 91
    assert abs(late.mean() - 80.5) < 0.5  # arrivals wait for the next tick
    order = [message for _, message in arrived]
    assert order != sorted(order)


def test_loss_takes_its_share() -> None:
    assert 0.045 < 1 - len(run(Faults(loss=0.05, seed=2))) / 5000 < 0.055
    assert run(Faults(loss=1.0), 100) == []


def test_an_outage_takes_its_length_out_of_every_ten_seconds() -> None:
    messages = {message for _, message in run(Faults(outage=0.5, seed=3), 30_000)}
    for window in range(3):
        lost = sorted(set(range(window * 10_000, (window + 1) * 10_000)) - messages)
        assert abs(len(lost) - 500) <= 1
        assert lost[-1] - lost[0] == len(lost) - 1


def test_one_fault_does_not_shift_the_draws_of_another() -> None:
    with_loss = {message: tick for tick, message in run(Faults(delay=0.05, jitter=0.02, loss=0.2, seed=4))}
    without = {message: tick for tick, message in run(Faults(delay=0.05, jitter=0.02, seed=4))}
    assert all(without[message] == tick for message, tick in with_loss.items())


@given(st.lists(st.tuples(st.integers(0, 40), st.booleans()), max_size=120), st.integers(0, 9))
def test_what_is_due_comes_by_its_time_and_then_by_its_turn(sent: list[tuple[int, bool]], seed: int) -> None:
    stage: FaultStage[int] = FaultStage(Faults(seed=seed))
    waiting: list[tuple[int, int]] = []
    for tick, (delay_ms, asked) in enumerate(sent):
        stage.delay = delay_ms * 1e-3
        stage.push(tick * MS, tick)
        waiting.append(((tick + delay_ms) * MS, tick))
        if asked:
            due = sorted(one for one in waiting if one[0] <= tick * MS)
            waiting = [one for one in waiting if one[0] > tick * MS]
            assert stage.pop_due(tick * MS) == [number for _, number in due]
    assert stage.pop_due(1000 * MS) == [number for _, number in sorted(waiting)]


def test_faults_that_are_changed_on_the_way_are_those_from_then_on() -> None:
    """What is drawn for a message depends on the seed and its number alone, whenever the faults came to be these."""
    faults = {"delay": 0.05, "jitter": 0.02, "loss": 0.2}
    whole = {message: tick for tick, message in run(Faults(**faults, seed=4), 4000)}
    late = {message: tick for tick, message in run(Faults(seed=4), 4000, 1000, **faults)}
    assert all(late[message] == message for message in range(1000))
    assert {n: tick for n, tick in late.items() if n > 1000} == {n: tick for n, tick in whole.items() if n > 1000}
    ended = {message: tick for tick, message in run(Faults(**faults, seed=4), 4000, 1000)}
    assert all(ended[message] == message for message in range(1000, 4000))
    assert {n for n in ended if n < 1000} == {n for n in whole if n < 1000}
    assert run(Faults(seed=4), 4000, 1000, **faults) == run(Faults(seed=4), 4000, 1000, **faults)


def test_an_outage_that_is_asked_for_on_the_way_is_that_of_the_whole_session() -> None:
    whole = {message for _, message in run(Faults(outage=2.0, seed=3), 30_000)}
    late = {message for _, message in run(Faults(seed=3), 30_000, 10_000, outage=2.0)}
    assert late == set(range(10_000)) | {message for message in whole if message >= 10_000}


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=4, max_size=4), st.floats(1.0, 100.0))
def test_no_change_of_faults_raises(values: list[float], burst: float) -> None:
    stage: FaultStage[int] = FaultStage(Faults(burst=burst))
    stage.change(**dict(zip(("delay", "jitter", "loss", "outage"), values, strict=True)))
    for n in range(50):
        stage.push(n * MS, n)
    assert stage.dropped + len(stage.pop_due(100_000 * MS)) == 50
    assert 0.0 <= stage.faults.loss <= stage.faults.most_loss


def test_loss_jitter_and_outages_are_drawn_as_they_were_before_there_were_other_faults() -> None:
    """Recorded and published sessions repeat bit by bit; the digest was taken before bursts were possible."""
    arrived = [
        (tick, message)
        for tick, message in run(Faults(delay=0.05, jitter=0.02, loss=0.1, outage=0.2, seed=7), 20_000)
        if tick < 20_000
    ]
    digest = hashlib.sha256(repr(arrived).encode()).hexdigest()
    assert digest == "ee83582eb65df55ddad6eeff76f1a912fc8c5232b8ee384fec9b1cd6cd45a781"


def lost_of(faults: Faults, messages: int) -> np.ndarray:
    """Whether each message is lost, of a link without delay."""
    stage: FaultStage[int] = FaultStage(faults)
    for n in range(messages):
        stage.push(n, n)
    arrived = stage.pop_due(messages)
    assert stage.dropped == messages - len(arrived)
    lost = np.ones(messages, dtype=bool)
    lost[arrived] = False
    return lost


@pytest.mark.parametrize(
    ("loss", "burst"), [(0.01, 3.0), (0.05, 10.0), (0.3, 20.0), (0.3, 1.2), (0.6, 1.5), (0.7, 4.0)]
)
def test_bursts_have_the_share_and_the_mean_length_asked_for(loss: float, burst: float) -> None:
    messages = 100_000
    lost = lost_of(Faults(loss=loss, burst=burst, seed=5), messages)
    lengths = np.array([sum(1 for _ in run) for is_lost, run in groupby(lost) if is_lost])
    # Standard errors of the two-state chain: memory 1 - p - r, and burst lengths that are geometric.
    memory = 1 - loss / (1 - loss) / burst - 1 / burst
    error_of_share = math.sqrt(loss * (1 - loss) * (1 + memory) / (1 - memory) / messages)
    error_of_length = math.sqrt(burst * (burst - 1) / len(lengths))
    assert abs(lost.mean() - loss) < 4 * error_of_share
    assert abs(lengths.mean() - burst) < 4 * error_of_length
    assert abs(np.mean(lengths == 1) - 1 / burst) < 4 * math.sqrt((1 - 1 / burst) / burst / len(lengths))


def test_bursts_as_long_as_those_of_independent_loss_are_independent_loss() -> None:
    independent = lost_of(Faults(loss=0.3, seed=6), 20_000)
    chain = lost_of(Faults(loss=0.3, burst=1 / (1 - 0.3), seed=6), 20_000)
    assert (independent == chain).all()


def test_the_first_message_is_lost_as_often_as_any_other() -> None:
    lost = [lost_of(Faults(loss=0.3, burst=50.0, seed=seed), 1)[0] for seed in range(4000)]
    assert abs(np.mean(lost) - 0.3) < 4 * math.sqrt(0.3 * 0.7 / 4000)


def test_the_share_asked_for_is_reordered_and_overtaken() -> None:
    delay, fraction, messages = 0.02, 0.1, 20_000
    arrived = run(Faults(delay=delay, reorder=fraction, seed=9), messages)
    late = {message: tick - message - 20 for tick, message in arrived}
    held = np.array([ms for ms in late.values() if ms])
    assert len(arrived) == messages
    assert abs(len(held) / messages - fraction) < 4 * math.sqrt(fraction * (1 - fraction) / messages)
    # Between 5 and 50 ms; arrivals wait for the next tick of 1 ms.
    assert held.min() >= 5
    assert held.max() <= 50
    assert abs(held.mean() - 28.0) < 4 * 45 / math.sqrt(12 * len(held))
    index = {message: index for index, (_, message) in enumerate(arrived)}
    overtaken = [n for n in range(messages - 60) if any(index[later] < index[n] for later in range(n + 1, n + 50))]
    assert set(overtaken) == {n for n in range(messages - 60) if late[n]}


def test_the_share_asked_for_comes_twice_and_the_copy_later() -> None:
    fraction, messages = 0.2, 20_000
    arrived = run(Faults(delay=0.01, duplicate=fraction, seed=10), messages)
    times: dict[int, list[int]] = {}
    for tick, message in arrived:
        times.setdefault(message, []).append(tick)
    assert set(times) == set(range(messages))
    assert all(ticks[0] == message + 10 for message, ticks in times.items())
    gaps = np.array([ticks[1] - ticks[0] for ticks in times.values() if len(ticks) == 2])
    assert {len(ticks) for ticks in times.values()} == {1, 2}
    assert abs(len(gaps) / messages - fraction) < 4 * math.sqrt(fraction * (1 - fraction) / messages)
    assert gaps.min() >= 1
    assert gaps.max() <= 20
    assert abs(gaps.mean() - 11.0) < 4 * 19 / math.sqrt(12 * len(gaps))


@pytest.mark.parametrize(("delay", "jitter"), [(0.0, 0.0), (0.1, 0.0), (2.5, 0.0), (0.1, 0.05)])
def test_a_stall_holds_what_would_arrive_in_it_and_releases_it_together_in_order(delay: float, jitter: float) -> None:
    length_ms, messages = 400, 30_000
    stalled = Faults(delay=delay, jitter=jitter, stall=0.4, seed=11)
    due = {
        message: tick for tick, message in run(Faults(delay=delay, jitter=jitter, seed=11), messages) if tick < 30_000
    }
    arrived = [(tick, message) for tick, message in run(stalled, messages) if tick < 30_000]
    moved = [(tick, message) for tick, message in arrived if tick != due[message]]
    ends = sorted({tick for tick, _ in moved})
    assert len(ends) == 3
    assert [(end - length_ms) // 10_000 for end in ends] == [0, 1, 2]
    for end in ends:
        together = [message for tick, message in arrived if tick == end]
        held = [message for message in together if due[message] != end]
        assert held == sorted(held)
        # A stall begins within a tick: of what is due in that one, a part still comes.
        inside = {message for message, tick in due.items() if end - length_ms < tick < end}
        assert inside <= set(held) <= inside | {m for m, tick in due.items() if tick == end - length_ms}
        assert len(held) >= length_ms - 2 * round(jitter * 1000)
        assert not any(end - length_ms < tick < end for tick, _ in arrived)


def test_stalls_do_not_follow_the_delay_nor_the_outages() -> None:
    def silences(**asked: Any) -> list[int]:
        ticks = sorted({tick for tick, _ in run(Faults(**asked, seed=12), 40_000) if tick < 40_000})
        return [before for before, after in pairwise(ticks) if after - before == 301]  # Neither end is on a tick.

    plain = silences(stall=0.3)
    assert [tick // 10_000 for tick in plain] == [0, 1, 2, 3]
    assert silences(delay=0.5, stall=0.3) == plain
    assert silences(outage=0.2, stall=0.3) == plain
    assert not set(silences(outage=0.3)) & set(plain)


fractions = st.floats(0.0, 0.4)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(
    delay=st.floats(0.0, 0.5),
    jitter=st.floats(0.0, 0.1),
    loss=fractions,
    burst=st.floats(1.0, 30.0),
    outage=st.floats(0.0, 2.0),
    reorder=fractions,
    duplicate=fractions,
    stall=st.floats(0.0, 2.0),
    seed=st.integers(0, 10_000),
)
def test_every_message_comes_as_often_as_it_should(**asked: Any) -> None:
    faults = Faults(**asked)
    messages = 1500
    stage: FaultStage[int] = FaultStage(faults)
    arrived: list[tuple[int, int]] = []
    for tick in range(messages + 13_000):
        if tick < messages:
            stage.push(tick * MS, tick)
        arrived += [(tick, message) for message in stage.pop_due(tick * MS)]
    times = Counter(message for _, message in arrived)
    assert set(times.values()) <= {1, 2}
    assert len(times) == messages - stage.dropped
    assert sum(times.values()) == messages - stage.dropped + stage.duplicated
    least = math.floor(max(0.0, faults.delay - faults.jitter) * 1000)
    most = math.ceil((faults.delay + faults.jitter + faults.stall + 0.05 + 0.02) * 1000) + 1
    assert all(least <= tick - message <= most for tick, message in arrived)


def test_new_faults_do_not_shift_the_draws_of_the_others() -> None:
    def first(**asked: Any) -> dict[int, int]:
        times: dict[int, int] = {}
        for tick, message in run(Faults(delay=0.1, jitter=0.02, loss=0.1, outage=0.2, seed=13, **asked)):
            times.setdefault(message, tick)
        return times

    plain, held = first(), first(reorder=0.2)
    assert first(duplicate=0.3) == plain
    assert set(held) == set(plain)
    assert first(reorder=0.2, duplicate=0.3) == held
    later = {message for message, tick in held.items() if tick > plain[message]}
    assert all(held[message] == plain[message] for message in plain if message not in later)
    assert later <= {message for message, tick in first(reorder=0.3).items() if tick > plain[message]}


@given(st.floats(1.0, 10_000.0, exclude_min=True))
@settings(derandomize=True, deadline=None, max_examples=50)
def test_more_loss_than_bursts_can_make_is_refused_with_the_most_that_works(burst: float) -> None:
    with pytest.raises(SettingError, match=r"burst / \(1 \+ burst\).*take at most") as raised:
        Faults(loss=min(1.0, burst / (1 + burst) + 1e-6), burst=burst)
    most = float(str(raised.value).split("take at most ")[1].split(",")[0])
    stay = Faults(loss=most, burst=burst).loss_transitions
    assert all(0.0 <= probability <= 1.0 for probability in stay)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("delay", -0.1),
        ("delay", 11.0),
        ("jitter", -1.0),
        ("loss", 1.5),
        ("outage", 20.0),
        ("burst", 0.5),
        ("burst", math.inf),
        ("burst", math.nan),
        ("reorder", -0.1),
        ("duplicate", 1.1),
        ("stall", 10.1),
        ("stall", math.nan),
    ],
)
def test_bad_faults_are_refused(name: str, value: float) -> None:
    settings: dict[str, Any] = {name: value}
    with pytest.raises(SettingError, match=f"{name} = {value}: .*must lie between"):
        Faults(**settings)


@pytest.mark.parametrize(
    "asked",
    [
        {"delay": 0.05, "jitter": 0.02, "loss": 0.1, "outage": 0.2},
        {"loss": 0.2, "burst": 6.0},
        {"reorder": 0.1},
        {"duplicate": 0.1},
        {"stall": 0.3},
    ],
    ids=str,
)
def test_the_seed_decides_everything(asked: dict[str, Any]) -> None:
    assert run(Faults(**asked, seed=14)) == run(Faults(**asked, seed=14)) != run(Faults(**asked, seed=15))


# --- counting by sequence number, against a set that forgets nothing --------------------------------------------------


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.lists(st.integers(1, 60), min_size=1, max_size=80), st.integers(0, 3 * REMEMBERED))
def test_every_arrival_is_newest_late_or_a_copy(offsets: list[int], start: int) -> None:
    counter, seen, newest, late, copies = SequenceCounter(), set[int](), 0, 0, 0
    for sequence in (start + offset for offset in offsets):
        is_newest = sequence > newest
        assert counter.is_newest(sequence) is is_newest
        copies += sequence in seen
        late += sequence not in seen and not is_newest
        seen.add(sequence)
        newest = max(newest, sequence)
        lost = newest - min(seen) + 1 - len(seen)
        assert (counter.newest, counter.first, counter.received) == (newest, min(seen), len(seen))
        assert (counter.late, counter.copies, counter.lost) == (late, copies, lost)


def test_copies_hide_no_loss() -> None:
    faults = Faults(delay=0.05, jitter=0.01, loss=0.05, duplicate=0.3, reorder=0.1, seed=7)
    stage: FaultStage[int] = FaultStage(faults)
    counter, sent, arrivals = SequenceCounter(), 20_000, 0
    for tick in range(sent + 500):
        if tick < sent:
            stage.push(tick * 1_000_000, tick + 1)
        for sequence in stage.pop_due(tick * 1_000_000):
            counter.is_newest(sequence)
            arrivals += 1
    unheard = counter.first - 1 + sent - counter.newest  # at the very start and end, where nobody can know
    assert counter.lost == stage.dropped - unheard
    assert 0.04 * sent < counter.lost < 0.06 * sent
    assert counter.received == sent - stage.dropped
    assert counter.copies == stage.duplicated == arrivals - counter.received


def test_what_is_too_old_to_tell_is_a_copy_and_the_largest_number_costs_no_more() -> None:
    counter = SequenceCounter()
    for sequence in (1, REMEMBERED + 5, 2, 5, 6):
        counter.is_newest(sequence)
    assert (counter.copies, counter.late, counter.received) == (2, 1, 3)
    assert counter.lost == REMEMBERED + 5 - 3
    counter = SequenceCounter()
    # A counter that walked over what is missing would never return.
    assert [counter.is_newest(n) for n in (1, 2**63 - 1, 2, 2**63 - 2)] == [True, True, False, False]
    assert counter.lost == 2**63 - 1 - 3


def test_a_sender_that_begins_again_is_counted_on() -> None:
    counter = SequenceCounter()
    for number in (1, 2, 4, 4, 3, 7):
        counter.is_newest(number)
    assert (counter.lost, counter.received, counter.copies, counter.late) == (2, 5, 1, 1)
    counter.restart()
    assert counter.newest == 0
    assert counter.is_newest(3)  # what it sent before there was a listener is not lost
    assert counter.is_newest(5)
    assert not counter.is_newest(5)
    assert (counter.lost, counter.received, counter.copies, counter.newest) == (3, 7, 2, 5)
