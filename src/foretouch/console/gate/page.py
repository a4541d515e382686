"""Additions to the viewer's page, which it draws and shows by itself; and what messages a page may send.

Where the page is drawn in software it draws more cheaply, and never more often than the console asks; a curve has gaps
where it is no number; Space and Escape press the emergency stop; a number out of a slider's range is ignored; and
within a second the page shows that it does not reach the console, or that the session has ended.

A page may send seven kinds of messages, each with typed fields, and of controls their value alone. The viewer takes far
more: any attribute of a control, files, a tunnel to the internet. What is not listed here is dropped before it sees it.
"""

from __future__ import annotations

import html
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import msgspec

from foretouch.quantities.colours import URGENT, css

BEAT_PERIOD = 0.1  # Period at which the console shows the page that it draws [s]
BEAT_ATTRIBUTE, FRAMES_ATTRIBUTE, ENDED_ATTRIBUTE = (f"data-foretouch-{name}" for name in ("beat", "frames", "ended"))
LOST, ENDED = "THIS PAGE DOES NOT REACH THE CONSOLE", "THE SESSION HAS ENDED"
"""Beginning of the text that the page then shows."""
STOP_BUTTON = "div:has(> .foretouch-alarm) + div > button"
"""Style-sheet selector of the emergency stop: Space and Escape press it."""
WITH_KEYBOARD = "(hover: hover) and (pointer: fine)"  # Style-sheet query for a keyboard: a phone has none
_SCRIPT = Path(__file__).with_name("page.js")
_WORDS = {
    "LOST_TEXT": LOST,
    "ENDED_TEXT": ENDED,
    **{f"{name}_ATTRIBUTE": f"data-foretouch-{name.lower()}" for name in ("BEAT", "FRAMES", "ENDED")},
    "STOP_BUTTON": STOP_BUTTON,
    "WITH_KEYBOARD": WITH_KEYBOARD,
    "URGENT_COLOUR": css(URGENT),
}


def beat_html(beat: int, frames: float = 30.0, ended: str = "") -> str:
    """An invisible element: a number that grows while the console draws, frames per second, the text after the end."""
    last = f' {ENDED_ATTRIBUTE}="{html.escape(ended)}"' if ended else ""
    return f'<i {BEAT_ATTRIBUTE}="{beat}" {FRAMES_ATTRIBUTE}="{frames:.0f}"{last}></i>'


def with_watch(page: bytes) -> bytes:
    """The viewer's page with the script."""
    script = _SCRIPT.read_text()
    for name, word in _WORDS.items():
        script = script.replace(name, word)
    return page.replace(b"<head>", b"<head><script>" + script.encode() + b"</script>", 1)


LARGEST_MESSAGE = 16_384
"""Longest message [byte]. Those of a page are a few hundred long; the longest name of a recording is 255."""
FARTHEST = 1e6  # Largest coordinate of a point in the scene [scene units]; the pictures here are some ten units wide

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Point = tuple[float, float]


class _Typed(msgspec.Struct, tag_field="type"):
    """Fields that are not listed are dropped."""


class Camera(_Typed, tag="ViewerCameraMessage"):
    """Camera pose of the page; the viewer counts a page as connected once it has sent it."""

    wxyz: Quaternion
    position: Vector
    fov: float
    near: float
    far: float
    image_height: float
    image_width: float
    look_at: Vector
    up_direction: Vector


class Value(msgspec.Struct, forbid_unknown_fields=True):
    """The one property of a control that a page may set."""

    value: bool | int | float | str


class Update(_Typed, tag="GuiUpdateMessage"):
    """A control was operated."""

    uuid: str
    updates: Value


class Command(_Typed, tag="CommandTriggerMessage"):
    """A key was pressed, or a command chosen by its name."""

    uuid: str


class Drag(_Typed, tag="SceneNodeDragMessage"):
    """The handle along a line is dragged."""

    phase: Literal["start", "update", "end"]
    name: str
    instance_index: int | None
    start_position: Vector
    start_screen_pos: Point
    end_position: Vector
    end_screen_pos: Point
    button: Literal["left", "middle", "right"]
    modifier: str | None
    owner: str = ""


class GizmoStart(_Typed, tag="TransformControlsDragStartMessage"):
    """The handle in space is taken."""

    name: str
    owner: str = ""


class GizmoMove(_Typed, tag="TransformControlsUpdateMessage"):
    """It is moved."""

    name: str
    wxyz: Quaternion
    position: Vector
    owner: str = ""


class GizmoEnd(GizmoStart, tag="TransformControlsDragEndMessage"):
    """It is let go."""


_DECODER = msgspec.msgpack.Decoder(Camera | Update | Command | Drag | GizmoStart | GizmoMove | GizmoEnd)


def permitted(raw: bytes | str, control: Callable[[str], Any]) -> bytes | None:
    """The permitted part of a page's message; None where it is to be dropped."""
    if not isinstance(raw, bytes):
        return None
    try:
        message = _DECODER.decode(raw)
    except (msgspec.MsgspecError, RecursionError, ValueError, OverflowError):
        return None
    if isinstance(message, Update) and not fits(control(message.uuid), message.updates.value):
        return None
    return msgspec.msgpack.encode(message) if _bounded(msgspec.structs.astuple(message)) else None


def fits(control: Any, value: Any) -> bool:
    """Whether a person could have given a control this value: it is shown, enabled, and allows the value."""
    from viser import GuiButtonHandle, GuiCheckboxHandle, GuiDropdownHandle, GuiSliderHandle

    match control:
        case GuiButtonHandle():
            allowed = value is True
        case GuiCheckboxHandle():
            allowed = isinstance(value, bool)
        case GuiSliderHandle():
            allowed = type(value) in (int, float) and control.min <= value <= control.max
        case GuiDropdownHandle():
            allowed = value in control.options
        case _:
            allowed = False
    return allowed and bool(control.visible) and not control.disabled


def _bounded(field: Any) -> bool:
    """Whether the numbers of a field are finite and near enough to be of the scene."""
    if isinstance(field, tuple):
        return all(_bounded(part) for part in field)
    return not isinstance(field, int | float) or (math.isfinite(field) and abs(field) <= FARTHEST)
