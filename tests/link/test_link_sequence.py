"""Who watches both sides hears each thing of the robot's side once, though the leader tells it again."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.link import Repeats
from foretouch.messages import PROCESS, VERSION, CameraImage, Command, FieldUpdate, Hello, Message, ModelUpdate

MODEL = ModelUpdate(VERSION, 1, 0, 0, "a-law", (), (), 0.0, True, "", "some", b"", 7, 3)
FIELD = FieldUpdate(VERSION, 1, 0, bytes(4), 3)
IMAGE = CameraImage(VERSION, 1, 0, 1, b"", (), (), 0, "", (0.5,) * 15, 3)
HELLO = Hello.of("follower", 1, 0, {PROCESS: "1764400000000000003"})


def numbered(message: Message, number: int) -> Message:
    changes: dict[str, Any] = {"tick" if isinstance(message, CameraImage) else "sequence": number}
    return msgspec.structs.replace(message, **changes)


@pytest.mark.parametrize("message", [MODEL, FIELD, IMAGE, HELLO])
@given(numbers=st.lists(st.integers(1, 20), max_size=40))
def test_what_is_not_newer_was_told_before(message: Message, numbers: list[int]) -> None:
    repeats, newest = Repeats(), 0
    for number in numbers:
        assert repeats.knows(numbered(message, number)) == (number <= newest)
        newest = max(newest, number)


@pytest.mark.parametrize("message", [MODEL, FIELD, IMAGE])
def test_a_process_that_was_started_later_counts_anew(message: Message) -> None:
    repeats, later = Repeats(), {"run": 12}
    assert not repeats.knows(numbered(message, 9))
    assert not repeats.knows(numbered(msgspec.structs.replace(message, **later), 1))
    assert repeats.knows(numbered(message, 10))


def test_what_is_of_no_robot_is_never_known() -> None:
    repeats, leader = Repeats(), Hello.of("leader", 1, 0, {})
    for message in (Command(VERSION, 1, 0, 0.0, 0), leader):
        assert not repeats.knows(message)
        assert not repeats.knows(message)
