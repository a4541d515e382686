"""What the session is made of, to choose and to end, and the recordings to look at again.

A session has material, operator, grip and recording; recordings have a list, a time bar, and a run under other delays.
"""

from __future__ import annotations

import functools
import html
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from foretouch.console.panels.network import LONGEST_DELAY
from foretouch.console.playback import Playback
from foretouch.console.plots import heard, moved, put
from foretouch.console.sentences import NOTHING_LIVE
from foretouch.devices import GRIPS, OPERATORS
from foretouch.quantities.colours import BLUE, GREY, VERMILLION, css
from foretouch.robot import MATERIALS

END = "End the session"
START_RECORDING, STOP_RECORDING = "Start a recording (R)", "Stop the recording (R)"
NO_GRIP = "none"
"""The grip of an operator whose hand the force does not move."""
BY_HAND = (
    "Material, operator, grip and recording are chosen where the two sides were started: nobody supervises them here."
)
CHOICES: dict[str, tuple[str, Sequence[str], str]] = {
    "material": ("Material", sorted(MATERIALS), "What the robot presses: both sides begin anew"),
    "operator": ("Operator", OPERATORS, "Who moves the hand: the leader begins anew"),
    "grip": ("Grip", (NO_GRIP, *GRIPS), "How a hand holds the device that the force moves"),
}
"""Of each choice: the label, what there is, and what comes of it."""
BEGINNING = 20.0
"""Time for which a choice is shown before the session has confirmed it [s]."""
CLOSED = 0.3
"""For at least this time [s] nothing else can be chosen. Were a dropdown opened again in the moment in which it was
closed, the browser would hear of neither, and the focus would stay in it, where no key stops the robot."""


class SessionPanel:
    """Dropdowns, the recording's button, and the end."""

    def __init__(
        self,
        gui: Any,
        on_choice: Callable[[str, str], None],
        on_record: Callable[[], None],
        on_end: Callable[[], None],
        *,
        live: bool = True,
    ) -> None:
        self._on_choice = on_choice
        self._supervised_elsewhere = BY_HAND if live else NOTHING_LIVE
        self._waiting: dict[str, tuple[str, float]] = {}  # what was chosen, and when [s]
        self._dropdowns = {
            name: gui.add_dropdown(label, tuple(options), hint=hint, disabled=True)
            for name, (label, options, hint) in CHOICES.items()
        }
        for name, dropdown in self._dropdowns.items():
            dropdown.on_update(moved(functools.partial(self._choose, name)))
        self._record = gui.add_button(START_RECORDING, color=GREY, disabled=True)
        self._note = gui.add_html("")
        self._end = gui.add_button(END, color=GREY, disabled=not live)
        self._record.on_click(heard(lambda event: on_record()))
        self._end.on_click(heard(lambda event: on_end()))

    def show(self, runs: dict[str, str], *, offered: bool, recording: str, refused: str) -> None:
        """Show what runs: choices, the file that is written, and why the newest choice was refused; "" for none."""
        for name, (chosen, at) in tuple(self._waiting.items()):
            waited = time.monotonic() - at
            if waited > BEGINNING or (waited > CLOSED and (refused or runs.get(name) == chosen)):
                self._waiting.pop(name, None)
        for name, dropdown in self._dropdowns.items():
            value = "" if name in self._waiting else runs.get(name, "")
            if value and value not in dropdown.options:  # of a robot that is no simulation, for example
                dropdown.options = (*dropdown.options, value)
            if value and dropdown.value != value:
                dropdown.value = value
            open_to_all = offered and not self._waiting
            put(dropdown, disabled=not open_to_all)
        label = STOP_RECORDING if recording else START_RECORDING
        if self._record.label != label:
            self._record.label, self._record.color = label, BLUE if recording else GREY
        put(self._record, disabled=not offered)
        self._write(offered, recording, refused)

    def ending(self) -> None:
        """Show that the session ends."""
        self._end.label = "The session ends"
        self._end.disabled = True

    def _write(self, offered: bool, recording: str, refused: str) -> None:
        lines = [] if offered else [f'<span style="color:#555">{self._supervised_elsewhere}</span>']
        if offered:
            what = f"Recording: {html.escape(recording)}" if recording else "Nothing is recorded."
            lines.append(f'<span style="color:#555">{what}</span>')
            lines += [f"<b>Begins anew with {html.escape(chosen)} …</b>" for chosen, _ in self._waiting.values()]
        if refused:
            lines.append(f'<b style="color:{css(VERMILLION)}">Not chosen: {html.escape(refused)}</b>')
        put(self._note, content=f'<div style="padding:2px 12px;overflow-wrap:anywhere">{"<br>".join(lines)}</div>')

    def _choose(self, name: str, event: Any) -> None:
        value = str(event.target.value)
        event.target.disabled = True  # it lets go of the focus too, in which no key would stop the robot
        self._waiting[name] = (value, time.monotonic())
        self._on_choice(name, value)


