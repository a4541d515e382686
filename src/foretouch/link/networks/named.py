"""Networks by name: measurements of others, fetched from where they were published, and networks as they are known."""

from __future__ import annotations

import functools
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from foretouch.errors import MissingExtraError, UnknownNameError
from foretouch.files.origins import Origin, cache_of, in_data_dir, original
from foretouch.link.networks.reading import read_trace
from foretouch.link.networks.trace import NetworkTrace


@dataclass(frozen=True)
class Published:
    """One run of a measurement that others published.

    Attributes:
        file: Its file name in a folder of the user's.
        folder: Its folder at the origin, below the origin's own.
        original: Its file name there.
        sha256: Checksum of the file.
        about: What was measured.
        last_line: Last line that is taken: behind it nothing was sent for a while. None for all.
    """

    file: str
    folder: str
    sha256: str
    about: str
    original: str = ""
    last_line: int | None = None

    @property
    def source(self) -> str:
        """What was measured, and where."""
        return f"{self.about}; {CICV5G.about}"

    @property
    def licence(self) -> str:
        """Licence, and who is to be named."""
        return CICV5G.licence

    @property
    def here(self) -> bool:
        """Whether its file is in that folder or in the cache."""
        try:
            cached = cache_of(CICV5G) / self.folder / (self.original or self.file)
        except MissingExtraError:
            cached = Path()
        return cached.is_file() or in_data_dir(f"{CICV5G.local_folder}/{self.file}") is not None

    def fetch(self, name: str) -> NetworkTrace:
        """The trace, from a folder that has it, from the cache, or from its origin."""
        there = f"{self.folder}/{self.original or self.file}"
        path = original(CICV5G, self.file, there, f"network {name}", self.sha256)
        trace = read_trace(path, self.last_line)
        return replace(trace, name=name, source=self.source, licence=self.licence)


CICV5G = Origin(
    repository="zxr805/CICV5G",
    commit="ea215aa92c31d835b509abedeba8c01a38be18c6",
    folder="data",
    local_folder="networks",
    licence="CC BY 4.0, X. Zhang and others, doi 10.5281/zenodo.17475688",
    about="echoes over 5G to a car, CICV5G, Tongji University 2024",
)

PUBLISHED_NETWORKS: Final = {
    "5g-urban": Published(
        "urban_n8_v30_run01.txt",
        "Urban road/1-n8/v30",
        "1f6de54da18f8d27cb100e396e1a1b55ac32f7d42f7ae3c76ada57c2e45149e3",
        "private 5G (n8) in a town at 30 km/h",
    ),
    "5g-urban-public": Published(
        "urban_n78_v30_10ms_run01.txt",
        "Urban road/3-Data transmission frequency/10ms/n78/v30",
        "1af3279af29f659ddfd9e74538906dd2d3c6a087fa8a438f42b4c035131fde79",
        "public 5G (n78) in a town at 30 km/h, up to the first gap in the file",
        original="v2v_info-01.txt",
        last_line=4135,
    ),
    "5g-arterial-public": Published(
        "arterial_n78_v80_run01.txt",
        "Arterial road/n78/80",
        "f36c62a92b1a245826c5f1cd80af60155d82076fb0c1cbe57df25ad49a12a37b",
        "public 5G (n78) on an arterial road at 80 km/h",
    ),
    "5g-weak-to-strong": Published(
        "w2s_n8_v30_run01.txt",
        "W2S/n8/V30",
        "86cbedf6a41bf9d4583e13555f1be71c78f2c3b7f558c9a4ff7eca67a38abcca",
        "private 5G (n8) from a weak to a strong signal at 30 km/h",
    ),
    "5g-rural-standing": Published(
        "south_n8_v0_01.txt",
        "Rural and off-road",
        "3824b13b51f7071fead968c5ca75b6ddc76414f2ba2c9d3827179e2f4c208a2a",
        "private 5G (n8) in the country, standing",
    ),
    "5g-rural": Published(
        "south_n8_v10_05.txt",
        "Rural and off-road",
        "740157615747078c08a418d101e4f04cc118858b9550f465b11865a4975f2457",
        "private 5G (n8) in the country at 10 km/h, with stalls of many seconds",
    ),
}
"""Measured networks, by name."""

