"""What stands across the top of the picture while a recording is looked at."""

from __future__ import annotations

import html
from typing import Any

from foretouch.console.playback import Playback
from foretouch.quantities.colours import INK, ORANGE, css

__all__ = ["NOT_LIVE", "Banner"]

NOT_LIVE = "RECORDING, NOT LIVE"


class Banner:
    """One line that nobody overlooks.

    Args:
        gui: The viewer's user interface.
    """

    def __init__(self, gui: Any) -> None:
        self._box = gui.add_html("")

    def show(self, playback: Playback | None) -> None:
        """Say which recording is looked at, and which moment of it; nothing where none is."""
        content = "" if playback is None else _html(playback)
        if self._box.content != content:
            self._box.content = content


def _html(playback: Playback) -> str:
    time = f"{playback.now:.1f} of {playback.duration:.1f} s"
    what = f"{NOT_LIVE}: {html.escape(playback.name)}, {time}"
    return (
        '<div role="status" style="position:fixed;left:12px;top:12px;z-index:100;pointer-events:none;'
        "max-width:max(calc(100vw - 500px), min(366px, calc(100vw - 24px)));overflow-wrap:anywhere;"
        f"background:{css(ORANGE)};color:{css(INK)};"
        f'border:3px solid {css(INK)};border-radius:8px;padding:6px 12px;font-weight:700;font-size:17px">{what}<br>'
        '<span style="font-weight:400;font-size:14px">The robot goes on with the session; the emergency stop below is '
        "the robot's.</span></div>"
    )
