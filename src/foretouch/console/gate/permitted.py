"""Messages that a page may send: seven kinds, each with typed fields, and of controls their value alone.

The viewer takes far more: any attribute of a control, files, a tunnel to the internet. What is not listed here is
dropped before the viewer sees it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal

import msgspec

LARGEST_MESSAGE = 16_384
"""Longest message [byte]. Those of a page are a few hundred long; the longest name of a recording is 255."""
FARTHEST = 1e6
"""Largest coordinate of a point in the scene [scene units]; the pictures here are some ten units wide."""

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Point = tuple[float, float]


class _Said(msgspec.Struct, tag_field="type"):
    """Fields that are not listed are dropped."""


class Camera(_Said, tag="ViewerCameraMessage"):
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


class Update(_Said, tag="GuiUpdateMessage"):
    """A control was operated."""

    uuid: str
    updates: Value


class Command(_Said, tag="CommandTriggerMessage"):
    """A key was pressed, or a command chosen by its name."""

    uuid: str


class Drag(_Said, tag="SceneNodeDragMessage"):
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


class GizmoStart(_Said, tag="TransformControlsDragStartMessage"):
    """The handle in space is taken."""

    name: str
    owner: str = ""


class GizmoMove(_Said, tag="TransformControlsUpdateMessage"):
    """It is moved."""

    name: str
    wxyz: Quaternion
    position: Vector
    owner: str = ""


class GizmoEnd(_Said, tag="TransformControlsDragEndMessage"):
    """It is let go."""

    name: str
    owner: str = ""


_DECODER = msgspec.msgpack.Decoder(Camera | Update | Command | Drag | GizmoStart | GizmoMove | GizmoEnd)


def permitted(raw: bytes | str, control: Callable[[str], Any]) -> bytes | None:
    """The permitted part of a page's message; None where it is to be dropped.

    Args:
        raw: Message as received.
        control: Gives the viewer's handle of a control by its identifier, None where there is none.
    """
    if not isinstance(raw, bytes):
        return None
    try:
        said = _DECODER.decode(raw)
    except (msgspec.MsgspecError, RecursionError, ValueError, OverflowError):
        return None
    if isinstance(said, Update) and not fits(control(said.uuid), said.updates.value):
        return None
    fields = (getattr(said, name) for name in said.__struct_fields__)
    if not all(_bounded(field) for field in fields):
        return None
    return msgspec.msgpack.encode(said)


def fits(control: Any, value: Any) -> bool:
    """Whether a person could have given a control this value: it is shown, enabled, and allows the value.

    Args:
        control: The viewer's handle of a button, a checkbox, a slider or a dropdown; of others none fits.
        value: Value sent by a page.
    """
    from viser import GuiButtonHandle, GuiCheckboxHandle, GuiDropdownHandle, GuiSliderHandle

    if isinstance(control, GuiButtonHandle):
        right = value is True
    elif isinstance(control, GuiCheckboxHandle):
        right = isinstance(value, bool)
    elif isinstance(control, GuiSliderHandle):
        right = isinstance(value, int | float) and not isinstance(value, bool) and control.min <= value <= control.max
    elif isinstance(control, GuiDropdownHandle):
        right = value in control.options
    else:
        right = False
    return right and bool(control.visible) and not control.disabled


def _bounded(field: Any) -> bool:
    """Whether the numbers of a field are finite and near enough to be of the scene."""
    if isinstance(field, tuple):
        return all(_bounded(part) for part in field)
    return not isinstance(field, int | float) or (math.isfinite(field) and abs(field) <= FARTHEST)
