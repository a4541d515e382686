"""What an end sends against loss, beside what is said until it is acknowledged; the other end understands all."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from foretouch.session.network.erasure import MOST_PARITIES


class Protection(NamedTuple):
    """How often things are said."""

    parities: Callable[[int], int]  # how many of them so many pieces have
    soon: int  # ticks after which positions of a robot that changed are said once more by a packet of their own; or 0


USUAL = "parity"
PROTECTIONS = {
    "none": Protection(lambda pieces: 0, soon=0),
    USUAL: Protection(lambda pieces: int(pieces > 1), soon=0),
    "strong": Protection(lambda pieces: min(pieces // 2 + 1, MOST_PARITIES), soon=10),
}
