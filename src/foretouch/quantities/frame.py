"""Where a device or a robot has its zero and which way it counts, against the session's own line of positions."""

from __future__ import annotations

from dataclasses import dataclass

from foretouch.errors import SettingError
from foretouch.quantities.recording import LARGEST_POSITION

__all__ = ["Frame"]


@dataclass(frozen=True, slots=True)
class Frame:
    r"""One line of positions as seen from another.

    .. math:: x = d\,(r - r_0)

    x is the session's position, which grows into the material; r the machine's own.

    Args:
        origin: r_0, the machine's own position where the session has its zero [m], at most 1 m.
        direction: d, 1, or -1 where the machine's own positions shrink into the material.

    Raises:
        SettingError: An origin beyond 1 m, or another direction.
    """

    origin: float = 0.0
    direction: int = 1

    def __post_init__(self) -> None:
        if not abs(self.origin) <= LARGEST_POSITION:
            raise SettingError("origin", self.origin, f"must lie within {LARGEST_POSITION:g} m")
        if self.direction not in (1, -1):
            raise SettingError("direction", self.direction, "must be 1 or -1")

    @classmethod
    def from_text(cls, name: str, text: str) -> Frame:
        """The frame that a setting of this name gives as ``ORIGIN,DIRECTION``, for example ``0.02,-1``.

        Raises:
            SettingError: It is nothing of the kind.
        """
        try:
            origin, direction = text.split(",")
            return cls(float(origin), int(direction))
        except (ValueError, SettingError):
            rule = f"must be ORIGIN,DIRECTION: metres within {LARGEST_POSITION:g}, and 1 or -1; for example 0.02,-1"
            raise SettingError(name, text, rule) from None

    def inside(self, position: float) -> float:
        """The session's position [m] of one of the machine's [m]."""
        return self.direction * (position - self.origin)

    def outside(self, position: float) -> float:
        """The machine's position [m] of one of the session's [m]."""
        return self.origin + self.direction * position
