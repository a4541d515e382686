"""The sessions of a sweep: each is drawn from its number alone."""

from __future__ import annotations

import dataclasses
import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from foretouch.devices import GRIPS
from foretouch.errors.checks import require
from foretouch.link import network_trace
from foretouch.robot import MATERIALS, make_material
from foretouch.session import SessionSettings
from foretouch.session.operators import SHALLOWEST
from foretouch.settings import FAULTS, SIMULATED

LONGEST_ROUND_TRIP = 5.0  # Largest round trip [s]
CLEAN = "delay only"  # The network with delay only

NETWORKS = {
    CLEAN: 0.36,
    "jitter": 0.09,
    "burst loss": 0.1,
    "reordered": 0.06,
    "doubled": 0.06,
    "stalls": 0.09,
    "outages": 0.09,
    "all at once": 0.15,
}
"""Effects of networks beside delay, and the fraction of sessions that have each."""

LAWS = {"contact-map": 0.85, "continuous-switching": 0.06, "hunt-crossley": 0.05, "kelvin-voigt": 0.04}
"""Laws that are learnt, and the fraction of sessions that have each: a badly learnt one may do no harm either."""

STIFF = ("bone", "kelvin-voigt")
"""Materials whose stiffness or damping is beyond what usual devices carry: what limits them is not the network."""

SHARES = {"device": 0.25, "scales": 0.2, "clutch": 0.15}
"""Fraction of sessions with another device, with scales other than 1, and with a clutch."""

SCALES = (0.25, 4.0)  # Bounds of position and force scale

LONGEST_SPELL = 9.5
"""Longest outage and stall [s]: one begins in every 10 s, and one of 10 s would be no network at all."""

Options = dict[str, str | float | int]


@dataclass(frozen=True)
class Case:
    """One session of a sweep.

    Attributes:
        number: Number of the case, from 0.
        duration: Simulated [s].
        network: Its faults beside the delay: one of `NETWORKS`, or the network that is named.
        options: Differences from the defaults of `SessionSettings`.
        baseline: ``"none"``, or the force that is rendered instead of models: ``"delayed"``, ``"delayed-tdpa"``.
    """

    number: int
    duration: float
    network: str
    options: Options
    baseline: str = "none"

    def settings(self) -> SessionSettings:
        """The settings of the session."""
        return SessionSettings(**self.options, baseline=self.baseline)  # type: ignore[arg-type]

    def rendering(self, baseline: str) -> Case:
        """The same session rendered by another baseline."""
        return dataclasses.replace(self, baseline=baseline)

    @property
    def round_trip(self) -> float:
        """Both delays together, without what else the network does [s]; of one that is named its usual ones."""
        if network := self.options.get("network"):
            return network_trace(str(network)).usual_round_trip
        return float(self.options["position_delay"]) + float(self.options["force_delay"])

    @property
    def command(self) -> str:
        """The command that runs this session again, bit-identical."""
        options = self.options if self.baseline == "none" else self.options | {"baseline": self.baseline}
        words = ["foretouch", "simulate", "--duration", repr(self.duration)]
        for name, value in options.items():
            words += [f"--{name.replace('_', '-')}", str(value)]
        return shlex.join(words)


def draw_case(
    number: int,
    *,
    seed: int = 0,
    duration: float = 30.0,
    robot: str = SIMULATED,
    network: str = "",
    budget: float = 0.0,
    protection: str = "parity",
) -> Case:
    r"""The session with this number.

    Round trip, model rate, network, material and grip are spread evenly over any run of numbers by an additive
    recurrence, :math:`u_n = (u_0 + n a) \bmod 1` with :math:`a_j = \phi^{-j}` and :math:`\phi^{d+1} = \phi + 1` in d
    dimensions: no part of their ranges stays empty, as it may with independent draws. All else is drawn from a
    generator with the seed and the number.

    A tenth of the round trips is 0, half of the others is uniform from 0 to 5 s, the other half uniform in its
    logarithm from 10 ms to 5 s. Where it is long the session is too, by 4 round trips: knowledge of a surface takes
    that long to arrive. Number and seed are 0 or more, the duration [s] is 2 or more, of which whole milliseconds are
    taken; an argument out of range is a SettingError. Another robot changes nothing else of the session; a named
    network takes the place of delay and faults, and each session begins somewhere in it. A budget changes nothing else,
    and neither does a protection.

    References:
        The recurrence: Roberts (2018), The unreasonable effectiveness of quasirandom sequences.
    """
    require("number", number, at_least=0)
    require("seed", seed, at_least=0)
    require("duration", duration, at_least=2.0)
    where = _even(number, seed, 5)
    random = np.random.default_rng([seed, number])
    round_trip = network_trace(network).usual_round_trip if network else _round_trip(where[0])
    faults = _chosen(NETWORKS, where[2])
    lasting = round(duration + 4.0 * round_trip, 3)
    options: Options = {"seed": int(random.integers(2**31))}
    options |= {"material": sorted(MATERIALS)[int(where[3] * len(MATERIALS))], "grip": list(GRIPS)[int(where[4] * 3)]}
    there = _short(round_trip * random.uniform(0.1, 0.9))  # the round trip is split unevenly
    options |= {"position_delay": there, "force_delay": round(round_trip - there, 4)}
    options |= {"model_rate": _short(_log_uniform(where[1], 2.0, 200.0))}
    law = _chosen(LAWS, random.uniform())
    options |= {} if law == SessionSettings().model else {"model": law}
    options |= _faults(random, faults, round_trip)
    options |= _hands(random, lasting, str(options["material"]))
    options |= {} if robot == SIMULATED else {"robot": robot}
    if network:
        options = {name: value for name, value in options.items() if name not in FAULTS}
        start = round(network_trace(network).length * random.uniform(), 3)
        options |= {"position_delay": 0.0, "force_delay": 0.0, "network": network, "network_start": start}
    if budget:
        options |= {"budget": budget} | ({} if protection == "parity" else {"protection": protection})
    return Case(number, lasting, network or faults, options)


