"""What goes in pieces comes out whole: lost ones come back from parities, and no piece is taken for another's."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.session.network.erasure import MOST_PARITIES, parity_of, restored
from foretouch.session.network.pieces import (
    LONGEST,
    MOST_PIECES,
    PARITIES,
    PIECE,
    PIECE_HEAD,
    SHORTEST,
    Inbox,
    Outbox,
)
from foretouch.session.thin.ends import PROTECTIONS, USUAL

NAMES = ("urgent", "usual", "seldom")
contents = st.binary(min_size=1, max_size=600)
rooms = st.integers(PIECE_HEAD + SHORTEST, 255)


def outbox_of(room: int, protection: str = USUAL) -> Outbox:
    return Outbox(NAMES, room, PROTECTIONS[protection], 2)


def all_records(outbox: Outbox, room: int) -> list[bytes]:
    records = []
    while record := outbox.next(room):
        assert len(record) <= room
        records.append(record)
    return records


def taken(inbox: Inbox, records: list[bytes]) -> list[tuple[str, bytes]]:
    whole = []
    for record in records:
        end, name, content = inbox.take(record, 0)
        assert end == len(record)
        if content:
            whole.append((name, content))
    return whole


@pytest.mark.parametrize("protection", PROTECTIONS)
@given(content=contents, room=rooms, data=st.data())
def test_as_many_lost_pieces_as_there_are_parities_come_back_in_any_order_and_however_often(
    protection: str, content: bytes, room: int, data: st.DataObject
) -> None:
    outbox, inbox = outbox_of(room, protection), Inbox(NAMES)
    outbox.put("usual", content)
    records = all_records(outbox, room)
    parities = sum(record[0] != PIECE for record in records)
    count = len(records) - parities
    assert parities == {"none": 0, "parity": int(count > 1), "strong": min(count // 2 + 1, MOST_PARITIES)}[protection]
    for _ in range(data.draw(st.integers(0, parities))):
        del records[data.draw(st.integers(0, len(records) - 1))]
    records = data.draw(st.permutations(records + records[:3]))
    assert taken(inbox, records) == [("usual", content)]
    assert taken(inbox, records) == []  # doubled
    assert (inbox.whole["usual"], inbox.broken["usual"], inbox.missed["usual"]) == (1, 0, 0)


@given(things=st.lists(st.tuples(contents, st.sampled_from(list(PROTECTIONS))), max_size=12), data=st.data())
def test_whatever_is_lost_nothing_wrong_comes_of_the_rest(things: list[tuple[bytes, str]], data: st.DataObject) -> None:
    """Of a sender whose protection may be any, and changes."""
    outboxes, inbox, expected = {name: outbox_of(40, name) for name in PROTECTIONS}, Inbox(NAMES), []
    for number, (content, protection) in enumerate(things):
        outbox = outboxes[protection]
        outbox._numbers["usual"] = number
        outbox.put("usual", content)
        records = all_records(outbox, 40)
        came = [record for record in records if data.draw(st.integers(0, 3))]
        pieces = sum(record[0] == PIECE for record in records)
        expected += [("usual", content)] if len(came) >= pieces else []
        assert taken(inbox, came) == expected[len(expected) - (len(came) >= pieces) :]
    assert inbox.whole["usual"] == len(expected)
    assert inbox.broken["usual"] + inbox.missed["usual"] <= len(things) - len(expected)


@given(count=st.integers(1, MOST_PIECES), size=st.integers(1, 20), data=st.data())
def test_any_pieces_come_back_from_any_parities(count: int, size: int, data: st.DataObject) -> None:
    draw = data.draw(st.randoms(use_true_random=False))
    pieces = [draw.randbytes(size) for _ in range(count)]
    rows = range(min(MOST_PARITIES, MOST_PIECES + 1 - count))
    lost = draw.sample(range(count), draw.randint(1, min(count, len(rows))))
    parities = {row: parity_of(pieces, row) for row in draw.sample(rows, len(lost))}
    kept = {place: piece for place, piece in enumerate(pieces) if place not in lost}
    assert restored(kept, parities, count) == pieces
    parities.popitem()
    assert restored(kept, parities, count) == []


def test_the_first_parity_is_the_exclusive_or_of_the_pieces() -> None:
    assert parity_of([b"\x0f\x33", b"\xf0\x11", b"\x01"], 0) == b"\xfe\x22"


@given(things=st.lists(contents, min_size=2, max_size=40), room=rooms, seed=st.integers(0, 10**6))
def test_things_come_in_their_order_though_pieces_do_not(things: list[bytes], room: int, seed: int) -> None:
    """Each piece is late by some, lost or doubled: nothing comes twice, or after a newer one, or changed."""
    draw = random.Random(seed)
    outbox, inbox = outbox_of(room), Inbox(NAMES)
    coming: list[tuple[float, bytes]] = []
    for number, content in enumerate(things):
        outbox.put("usual", number.to_bytes(2) + content)
        for record in all_records(outbox, room):
            for _ in range(draw.choice((0, 1, 1, 1, 2))):
                coming.append((len(coming) + draw.uniform(0.0, draw.choice((0.1, 20.0))), record))
    whole = taken(inbox, [record for _, record in sorted(coming)])
    numbers = [int.from_bytes(content[:2]) for _, content in whole]
    assert numbers == sorted(set(numbers))
    assert all(content[2:] == things[number] for number, (_, content) in zip(numbers, whole, strict=True))


def test_numbers_come_round() -> None:
    outbox, inbox = outbox_of(40), Inbox(NAMES)
    for number in range(1000):
        content = number.to_bytes(2) * 40
        outbox.put("seldom", content)
        assert taken(inbox, all_records(outbox, 40)) == [("seldom", content)]


def test_the_newest_of_a_name_wins_and_what_has_begun_is_sent() -> None:
    outbox, inbox = outbox_of(40), Inbox(NAMES)
    outbox.put("usual", b"a" * 100)
    begun = [outbox.next(40)]
    outbox.put("usual", b"b" * 100)
    outbox.put("usual", b"c" * 100)
    assert taken(inbox, begun + all_records(outbox, 40)) == [("usual", b"a" * 100), ("usual", b"c" * 100)]
    assert outbox.is_empty


def test_what_is_more_urgent_goes_first() -> None:
    outbox = outbox_of(40)
    outbox.put("seldom", b"a" * 100)
    outbox.put("usual", b"b" * 100)
    first = outbox.next(40)
    outbox.put("urgent", b"c" * 10)
    order = [first, *all_records(outbox, 40)]
    places = [record[1] for record in order]
    assert places == [1, 0, 1, 1, 1, *[2] * 4]


def test_a_short_room_makes_no_crumbs_and_blocks_nothing() -> None:
    outbox, inbox = outbox_of(40), Inbox(NAMES)
    outbox.put("usual", bytes(300))
    assert outbox.next(7) == b""
    records = all_records(outbox, 40)
    assert len(records) <= -(-300 // SHORTEST) + 1
    assert taken(inbox, records) == [("usual", bytes(300))]


@given(size=st.integers(1, 70_000), room=st.integers(PIECE_HEAD + 1, 400))
def test_what_is_too_long_is_left_out_and_the_rest_goes_on(size: int, room: int) -> None:
    outbox, inbox = outbox_of(room), Inbox(NAMES)
    outbox.put("urgent", bytes(size))
    outbox.put("seldom", b"short")
    whole = taken(inbox, all_records(outbox, room))
    fits = size <= MOST_PIECES * min(room - PIECE_HEAD, LONGEST)
    assert [name for name, _ in whole] == (["urgent"] if fits else []) + ["seldom"]


def test_another_sender_counts_anew() -> None:
    inbox = Inbox(NAMES)
    first, second = outbox_of(40), outbox_of(40)
    first.put("usual", b"first")
    second.put("usual", b"second")
    assert taken(inbox, all_records(first, 40)) == [("usual", b"first")]
    inbox.restart()
    assert taken(inbox, all_records(second, 40)) == [("usual", b"second")]


def test_what_lacks_two_pieces_is_counted_when_the_next_begins() -> None:
    outbox, inbox = outbox_of(40), Inbox(NAMES)
    for content in (b"a" * 100, b"b" * 100):
        outbox.put("usual", content)
        records = all_records(outbox, 40)
        taken(inbox, records[2:] if content[:1] == b"a" else records)
    assert inbox.broken == {"urgent": 0, "usual": 1, "seldom": 0}


@given(st.lists(st.binary(max_size=60), max_size=60), st.integers(0, 10**6))
def test_hostile_pieces_raise_nothing_and_fill_nothing(pieces: list[bytes], seed: int) -> None:
    draw, inbox = random.Random(seed), Inbox(NAMES)
    for piece in pieces:
        head = bytes(
            (draw.choice((PIECE, *PARITIES)), draw.randint(0, 4), *(draw.choice((0, 1, 2, 3, 255)) for _ in range(4)))
        )
        end, _, _ = inbox.take(head + piece, 0)
        assert end == -1 or PIECE_HEAD <= end <= len(head) + len(piece)
    kept = [[*begun.pieces.values(), *begun.parities.values()] for begun in inbox._begun.values()]
    assert len(kept) <= len(NAMES)
    assert sum(len(one) for known in kept for one in known) <= len(NAMES) * (MOST_PIECES + MOST_PARITIES) * 255


def test_what_is_not_urgent_takes_turns() -> None:
    """A name that always has something to say lets another speak in between."""
    outbox, said = Outbox(NAMES, 40, PROTECTIONS["none"], 1), []
    for _ in range(12):
        for name in NAMES[1:]:
            outbox.put(name, bytes(100))
        said.append(NAMES[outbox.next(40)[1]])
    assert said == 2 * (["usual"] * 3 + ["seldom"] * 3)


def test_empty_pieces_are_none() -> None:
    """They would never be whole, and each further one would be reckoned anew."""
    inbox = Inbox(NAMES)
    assert inbox.take(bytes((PIECE, 0, 1, 0, 255, 0)), 0)[0] < 0
    assert inbox.take(bytes((PARITIES[0], 0, 1, 5, 3, 0)), 0)[0] < 0
