"""Corner of the picture that is always shown: the emergency stop, and what is urgent.

A stop is requested again and again, until the robot confirms that it has stopped. The page has the stop's keys; what
letters do, wherever the focus is but in a field for text or numbers, stands here.
"""

from __future__ import annotations

import html
import math
import re
import threading
from collections.abc import Callable
from typing import Any

from foretouch.console.gate.page import BEAT_PERIOD, STOP_BUTTON, WITH_KEYBOARD, beat_html
from foretouch.console.plots import handler, put
from foretouch.quantities.colours import BLUE, GREY, INK, VERMILLION, css
from foretouch.quantities.pose import Vector

READY, ASKING, LATCHED = "EMERGENCY STOP", "Stopping the robot …", "Emergency stop is latched"
"""Text of the button: before it is pressed, until the robot has stopped, and until it is released there."""
UNABLE = "No stop from here: a shadow"
"""Text of the button where the robot cannot be stopped from here because another controller moves it."""
COLOURS = {READY: VERMILLION, UNABLE: GREY}
"""Colour of the button by its text; else it is black."""
ALERTS = ".foretouch-alerts"  # Style-sheet selector of the sentences; empty while nothing is urgent

_PLACE = "position:fixed;left:12px;z-index:100;"
_STYLE = (
    '<div class="foretouch-alarm"><style>'
    f"{STOP_BUTTON}{{{_PLACE}bottom:12px;width:360px;height:64px !important;padding:0;font-size:20px;"
    "border:3px solid #fff;border-radius:10px;box-shadow:0 0 0 3px #000}"
    f"{STOP_BUTTON} .mantine-Button-label{{font-weight:700 !important;overflow:visible}}"
    f"{STOP_BUTTON}:focus-visible{{outline:4px solid {css(BLUE)};outline-offset:5px}}"
    "[data-dock-region-collapse],[data-dock-minimize]{display:none !important}"
    f".foretouch-alerts{{{_PLACE}bottom:92px;width:max(366px, min(560px, calc(100vw - 492px)))}}"
    "@media (max-width:36em){.foretouch-alerts{bottom:auto;top:8px;width:calc(100vw - 24px)}"  # not over numbers
    f"{STOP_BUTTON}{{width:calc(100vw - 24px)}}}}"
    "</style></div>"
)
"""The style of the button that comes next: it stays in its corner of the window while the panel scrolls, and
the panel, which would take it away, cannot be folded up."""
_KEY = (
    f"<style>@media {WITH_KEYBOARD}{{{STOP_BUTTON} .mantine-Button-label::after"
    "{content:'(Space)';margin-left:0.4em}}</style>"
)
"""Names the key on the button that it presses, where there are keys."""


class Alarm:
    """The emergency stop button and, above it, sentences that have to be known at once.

    It is the first that the keyboard reaches, and never disabled.
    """

    def __init__(self, gui: Any, on_press: Callable[[], None], *, offered: bool = True) -> None:
        self._offered = offered
        gui.add_html(_STYLE)
        self._button = gui.add_button(READY, color=VERMILLION, visible=offered)
        self._box = gui.add_html("")
        self._key = gui.add_html(_KEY, visible=offered)
        self._beats, self._next_beat = 0, 0.0
        self._beat = gui.add_html(beat_html(0))
        pressed = handler(lambda event: on_press())
        self._button.on_click(pressed)
        if offered:
            gui.add_command("Emergency stop", description="The robot unloads and stays so").on_trigger(pressed)

    def show(self, label: str, alerts: tuple[str, ...]) -> None:
        """Show how far the emergency stop is (`READY`, `ASKING`, `LATCHED` or `UNABLE`), and what is urgent."""
        put(self._button, label=label, color=COLOURS.get(label, INK))
        put(self._key, visible=self._offered and label == READY)
        put(self._box, content=_box_html(alerts))

    def beat(self, now: float, frames: float) -> None:
        """Show the page that the console draws; without that the page states that it cannot stop the robot."""
        if now >= self._next_beat:
            self._next_beat = now + BEAT_PERIOD
            self._beats += 1
            self._beat.content = beat_html(self._beats, frames)

    def end(self, text: str) -> None:
        """Show on the page that the session has ended, and that there is nothing to stop any more."""
        self._next_beat = math.inf
        self._beat.content = beat_html(self._beats + 1, ended=text)


