"""The Inverse3 of Haply (and the Minverse), over the WebSocket of the maker's Inverse Service.

Written after the maker's pages on the service, version 3.5 (*WebSocket Protocol*, *Control Commands*, *Basis
Permutation* and *Mount & Workspace Transforms* of docs.haply.co); for services before it after the page of 3.1, and
after public programs that talk to it. Tested against a stand-in of that service: **it has not been tried on a device**.
`docs/devices.md` says what to do at a first try.
"""

from __future__ import annotations

import sys
from typing import Any, ClassVar

from foretouch.devices.felt import FeltAlongAxis, FeltInSpace
from foretouch.devices.inverse3.service import ADDRESS, NAME, InverseService
from foretouch.errors import printable
from foretouch.plugins import named_at

__all__ = ["Inverse3", "InverseService", "SpatialInverse3", "make_inverse3"]


class Inverse3(FeltAlongAxis):
    """An Inverse3 along one of its axes: 0 to the right, 1 forward, 2 up."""

    name: ClassVar[str] = NAME


class SpatialInverse3(FeltInSpace):
    """An Inverse3 in three dimensions: x to the right, y forward, z up, 0 at its foot."""

    name: ClassVar[str] = NAME


def make_inverse3(settings: Any, reach: Any) -> Inverse3 | SpatialInverse3:
    """The device of a session, along the vertical or, with a scene, in space.

    Args:
        settings: `foretouch.session.SessionSettings`: ``operator`` may have an address, ``inverse3@HOST:PORT``.
        reach: How far the material is; not needed.

    Raises:
        MissingExtraError: websockets is not installed.
        SettingError: No such service, or no device there that can be used.
    """
    _, address = named_at(settings.operator)
    service = InverseService(address or ADDRESS, lambda line: sys.stderr.write(f"{printable(line)}\n"))
    kind = SpatialInverse3 if settings.scene else Inverse3
    return kind(service, settings.device)
