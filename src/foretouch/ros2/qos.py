"""Quality of service as `rmw_zenoh_cpp` writes it into a liveliness token."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["DEFAULT", "SENSOR_DATA", "Qos"]

BEST_EFFORT: Final = 2
"""Number of that reliability in ``rmw/types.h``; reliable is what a token says by saying nothing."""

USUAL_DEPTH: Final = 42
"""Depth that a token says by saying nothing (``rmw_zenoh_cpp``, ``qos.cpp``)."""


@dataclass(frozen=True)
class Qos:
    """A profile: volatile, the newest kept, without deadline or lifespan.

    Attributes:
        reliable: Whether it is reliable, and not best effort.
        depth: So many messages are kept.
    """

    reliable: bool
    depth: int

    @property
    def token(self) -> str:
        """Its part of a liveliness token.

        ``RELIABILITY:DURABILITY:HISTORY,DEPTH:DEADLINE_S,DEADLINE_NS:LIFESPAN_S,LIFESPAN_NS:LIVELINESS,LEASE_S,LEASE_NS``,
        each empty where it is the default of ``rmw_zenoh_cpp`` (its ``docs/design.md``, and ``qos_to_keyexpr`` of its
        ``liveliness_utils.cpp``).
        """
        reliability = "" if self.reliable else str(BEST_EFFORT)
        depth = "" if self.depth == USUAL_DEPTH else str(self.depth)
        return f"{reliability}::,{depth}:,:,:,,"


SENSOR_DATA: Final = Qos(reliable=False, depth=5)
"""``rmw_qos_profile_sensor_data``: best effort, 5 kept."""

DEFAULT: Final = Qos(reliable=True, depth=10)
"""``rmw_qos_profile_default``: reliable, 10 kept."""
