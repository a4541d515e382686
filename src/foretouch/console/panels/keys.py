"""What letters do, wherever the focus is but in a field for text or numbers. The page has the emergency stop's keys."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

STEP = 0.0005
"""How far one stroke moves the hand [m]."""

HELP = (
    "Keys: <b>Space</b> or <b>Esc</b> emergency stop · <b>D</b> deeper, <b>U</b> up · <b>C</b> clutch · "
    "<b>R</b> record · <b>P</b> play, pause · <b>Tab</b>, <b>Enter</b> reach everything."
)
"""Letters and no arrows: those belong to sliders, tabs and lists."""

SPACE_HELP = "<b>J</b>, <b>L</b> left, right · <b>I</b>, <b>K</b> away, nearer · <b>O</b> probe over image · "
"""In a session in three dimensions."""


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


def add_space_keys(
    gui: Any, on_stroke: Callable[[tuple[float, float, float]], None], on_overlay: Callable[[], None]
) -> None:
    """Register the keys that a session in three dimensions has beside the others.

    Args:
        gui: The viewer's user interface.
        on_stroke: Called with the way that the hand is to go [m].
        on_overlay: Called when the virtual probe is to be drawn over the image, or no more.
    """
    for label, key, way in (
        ("Hand to the left", "J", (-STEP, 0.0, 0.0)),
        ("Hand to the right", "L", (STEP, 0.0, 0.0)),
        ("Hand away", "I", (0.0, STEP, 0.0)),
        ("Hand nearer", "K", (0.0, -STEP, 0.0)),
    ):
        gui.add_command(label, hotkey=key).on_trigger(_stroke(on_stroke, way))

    async def overlay(event: Any) -> None:
        on_overlay()

    gui.add_command("Probe over image", hotkey="O").on_trigger(overlay)


def _stroke(
    on_stroke: Callable[[tuple[float, float, float]], None], way: tuple[float, float, float]
) -> Callable[[Any], Any]:
    async def stroke(event: Any) -> None:
        on_stroke(way)

    return stroke
