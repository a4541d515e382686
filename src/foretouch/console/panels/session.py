"""What the session is made of, to choose and to end, and the recordings to look at again.

A session has material, operator, grip and recording; recordings have a list, a time bar, and a run under other delays.
"""

from __future__ import annotations

import html
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from foretouch.console.panels.network import LONGEST_DELAY
from foretouch.console.playback import Playback
from foretouch.console.plots import put
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
    """Dropdowns, the recording's button, and the end.

    Args:
        gui: The viewer's user interface.
        on_choice: Called with a choice's name and what was chosen.
        on_record: Called when a recording is to begin or to end.
        on_end: Called when the session is to end.
        live: Whether there may be one.
    """

    def __init__(
        self,
        gui: Any,
        on_choice: Callable[[str, str], None],
        on_record: Callable[[], None],
        on_end: Callable[[], None],
        *,
        live: bool = True,
    ) -> None:
        self._on_choice, self._on_record, self._on_end = on_choice, on_record, on_end
        self._supervised_elsewhere = BY_HAND if live else NOTHING_LIVE
        self._waiting: dict[str, tuple[str, float]] = {}  # what was chosen, and when [s]
        self._dropdowns = {
            name: gui.add_dropdown(label, tuple(options), hint=hint, disabled=True)
            for name, (label, options, hint) in CHOICES.items()
        }
        for name, dropdown in self._dropdowns.items():
            dropdown.on_update(self._chooser(name))
        self._record = gui.add_button(START_RECORDING, color=GREY, disabled=True)
        self._note = gui.add_html("")
        self._end = gui.add_button(END, color=GREY, disabled=not live)
        self._record.on_click(self._record_clicked)
        self._end.on_click(self._end_clicked)

    def show(self, runs: dict[str, str], *, offered: bool, recording: str, refused: str) -> None:
        """Show what runs.

        Args:
            runs: Material, operator and grip by name, those that are known.
            offered: Whether a process follows a choice.
            recording: File that is written; "" for none.
            refused: Why the newest choice was not followed; "" where it was.
        """
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
        text = f'<div style="padding:2px 12px;overflow-wrap:anywhere">{"<br>".join(lines)}</div>'
        put(self._note, content=text)

    def _chooser(self, name: str) -> Callable[[Any], Any]:
        async def chosen(event: Any) -> None:
            if event.client is not None:  # None: the program set it
                value = str(event.target.value)
                event.target.disabled = True  # it lets go of the focus too, in which no key would stop the robot
                self._waiting[name] = (value, time.monotonic())
                self._on_choice(name, value)

        return chosen

    async def _record_clicked(self, event: Any) -> None:
        self._on_record()

    async def _end_clicked(self, event: Any) -> None:
        self._on_end()


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
    """What was recorded, and when of it is shown.

    Args:
        gui: The viewer's user interface.
        on_open: Called with the name of a recording.
        on_play: Called when it is to go on or to pause.
        on_seek: Called with the moment [s] at which a person puts the bar.
        on_live: Called when the session that runs is to be shown again.
        on_again: Called with both delays [s] and whether the force moves the hand.
        live: Whether there may be a session to go back to.
    """

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
        self._on_open, self._on_play, self._on_seek = on_open, on_play, on_seek
        self._on_live, self._on_again = on_live, on_again
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
        self._list.on_update(self._chosen)
        self._bar.on_update(self._dragged)
        self._play.on_click(self._play_clicked)
        self._live.on_click(self._live_clicked)
        self._again.on_click(self._again_clicked)

    def list(self, names: tuple[str, ...], where: str) -> None:
        """Show which recordings there are.

        Args:
            names: The newest first.
            where: In which folders they are.
        """
        text = f'<div style="{_QUIET}">{html.escape(where)}</div>'
        put(self._where, content=text)
        options = (CHOOSE, *names)
        if tuple(self._list.options) != options:
            value = self._list.value
            self._list.options = options
            if value in options:
                self._list.value = value

    def show(self, playback: Playback | None, note: str, busy: bool) -> None:
        """Show the recording that is looked at.

        Args:
            playback: It, None for none.
            note: One line.
            busy: Whether something is being read or run.
        """
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
            label = PAUSE if playback.playing else PLAY
            put(self._play, label=label)
        text = f'<div style="{_QUIET}">{html.escape(note)}</div>'
        put(self._note, content=text)

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

    async def _chosen(self, event: Any) -> None:
        if event.client is not None and self._list.value != CHOOSE:
            self._list.disabled = True  # it lets go of the focus too, in which no key would stop the robot
            self._on_open(str(self._list.value))

    async def _dragged(self, event: Any) -> None:
        if event.client is not None:
            self._moved = time.monotonic()
            self._on_seek(float(self._bar.value))

    async def _play_clicked(self, event: Any) -> None:
        self._on_play()

    async def _live_clicked(self, event: Any) -> None:
        self._on_live()

    async def _again_clicked(self, event: Any) -> None:
        self._on_again(float(self._position_delay.value), float(self._force_delay.value), bool(self._closed.value))
