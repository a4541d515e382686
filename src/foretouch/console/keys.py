"""What the keyboard does, wherever the focus is but in a field for text or numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

__all__ = ["HELP", "STEP", "add_keys"]

STEP = 0.0005
"""How far one stroke moves the hand [m]."""

HELP = (
    "Keys: <b>Space</b> or <b>Esc</b> emergency stop · <b>D</b> deeper, <b>U</b> up · <b>C</b> clutch · "
    "<b>R</b> record · <b>P</b> play, pause · <b>Tab</b>, <b>Enter</b> reach everything."
)
"""Letters and no arrows: those belong to sliders, tabs and lists."""


def add_keys(
    gui: Any,
    *,
    on_step: Callable[[float], None],
    on_clutch: Callable[[int | None], None],
    on_record: Callable[[], None],
    on_play: Callable[[], None],
) -> None:
    """Register the keys with the viewer; its list of commands (Ctrl-K) names them too.

    Args:
        gui: The viewer's user interface.
        on_step: Called with how far the hand is to go in [m].
        on_clutch: Called with the browser's number.
        on_record: Called when a recording is to begin or to end.
        on_play: Called when a recording that is looked at is to go on or to pause.
    """

    async def deeper(event: Any) -> None:
        on_step(STEP)

    async def up(event: Any) -> None:
        on_step(-STEP)

    async def clutch(event: Any) -> None:
        on_clutch(event.client_id)

    async def record(event: Any) -> None:
        on_record()

    async def play(event: Any) -> None:
        on_play()

    for label, key, action in (
        ("Hand deeper", "D", deeper),
        ("Hand up", "U", up),
        ("Clutch", "C", clutch),
        ("Start or stop recording", "R", record),
        ("Play or pause the recording", "P", play),
    ):
        gui.add_command(label, hotkey=key).on_trigger(action)
