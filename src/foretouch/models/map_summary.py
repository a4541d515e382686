"""What there is to say of a contact map in a few numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from foretouch.models.contact_map import ContactMap
from foretouch.models.contact_model import NO_STATE, advance

__all__ = ["MapSummary", "summarise_map"]

DEPTH_SHARES = (0.25, 0.5, 0.9)
"""Local stiffness is given at these shares of the deepest depth that was visited."""

STEP = 0.02
"""Half the distance over which it is taken, as a share of that depth."""

PERIOD = 1e-3


@dataclass(frozen=True, slots=True)
class MapSummary:
    """A contact map in a few numbers; depths count from the surface of the model.

    Attributes:
        shares: Of the experts ``law``, ``coarse`` and ``fine`` in the force; they sum to 1.
        depth_visited: Deepest so far [m].
        speed_visited: Largest in contact so far [m/s].
        depths: Where the two below are taken [m], a quarter, half and nine tenths of `depth_visited`; empty while
            nothing was visited below the surface.
        forces: Of the whole model, the probe at rest there and the material too [N].
        stiffnesses: Local stiffness dF/dx there [N/m].
    """

    shares: dict[str, float]
    depth_visited: float
    speed_visited: float
    depths: tuple[float, ...]
    forces: tuple[float, ...]
    stiffnesses: tuple[float, ...]

    def figures(self, standard_deviation: float | None) -> dict[str, object]:
        """The same as named figures for JSON.

        Args:
            standard_deviation: Of the newest force [N], None or NaN where it is not known.
        """
        known = standard_deviation is not None and math.isfinite(standard_deviation)
        return {
            "shares": dict(self.shares),
            "depth_visited_m": self.depth_visited,
            "speed_visited_m_per_s": self.speed_visited,
            "depths_m": list(self.depths),
            "forces_N": list(self.forces),
            "local_stiffness_N_per_m": list(self.stiffnesses),
            "standard_deviation_N": standard_deviation if known else None,
        }


def summarise_map(model: ContactMap) -> MapSummary:
    r"""Look at a contact map.

    At depth x, the probe at rest in a material that has come to rest (no velocity, plays and averages where the probe
    is), the local stiffness is

    .. math:: \frac{F(x + h) - F(x - h)}{2 h}

    with h a fiftieth of the deepest depth visited. A stiffness k in N/m^s is comparable at one exponent only; this one
    is comparable between all laws.

    Args:
        model: The map.
    """
    from foretouch.models.contact_map_layout import LAW_SPEED, ORIGIN, REACHED
    from foretouch.models.contact_map_wire import unpack

    flat = unpack(model.map)
    assert flat is not None  # a model that is none is never made
    depth = max(float(flat[REACHED] + flat[ORIGIN]), 0.0)
    law, coarse, fine = model.shares
    depths = tuple(share * depth for share in DEPTH_SHARES) if depth > 0.0 else ()
    step = STEP * depth
    return MapSummary(
        {"law": law, "coarse": coarse, "fine": fine},
        depth,
        float(flat[LAW_SPEED]),
        depths,
        tuple(_at_rest(model, place) for place in depths),
        tuple((_at_rest(model, place + step) - _at_rest(model, place - step)) / (2.0 * step) for place in depths),
    )


def _at_rest(model: ContactMap, depth: float) -> float:
    """Force where the probe rests and the material remembers nothing else [N]."""
    return advance(model, NO_STATE, depth, 0.0, PERIOD)[1]
