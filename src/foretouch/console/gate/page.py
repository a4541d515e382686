"""Additions to the viewer's page: how it draws, and the messages that it shows by itself.

Where the page is drawn in software it draws more cheaply, and never more often than the console asks; a curve has gaps
where it is no number; Space and Escape press the emergency stop; a number out of a slider's range is ignored; and
within a second the page shows that it does not reach the console, or that the session has ended.
"""

from __future__ import annotations

import html
from pathlib import Path

from foretouch.quantities.colours import URGENT, css

BEAT_PERIOD = 0.1
"""Period at which the console shows the page that it draws [s]."""
BEAT_ATTRIBUTE, FRAMES_ATTRIBUTE, ENDED_ATTRIBUTE = (f"data-foretouch-{name}" for name in ("beat", "frames", "ended"))
LOST, ENDED = "THIS PAGE DOES NOT REACH THE CONSOLE", "THE SESSION HAS ENDED"
"""Beginning of the text that the page then shows."""
STOP_BUTTON = "div:has(> .foretouch-alarm) + div > button"
"""Where the emergency stop is in the page, as a style sheet names it: Space and Escape press it."""
WITH_KEYBOARD = "(hover: hover) and (pointer: fine)"
"""Where there are keys to press, as a style sheet asks: a phone has none."""
_SCRIPT = Path(__file__).with_name("page.js")
_WORDS = {
    "LOST_TEXT": LOST,
    "ENDED_TEXT": ENDED,
    "BEAT_ATTRIBUTE": BEAT_ATTRIBUTE,
    "FRAMES_ATTRIBUTE": FRAMES_ATTRIBUTE,
    "ENDED_ATTRIBUTE": ENDED_ATTRIBUTE,
    "STOP_BUTTON": STOP_BUTTON,
    "WITH_KEYBOARD": WITH_KEYBOARD,
    "URGENT_COLOUR": css(URGENT),
}


def beat_html(beat: int, frames: float = 30.0, ended: str = "") -> str:
    """An invisible element; its number grows for as long as the console draws.

    Args:
        beat: The number.
        frames: Number of pictures per second that the page may draw.
        ended: Text after the session's end; "" while it runs.
    """
    last = f' {ENDED_ATTRIBUTE}="{html.escape(ended)}"' if ended else ""
    return f'<i {BEAT_ATTRIBUTE}="{beat}" {FRAMES_ATTRIBUTE}="{frames:.0f}"{last}></i>'


def with_watch(page: bytes) -> bytes:
    """The viewer's page with the script.

    Args:
        page: As the viewer has it.
    """
    script = _SCRIPT.read_text()
    for name, word in _WORDS.items():
        script = script.replace(name, word)
    return page.replace(b"<head>", b"<head><script>" + script.encode() + b"</script>", 1)
