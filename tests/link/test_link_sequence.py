"""Counting by sequence number, against a set that forgets nothing."""

from __future__ import annotations

import time

from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.link import Faults, FaultStage, SequenceCounter
from foretouch.link.sequence import REMEMBERED


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


def test_what_is_too_old_to_tell_is_a_copy() -> None:
    counter = SequenceCounter()
    for sequence in (1, REMEMBERED + 5, 2, 5, 6):
        counter.is_newest(sequence)
    assert (counter.copies, counter.late, counter.received) == (2, 1, 3)
    assert counter.lost == REMEMBERED + 5 - 3


def test_the_largest_number_that_a_message_can_carry_costs_no_more() -> None:
    counter = SequenceCounter()
    begin = time.perf_counter()
    assert [counter.is_newest(n) for n in (1, 2**63 - 1, 2, 2**63 - 2)] == [True, True, False, False]
    assert time.perf_counter() - begin < 0.01
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
