"""A contact law learnt as a map: force over depth and over the memory of the material; and its summary."""

from __future__ import annotations

import base64
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.models.contact_map.layout import MEMORY
from foretouch.models.contact_model import NO_STATE, ContactModel, ContactState, advance
from foretouch.quantities import Brief

_LAW = struct.Struct("<4d")

UNTOUCHED: ContactState = (math.nan,) * MEMORY
"""Memory of a material before the first sample: positions of the two plays, then the three averages [m]."""


@dataclass(frozen=True, slots=True)
class ContactMapModel(Brief, ContactModel):
    r"""Model of a material that follows none of the laws: a weighted mean of three experts.

    .. math::
        F &= \sum_i \pi_i F_i, \quad F_i = \max(-s P,\; g_i(x) + \sum_j h_{ij}(x)\, \phi_j) \\
        \phi &= \left(\frac{\dot x}{v_0},\; \frac{x - z_r}{r},\; \frac{x_+ - \bar x_T}{2\,\mathrm{mm}}\right)

    g and h are cubic splines. The **coarse map** has knots every millimetre (the h every three), and remembers: z_r are
    play operators of radius r = 0.1 and 0.3 mm (hysteresis), x_T averages over T = 0.05, 0.3 and 1.5 s of the depth
    that is inside (relaxation). The motion alone determines all of this. The **fine map** has knots every 0.03 mm and
    velocity only, for rigid materials; it lies where the learner placed it, and elsewhere the coarse map stands for it.
    The **law** is the paper's (4).

    What **pulls** does so by P at most, the largest pull that was felt, 0 for most materials, and while it sticks to
    the probe: s is 1 from where the probe comes further in than it was caught so far, and 0 from where it goes further
    out than it was held so far; between the two it is what it was before.

    Outside the visited range the model extrapolates: features are held to their range so far; beyond the greatest depth
    a map goes on along its last slope, held between the chord from the surface and 1.5 times that, the fine one where
    it holds there; the law goes on in proportion from the greatest depth since the last change, and counts speeds up to
    1.5 times the largest since then. No force within the range is more than 1.5 times the largest felt; beyond it only
    the slope is bounded. Outside of where the material was touched, the force is held below one that falls to zero
    over a learnt way. The standard deviation is that of late predictions so far, from a constant and a multiple of the
    force, and grows with the depth that is extrapolated. Slightly above the surface there may be a force: the learnt
    map shows more precisely where contact begins.

    Args:
        stiffness: k of the law [N/m^(n + alpha)], not negative; 0 while the law is unknown.
        damping: lambda of the law [N s/m^(n+1)], not negative.
        exponent: n of the law [-], not negative.
        switching: alpha of the law [-], not negative.
        map: The rest, packed (`foretouch.models.contact_map.wire`).

    Raises:
        SettingError: A parameter is out of range, or the bytes are not a map.

    References:
        Play operators: Brokate and Sprekels (1996), Hysteresis and Phase Transitions. Averages as relaxation: the Prony
        series of linear viscoelasticity. Splines as a prior: Wahba (1990), Spline Models for Observational Data.
    """

    law: ClassVar[str] = "contact-map"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "damping", "exponent", "switching")
    stiffness: float
    damping: float
    exponent: float
    switching: float
    map: bytes = field(repr=False)
    _maps: NDArray[np.void] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        parameters = self.parameters
        if not all(0.0 <= value < math.inf for value in parameters):
            for name, value in zip(self.parameter_names, parameters, strict=True):
                require(name, value, at_least=0.0)
        maps = _compiled("wire").unpack(self.map, parameters)  # the map carries them rounded
        if maps is None:
            raise SettingError("map", f"{len(self.map)} bytes", "is no contact map")
        object.__setattr__(self, "_maps", maps)

    @classmethod
    def of(cls, maps: NDArray[np.void]) -> ContactMapModel | None:
        """The model of a map as it is learnt, an array of one; None where its numbers go beyond the range of 32 bits.

        It equals one that is made of its own parameters and bytes, which need no second look here.
        """
        content, kept, good = _compiled("wire").shrunk(maps)
        if not good:
            return None
        model = object.__new__(cls)
        known = dict(zip(cls.parameter_names, kept["law"][0].tolist(), strict=True), map=content, _maps=kept)
        for name, value in known.items():
            object.__setattr__(model, name, value)
        return model

    @classmethod
    def from_text(cls, text: str) -> ContactMapModel:
        """The model of `to_text`.

        Raises:
            SettingError: It is none.
        """
        try:
            content = base64.b64decode(text, validate=True)
            stiffness, damping, exponent, switching = _LAW.unpack_from(content)
            return cls(stiffness, damping, exponent, switching, content[_LAW.size :])
        except (ValueError, struct.error, SettingError):
            raise SettingError("map", f"{text[:16]}...", "is no text of a contact map") from None

    def to_text(self) -> str:
        """The model in base64: the law's four numbers as 64-bit floats, little-endian, and the map."""
        return base64.b64encode(_LAW.pack(*self.parameters) + self.map).decode()

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        """See `ContactModel.parameters`; a loop asks for them with every model."""
        return self.stiffness, self.damping, self.exponent, self.switching

    @property
    def record(self) -> NDArray[np.void]:
        """Its numbers: an array of one `foretouch.models.contact_map.layout.Map`, not to be written."""
        return self._maps

    @property
    def shares(self) -> tuple[float, float, float]:
        """Weights of the law, the coarse map and the fine map in the force; they sum to 1."""
        law, coarse, fine = self._maps[0].shares.tolist()
        return law, coarse, fine

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        """One step: see `foretouch.models.advance`."""
        state = state if len(state) == len(UNTOUCHED) else UNTOUCHED
        return _kernel("advance")(self._maps, state, depth, velocity, sample_period)  # type: ignore[no-any-return]

    def local_slopes(self, state: ContactState, depth: float, velocity: float, reach: float) -> tuple[float, float]:
        """See `ContactModel.local_slopes`."""
        state = state if len(state) == len(UNTOUCHED) else UNTOUCHED
        return _kernel("local_slopes")(self._maps, state, depth, velocity, reach)  # type: ignore[no-any-return]

    def leaving_work(
        self, state: ContactState, depth: float, offset: float = 0.0, largest: float = math.inf
    ) -> tuple[float, float]:
        """See `ContactModel.leaving_work`."""
        state = state if len(state) == len(UNTOUCHED) else UNTOUCHED
        return _kernel("leaving_work")(self._maps, state, depth, offset, largest)  # type: ignore[no-any-return]

    def remember(
        self, state: ContactState, depth: NDArray[np.float64], sample_period: NDArray[np.float64]
    ) -> ContactState:
        """See `ContactModel.remember`."""
        usable = len(state) == len(UNTOUCHED) and all(map(math.isfinite, state))
        memory = np.array(state if usable else UNTOUCHED)
        _compiled("kernel").run(self._maps, memory, depth, sample_period)
        return tuple(memory.tolist())