def _box_html(alerts: tuple[str, ...]) -> str:
    """A box that the mouse goes through, but for a command, which a click selects; as wide as fits beside the panel."""
    if not alerts:
        return ""
    command = '<code style="pointer-events:auto;user-select:all;cursor:copy" title="Click, then copy">\\g<0></code>'
    texts = (re.sub(r"foretouch release \d+", command, html.escape(alert)) for alert in alerts)
    lines = "".join(f'<div style="padding:2px 0">&#9888; {text}</div>' for text in texts)
    return (
        f'<div role="alert" class="{ALERTS[1:]}" style="'
        f"box-sizing:border-box;pointer-events:none;overflow-wrap:anywhere;background:#fff;color:{css(INK)};"
        f'border:3px solid {css(VERMILLION)};border-radius:8px;padding:6px 10px;font-weight:600">{lines}</div>'
    )


ASKING_PERIOD = 0.05  # Between two askings [s]
LEAST_ASKED = 4  # Least number of requests: a confirmation may have been under way since an earlier stop


class EmergencyCall:
    """Requests on a separate thread: neither a slow picture nor a browser that is gone holds them up."""

    def __init__(self, ask: Callable[[], None]) -> None:
        self._ask = ask
        self._asked = 0
        self._wanted = threading.Event()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emergency stop", daemon=True)
        self._thread.start()

    @property
    def asking(self) -> bool:
        """Whether there is no answer yet."""
        return self._wanted.is_set()

    def press(self) -> None:
        """Ask from now on."""
        self._asked = 0
        self._wanted.set()

    def answered(self) -> None:
        """End the requests: the robot has confirmed the stop, or cannot be stopped from here."""
        if self._asked >= LEAST_ASKED:
            self._wanted.clear()

    def close(self) -> None:
        """Ask no more, ever."""
        self._closed.set()
        self._wanted.set()
        self._thread.join()

    def _run(self) -> None:
        while self._wanted.wait() and not self._closed.is_set():
            self._ask()
            self._asked += 1
            self._closed.wait(ASKING_PERIOD)


STEP = 0.0005  # Motion of the hand by one stroke [m]

HELP = (
    "Keys: <b>Space</b> or <b>Esc</b> emergency stop · <b>D</b> deeper, <b>U</b> up · <b>C</b> clutch · "
    "<b>R</b> record · <b>P</b> play, pause · <b>Tab</b>, <b>Enter</b> reach everything."
)
"""Letters and no arrows: those belong to sliders, tabs and lists."""

SPACE_HELP = (
    "<b>J</b>, <b>L</b> left, right · <b>I</b>, <b>K</b> away, nearer · <b>O</b> probe over image · "
    "<b>A</b> the whole of an arm · "
)
"""In a session in three dimensions."""
WHOLE_ARM = "Whole arm", "A"
"""Key that shows the whole of a simulated arm, and then the scene again."""


def add_keys(gui: Any, *keys: tuple[str, str, Callable[[Any], None]]) -> None:
    """Register keys with the viewer, whose list of commands (Ctrl-K) names them too: label, key and action of each."""
    for label, key, action in keys:
        gui.add_command(label, hotkey=key).on_trigger(handler(action))


SPACE_STROKES: dict[tuple[str, str], Vector] = {
    ("Hand to the left", "J"): (-STEP, 0.0, 0.0),
    ("Hand to the right", "L"): (STEP, 0.0, 0.0),
    ("Hand away", "I"): (0.0, STEP, 0.0),
    ("Hand nearer", "K"): (0.0, -STEP, 0.0),
}
"""Keys that move the hand in a session in three dimensions, and their ways [m]."""