def is_clean(network: str, options: Options) -> bool:
    """Whether nothing but delay is in the way: no other fault, and the law that is taken where none is named."""
    return network == CLEAN and "model" not in options


def is_plain(network: str, options: Options) -> bool:
    """Whether it is clean, and the material one that usual devices carry."""
    return is_clean(network, options) and options["material"] not in STIFF


def baseline_numbers(cases: Sequence[Case], count: int) -> list[int]:
    """Numbers of those of all sessions, `count` of them, that the baselines run too.

    Two of three are plain (`is_plain`), as long as there are such: where a curve is to be drawn through them, it is
    drawn through these.
    """
    plain = [case.number for case in cases if is_plain(case.network, case.options)]
    other = [case.number for case in cases if not is_plain(case.network, case.options)]
    from_plain = max(min(len(plain), count - count // 3), count - len(other))
    return sorted(plain[:from_plain] + other[: count - from_plain])


def _even(number: int, seed: int, dimensions: int) -> list[float]:
    """Place of the number in the unit cube."""
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    starts = np.random.default_rng([seed]).uniform(size=dimensions)
    return [(start + (number + 1) * root ** -(j + 1)) % 1.0 for j, start in enumerate(starts.tolist())]


def _chosen(weights: dict[str, float], u: float) -> str:
    """The name at u, from 0 to 1, of names that divide this range by their weights."""
    ends = np.cumsum(list(weights.values()))
    return list(weights)[min(int(np.searchsorted(ends, u * ends[-1], side="right")), len(weights) - 1)]


def _round_trip(u: float) -> float:
    if u < 0.1:
        return 0.0
    if u < 0.55:
        return _log_uniform((u - 0.1) / 0.45, 0.01, LONGEST_ROUND_TRIP)
    return LONGEST_ROUND_TRIP * (u - 0.55) / 0.45


def _log_uniform(u: float, low: float, high: float) -> float:
    return low * math.exp(u * math.log(high / low))


def _short(value: float) -> float:
    """Four digits: the command that repeats the session shall be readable."""
    return float(f"{value:.4g}")


def _faults(random: np.random.Generator, network: str, round_trip: float) -> Options:
    """Faults of the network beside its delay; all at once is each with an even chance."""
    spell = min(round_trip * random.uniform(1.0, 4.0), LONGEST_SPELL)
    burst = _log_uniform(random.uniform(), 2.0, 200.0)
    kinds: dict[str, Options] = {
        "jitter": {"jitter": _short(_log_uniform(random.uniform(), 1e-3, max(0.3 * round_trip, 0.01)))},
        "burst loss": {"loss": _short(random.uniform(0.02, 0.3)), "burst": _short(burst)},
        "reordered": {"reorder": _short(_log_uniform(random.uniform(), 0.01, 0.5))},
        "doubled": {"duplicate": _short(_log_uniform(random.uniform(), 0.01, 0.5))},
        "stalls": {"stall": _short(max(spell, 0.05))},
        "outages": {"outage": _short(_log_uniform(random.uniform(), 0.2, LONGEST_SPELL))},
    }
    taken = random.uniform(size=len(kinds)) < 0.5
    if network != "all at once":
        return kinds.get(network, {})
    return {
        name: value
        for one, options in zip(taken, kinds.values(), strict=True)
        if one
        for name, value in options.items()
    }


def _hands(random: np.random.Generator, duration: float, material: str) -> Options:
    """Device, scales and clutch, where they are not as usual."""
    has = {name: random.uniform() < fraction for name, fraction in SHARES.items()}
    mass, damping = (_short(_log_uniform(random.uniform(), *bounds)) for bounds in ((0.03, 0.6), (0.2, 10.0)))
    friction, resolution = _short(random.uniform(0.0, 0.4)), _short(_log_uniform(random.uniform(), 1e-6, 6e-5))
    scales = [random.uniform(), _log_uniform(random.uniform(), *SCALES)]
    start, length = random.uniform(0.2, 0.6) * duration, random.uniform(0.5, 3.0)
    options: Options = {}
    if has["device"]:
        options |= {"device_mass": mass, "device_damping": damping}
        options |= {"device_friction": friction, "device_resolution": resolution}
    if has["scales"]:
        # No press of the operator is shallower than its least.
        most = min(SCALES[1], 0.99 * make_material(material).press_depth / SHALLOWEST)
        options |= {"position_scale": _short(_log_uniform(scales[0], SCALES[0], most))}
        options |= {"force_scale": _short(scales[1])}
    if has["clutch"]:
        options |= {"clutch": f"{start:.2f}:{start + length:.2f}"}
    return options
