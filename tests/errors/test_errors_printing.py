"""What others wrote is shown and not done."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import RecordingError, RecordingWarning, SettingError, one_line, printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("emergency stop: 5 µm, 10 °C, Größe, 手", "emergency stop: 5 µm, 10 °C, Größe, 手"),
        ("\x1b]0;mine\x07", r"\x1b]0;mine\x07"),
        ("a\r\nfollower: released", r"a\r\nfollower: released"),
        ("\x9b31m\x7f\x00\b\t", r"\x9b31m\x7f\x00\x08\t"),
        ("\u202elave\u202c\u2066x\u2069", r"\u202elave\u202c\u2066x\u2069"),
        ("\u2028\u2029\ud800", r"\u2028\u2029\ud800"),
    ],
)
def test_what_a_terminal_would_do_is_written_out(text: str, shown: str) -> None:
    assert printable(text) == shown


@given(st.text())
def test_what_is_shown_is_printable_and_stays_as_it_is(text: str) -> None:
    shown = printable(text)
    assert shown.isprintable()
    assert printable(shown) == shown
    assert (shown == text) is text.isprintable()
    assert printable(text, lines=True).replace("\n", "").isprintable()


def test_errors_show_the_names_and_values_that_they_are_about() -> None:
    assert str(RecordingError("press\x1b[2J.csv", "has a column \x07")) == r"press\x1b[2J.csv: has a column \x07"
    assert str(SettingError("name", "x", "is \x1b[31mred")) == r"name = 'x': is \x1b[31mred"
    assert str(RecordingWarning("guessed \x1b[5m")) == r"guessed \x1b[5m"


def test_what_an_exception_says_is_one_short_line() -> None:
    class Mute(Exception):
        def __str__(self) -> str:
            raise RuntimeError

    assert one_line(ValueError("a\n  b\x1b[2J")) == r"a b\x1b[2J"
    assert one_line(Mute()) == ""
    assert len(one_line("\x1b" * 10**6)) == len(one_line("x" * 10**6, 300)) == 300