SATELLITE = 0.3
"""Delay by a geostationary satellite one way [s]. Light takes 0.239 to 0.279 s up and down again (RFC 2488); the rest,
for terminals and the networks on the ground, is assumed."""

INTERVAL, INTERVALS = 15.0, 20
"""Time after which every terminal of Starlink may be given another satellite [s], and how many such are made here."""
LOW_ORBIT = (0.0125, 0.03)  # Range of the delay one way in an interval [s]: round trips of 25 to 60 ms
SHORTEST_SWITCH, LONGEST_SWITCH = 0.07, 0.215  # Range of the stall between two intervals [s]
FRAME = 0.004  # Largest further delay within an interval [s], drawn for each row
ROW = 0.02  # Time between two rows of a network that is made [s]

SOUND, RANGE = 1500.0, 300.0  # Speed of sound in the sea [m/s], and the way [m]
WORD = 0.04  # Time between two messages of one kind by sound [s]


def _constant(name: str, delay: float, source: str, spacing: float = 0.0) -> NetworkTrace:
    """A delay that never changes."""
    time, delays = np.array([0.0, 30.0, 60.0]), np.full(3, delay)
    return NetworkTrace(name, time, delays, one_way=True, spacing=spacing, source=source)


def _geostationary(name: str) -> NetworkTrace:
    return _constant(
        name, SATELLITE, "600 ms round trip: 478 to 558 ms of light by RFC 2488, and terminals and ground as assumed"
    )


def _acoustic(name: str) -> NetworkTrace:
    source = f"sound at {SOUND:g} m/s over {RANGE:g} m; {1.0 / WORD:g} messages of each kind a second, as assumed"
    return _constant(name, RANGE / SOUND, source, WORD)


def _low_orbit(name: str) -> NetworkTrace:
    """Every 15 s another delay, with a stall before it; the same whenever it is made."""
    draw = random.Random(name)
    time = np.arange(0.0, INTERVALS * INTERVAL, ROW)
    levels = np.array([draw.uniform(*LOW_ORBIT) for _ in range(INTERVALS)])
    switches = np.array([draw.uniform(SHORTEST_SWITCH, LONGEST_SWITCH) for _ in range(INTERVALS)])
    which = np.minimum((time / INTERVAL).astype(int), INTERVALS - 1)
    since = time - INTERVAL * which
    frames = np.array([draw.uniform(0.0, FRAME) for _ in time])
    delay = levels[which] + frames + np.maximum(switches[which] - since, 0.0)
    source = (
        "as Starlink: another satellite each 15 s (Tanveer and others, CoNEXT 2023), about 0.2 s of spikes around that "
        "(arXiv 2601.08439); round trips of 25 to 60 ms and stalls of 70 to 215 ms are drawn"
    )
    return NetworkTrace(name, time, delay, one_way=True, source=source)


KNOWN: Final[dict[str, Callable[[str], NetworkTrace]]] = {
    "geostationary": _geostationary,
    "low-orbit": _low_orbit,
    "subsea-acoustic": _acoustic,
}
"""Networks as they are known, by name."""

NETWORK_NAMES = (*PUBLISHED_NETWORKS, *KNOWN)
"""Names of all networks."""


@functools.cache
def _named(name: str) -> NetworkTrace:
    return PUBLISHED_NETWORKS[name].fetch(name) if name in PUBLISHED_NETWORKS else KNOWN[name](name)


def network_trace(name: str) -> NetworkTrace:
    """The trace of a name of `NETWORK_NAMES`, or of a file.

    Raises:
        UnknownNameError: There is no such network, and the text names no file.
        SettingError: The file cannot be read, or is no trace.
        DatasetError: A measured network is neither here nor can be fetched.
        MissingExtraError: To fetch it ``pooch`` is needed.
    """
    if name in NETWORK_NAMES:
        return _named(name)
    if not any(sign in name for sign in "./\\") and not Path(name).exists():
        raise UnknownNameError("network", name, NETWORK_NAMES)
    return read_trace(name)
