"""What strangers and enemies say to a console; tests and `tests/attack/attack_console.py` say it."""

from __future__ import annotations

from typing import Any

import msgspec

HOSTS = (
    "evil.example",
    "evil.example:{port}",
    "127.0.0.1.evil.example:{port}",
    "127.0.0.1@evil.example",
    "",
    "0.0.0.0",
)
"""Names that an enemy may have made point here, some of them with the console's own port."""

ORIGINS = ("http://evil.example", "http://127.0.0.1:1", "http://localhost:{port}", "https://127.0.0.1", "null", None)
"""Where other pages come from."""

HARMFUL: tuple[dict[str, Any], ...] = (
    {"update_cb": []},
    {"update_cb": [], "value": True},
    {"props": {}},
    {"props": None},
    {"removed": True},
    {"is_button": False},
    {"sync_cb": None},
    {"label": "gone"},
    {"visible": False},
    {"disabled": True},
    {"uuid": "0"},
    {"__class__": 1},
    {"nothing_of_this_name": 1},
    {},
)
"""Properties of a control that no page may set."""


def malformed(camera: dict[str, Any]) -> tuple[bytes | str, ...]:
    """Messages that are none.

    Args:
        camera: One that would be right.
    """
    return (
        b"",
        b"\xc1",
        b"\x91\x07",
        b"\x80",
        b"\xdd\xff\xff\xff\xff",
        b"\xdf\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\x91" * 5000,
        b"\x81\xa4type" * 300,
        msgspec.msgpack.encode({"type": "GuiUpdateMessage"}),
        msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": [], "updates": 1}),
        msgspec.msgpack.encode({"type": "Message"}),
        msgspec.msgpack.encode({"type": 1}),
        msgspec.msgpack.encode(camera | {"position": (1.0,)}),
        msgspec.msgpack.encode(camera | {"position": (float("nan"), 0.0, 0.0)}),
        msgspec.msgpack.encode(camera | {"wxyz": "abcd"}),
        "text",
    )