SETTLED = 0.3
"""Time without a motion after which a bar is put where the recording is [s], whatever a page shows: the value sent to
it last may have crossed one that a person typed into it."""
SLIGHTLY = 0.01
"""Smallest difference from the former value: the viewer does not send a repetition [s]."""
CHOOSE = "choose one to look at it"
PLAY, PAUSE = "Play (P)", "Pause (P)"
BACK, CLOSE = "Back to live", "Close the recording"
RUN_AGAIN = "Run it again under these delays"
_QUIET = "padding:2px 12px;color:#555;overflow-wrap:anywhere"
"""Of what explains itself once it is read."""


class RecordingsPanel:
    """What was recorded, and when of it is shown."""

    def __init__(
        self,
        gui: Any,
        on_open: Callable[[str], None],
        on_play: Callable[[], None],
        on_seek: Callable[[float], None],
        on_live: Callable[[], None],
        on_again: Callable[[float, float, bool], None],
        *,
        live: bool = True,
    ) -> None:
        self._on_open, self._on_seek, self._on_again = on_open, on_seek, on_again
        self._list = gui.add_dropdown("Recording", (CHOOSE,), hint="The newest first")
        self._where = gui.add_html("")
        self._bar = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0, disabled=True)
        self._play = gui.add_button(PLAY, color=GREY, disabled=True)
        self._live = gui.add_button(BACK if live else CLOSE, color=BLUE, disabled=True)
        self._note = gui.add_html("")
        self._position_delay = gui.add_slider("Delay there [s]", 0.0, LONGEST_DELAY, 0.01, 0.0, disabled=True)
        self._force_delay = gui.add_slider("Delay back [s]", 0.0, LONGEST_DELAY, 0.01, 0.0, disabled=True)
        self._closed = gui.add_checkbox(
            "Closed loop", False, hint="The force moves the hand; needs a grip", disabled=True
        )
        self._again = gui.add_button(RUN_AGAIN, color=GREY, disabled=True)
        self._shown: Playback | None = None
        self._moved = math.nan  # when a person moved the bar [s], until it has settled
        self._list.on_update(moved(self._chosen))
        self._bar.on_update(moved(self._dragged))
        self._play.on_click(heard(lambda event: on_play()))
        self._live.on_click(heard(lambda event: on_live()))
        self._again.on_click(heard(self._run_again))

    def list(self, names: tuple[str, ...], where: str) -> None:
        """Show which recordings there are, and in which folders."""
        put(self._where, content=f'<div style="{_QUIET}">{html.escape(where)}</div>')
        options = (CHOOSE, *names)
        if tuple(self._list.options) != options:
            value = self._list.value
            self._list.options = options
            if value in options:
                self._list.value = value

    def show(self, playback: Playback | None, note: str, busy: bool) -> None:
        """Show the recording that is looked at, one line on it, and whether something is being read or run."""
        if playback is not self._shown:
            if playback is None:
                self._list.value, self._bar.value, self._play.label = CHOOSE, 0.0, PLAY
            elif self._shown is None or playback.log is not self._shown.log:
                self._put(playback)
            self._shown = playback
        here = playback is not None
        controls = (self._bar, self._play, self._live, self._position_delay, self._force_delay, self._closed)
        offers = [(control, here) for control in controls]
        for control, offered in (*offers, (self._again, here and not busy), (self._list, not busy)):
            put(control, disabled=not offered)
        if playback is not None:
            self._place_bar(playback.now)
            put(self._play, label=PAUSE if playback.playing else PLAY)
        put(self._note, content=f'<div style="{_QUIET}">{html.escape(note)}</div>')

    def _place_bar(self, now: float) -> None:
        """Put the bar where the recording is [s]."""
        if time.monotonic() - self._moved > SETTLED:
            self._moved = math.nan
            self._bar.value = round(now, 2) + SLIGHTLY
        if abs(self._bar.value - now) > 0.005:
            self._bar.value = round(now, 2)

    def _put(self, playback: Playback) -> None:
        """A new one: its length, and the delays that it had."""
        self._bar.max = max(round(playback.duration, 2), 0.01)
        for slider, name in ((self._position_delay, "position_delay"), (self._force_delay, "force_delay")):
            slider.value = min(max(playback.shown.setting(name, 0.0), 0.0), LONGEST_DELAY)

    def _chosen(self, event: Any) -> None:
        if self._list.value != CHOOSE:
            self._list.disabled = True  # it lets go of the focus too, in which no key would stop the robot
            self._on_open(str(self._list.value))

    def _dragged(self, event: Any) -> None:
        self._moved = time.monotonic()
        self._on_seek(float(self._bar.value))

    def _run_again(self, event: Any) -> None:
        self._on_again(float(self._position_delay.value), float(self._force_delay.value), bool(self._closed.value))
