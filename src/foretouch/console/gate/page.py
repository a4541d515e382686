"""What is added to the viewer's page: that it says by itself, within a second, when it does not reach the console."""

from __future__ import annotations

from pathlib import Path

__all__ = ["BEAT_ATTRIBUTE", "BEAT_PERIOD", "LOST", "beat_html", "with_watch"]

BEAT_PERIOD = 0.1
"""So often the console shows the page that it draws [s]."""
BEAT_ATTRIBUTE = "data-foretouch-beat"
LOST = "THIS PAGE DOES NOT REACH THE CONSOLE"
"""How what the page then says begins."""
_SCRIPT = Path(__file__).with_name("page.js")


def beat_html(beat: int) -> str:
    """An element that nobody sees, and whose number goes on while the console draws."""
    return f'<i {BEAT_ATTRIBUTE}="{beat}"></i>'


def with_watch(page: bytes) -> bytes:
    """The viewer's page with the script that watches the beat.

    Args:
        page: As the viewer has it.
    """
    script = _SCRIPT.read_text().replace("LOST_TEXT", LOST).replace("BEAT_ATTRIBUTE", BEAT_ATTRIBUTE)
    return page.replace(b"<head>", b"<head><script>" + script.encode() + b"</script>", 1)