@cache
def _compiled(name: str) -> ModuleType:
    """A module of compiled code, loaded when it is needed."""
    return import_module(f"foretouch.models.contact_map.{name}")


@cache
def _kernel(name: str) -> Callable[..., Any]:
    return getattr(_compiled("kernel"), name).entry  # type: ignore[no-any-return]


DEPTH_SHARES = (0.25, 0.5, 0.9)  # Fractions of the deepest visited depth at which local stiffness is given
STEP = 0.02  # Half the distance over which it is taken, as a fraction of that depth

PERIOD = 1e-3


@dataclass(frozen=True, slots=True)
class MapSummary:
    """A contact map in a few numbers; depths count from the surface of the model.

    Attributes:
        shares: Weights of the experts ``law``, ``coarse`` and ``fine`` in the force; they sum to 1.
        depth_visited: Greatest depth so far [m].
        speed_visited: Largest speed in contact so far [m/s].
        depths: Depths of the two below [m], a quarter, half and nine tenths of `depth_visited`; empty while no depth
            below the surface was visited.
        forces: Forces of the whole model there, probe and material at rest [N].
        stiffnesses: Local stiffness dF/dx there [N/m].
    """

    shares: dict[str, float]
    depth_visited: float
    speed_visited: float
    depths: tuple[float, ...]
    forces: tuple[float, ...]
    stiffnesses: tuple[float, ...]

    def figures(self, standard_deviation: float | None) -> dict[str, object]:
        """Named figures of the summary for JSON.

        Args:
            standard_deviation: That of the newest force [N], None or NaN where it is not known.
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


def summarise_map(model: ContactMapModel) -> MapSummary:
    r"""Summarise a contact map.

    At depth x, the probe at rest in a material that has come to rest (no velocity, plays and averages at the position
    of the probe), the local stiffness is

    .. math:: \frac{F(x + h) - F(x - h)}{2 h}

    with h a fiftieth of the deepest depth visited. A stiffness k in N/m^s is comparable at one exponent only; this one
    is comparable between all laws.

    Args:
        model: The map.
    """
    learnt = model._maps[0]
    depth = max(float(learnt.reached + learnt.origin), 0.0)
    law, coarse, fine = model.shares
    depths = tuple(weight * depth for weight in DEPTH_SHARES) if depth > 0.0 else ()
    step = STEP * depth
    return MapSummary(
        {"law": law, "coarse": coarse, "fine": fine},
        depth,
        float(learnt.law_speed),
        depths,
        tuple(_at_rest(model, position) for position in depths),
        tuple(
            (_at_rest(model, position + step) - _at_rest(model, position - step)) / (2.0 * step) for position in depths
        ),
    )


def _at_rest(model: ContactMapModel, depth: float) -> float:
    """Force where the probe rests and the memory has settled there [N]."""
    return advance(model, NO_STATE, depth, 0.0, PERIOD)[1]
