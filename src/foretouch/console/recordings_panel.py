"""The list of recordings, the time bar of the one that is looked at, and running it again under other delays."""

from __future__ import annotations

import html
from collections.abc import Callable
from typing import Any

from foretouch.console.network_panel import LONGEST_DELAY
from foretouch.console.playback import Playback
from foretouch.quantities.colours import BLUE, GREY

__all__ = ["CHOOSE", "LIVE", "PAUSE", "PLAY", "RUN_AGAIN", "RecordingsPanel"]

CHOOSE = "choose one to look at it"
PLAY, PAUSE = "Play (P)", "Pause (P)"
LIVE = "Back to live"
RUN_AGAIN = "Run it again under these delays"


class RecordingsPanel:
    """What was recorded, and when of it is shown.

    Args:
        gui: The viewer's user interface.
        on_open: Called with the name of a recording.
        on_play: Called when it is to go on or to pause.
        on_seek: Called with the moment [s] at which a person puts the bar.
        on_live: Called when the session that runs is to be shown again.
        on_again: Called with both delays [s] and whether the force moves the hand.
    """

    def __init__(
        self,
        gui: Any,
        on_open: Callable[[str], None],
        on_play: Callable[[], None],
        on_seek: Callable[[float], None],
        on_live: Callable[[], None],
        on_again: Callable[[float, float, bool], None],
    ) -> None:
        self._on_open, self._on_play, self._on_seek = on_open, on_play, on_seek
        self._on_live, self._on_again = on_live, on_again
        self._list = gui.add_dropdown("Recording", (CHOOSE,), hint="Of this session's folder, the newest first")
        self._bar = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0, disabled=True)
        self._play = gui.add_button(PLAY, color=GREY, disabled=True)
        self._live = gui.add_button(LIVE, color=BLUE, disabled=True)
        self._note = gui.add_html("")
        self._position_delay = gui.add_slider("Delay there [s]", 0.0, LONGEST_DELAY, 0.01, 0.0, disabled=True)
        self._force_delay = gui.add_slider("Delay back [s]", 0.0, LONGEST_DELAY, 0.01, 0.0, disabled=True)
        self._closed = gui.add_checkbox(
            "Closed loop", False, hint="The force moves the hand; needs a grip", disabled=True
        )
        self._again = gui.add_button(RUN_AGAIN, color=GREY, disabled=True)
        self._shown: Playback | None = None
        self._list.on_update(self._chosen)
        self._bar.on_update(self._dragged)
        self._play.on_click(self._play_clicked)
        self._live.on_click(self._live_clicked)
        self._again.on_click(self._again_clicked)

    def list(self, names: tuple[str, ...]) -> None:
        """Show which recordings there are."""
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
            if control.disabled == offered:
                control.disabled = not offered
        if playback is not None:
            if abs(self._bar.value - playback.now) > 0.005:
                self._bar.value = round(playback.now, 2)
            label = PAUSE if playback.playing else PLAY
            if self._play.label != label:
                self._play.label = label
        text = f'<div style="padding:2px 12px;color:#555;overflow-wrap:anywhere">{html.escape(note)}</div>'
        if self._note.content != text:
            self._note.content = text

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
            self._on_seek(float(self._bar.value))

    async def _play_clicked(self, event: Any) -> None:
        self._on_play()

    async def _live_clicked(self, event: Any) -> None:
        self._on_live()

    async def _again_clicked(self, event: Any) -> None:
        self._on_again(float(self._position_delay.value), float(self._force_delay.value), bool(self._closed.value))
