"""Material of a comparison: files, and simulated recordings whose truth is known.

Both are small names that a worker process loads itself. The simulated ones are each law alone, laws that change, taps,
and materials that are no law.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Final, NamedTuple, Unpack

import numpy as np

from foretouch.comparison.truth import Truth
from foretouch.devices import ScriptedOperator
from foretouch.devices.device import minimum_jerk
from foretouch.errors import UnknownNameError
from foretouch.errors.checks import require_path
from foretouch.messages import SessionLog
from foretouch.models import ContactModel, ContinuousSwitching, HuntCrossley, KelvinVoigt, MemorylessLaw, advance
from foretouch.quantities import Array, ByValue, Recording
from foretouch.recordings import RecordingOptions, is_session, read_session, read_with_notes
from foretouch.recordings.meaning.names import ReadingKeywords
from foretouch.recordings.reading import options_of
from foretouch.robot import make_material

SAMPLE_PERIOD: Final = 1e-3  # Time between two samples of a simulated recording [s]
FORCE_NOISE: Final = 0.02  # Standard deviation of the force sensor [N], white
ENCODER_STEP: Final = 5e-6  # Resolution of the positions [m]
FREE_AIR: Final = 1.0  # Time in free air before the first touch [s]
GRADUAL_DURATION: Final = 25.0  # Length of the gradual change, as in Fig. 8 of the paper [s]
CHANGES: Final = (7.0, 15.0)  # The sudden changes of Fig. 7c of the paper, counted from the end of the free air [s]

KELVIN_VOIGT: Final = KelvinVoigt(6000.0, 500.0)
HUNT_CROSSLEY: Final = HuntCrossley(3000.0, 1500.0, 1.4)
BETWEEN: Final = ContinuousSwitching(4500.0, 1000.0, 0.7, 0.5)  # Parameters of the paper's simulations, depth in metres


@dataclass(frozen=True)
class Scenario:
    """A material and the motion that presses it."""

    duration: float  # [s]
    motion: Callable[[Array, float, int], Array]  # position of the probe [m] by time [s], surface [m] and seed
    law: Callable[[float], ContactModel]  # the law that holds at a time [s]
    changes: tuple[float, ...] = ()  # times of its sudden changes [s]


@dataclass(frozen=True, eq=False)
class Simulated(ByValue):
    """A simulated recording and the truth, which its reader does not know.

    Attributes:
        recording: Noisy, without velocity, with an offset; nothing in it says where the surface is.
        truth: The truth behind it.
    """

    recording: Recording
    truth: Truth


def simulate(name: str, *, seed: int = 0) -> Simulated:
    """A simulated recording: 1 kHz, force noise 0.02 N, positions in steps of 5 um, a second in free air first.

    Surface (8 to 15 mm) and force offset (-0.5 to 0.5 N) are drawn; there is no velocity. The same name and seed give
    the same samples.

    Args:
        name: One of `SIMULATED`.
        seed: Seed of surface, offset, noise and of the presses, not negative.

    Raises:
        UnknownNameError: No such recording.
    """
    simulated_case(name)  # refuses what there is not
    scenario = SIMULATED[name]()
    random = np.random.default_rng([seed, zlib.crc32(name.encode())])
    surface, offset = random.uniform(0.008, 0.015), random.uniform(-0.5, 0.5)
    time = np.arange(0.0, scenario.duration, SAMPLE_PERIOD)
    position = scenario.motion(time, surface, seed)
    depth = position - surface
    force = _force(scenario, time, depth)
    last = scenario.law(float(time[-1]))
    recording = Recording(
        time,
        np.round(position / ENCODER_STEP) * ENCODER_STEP,
        force + offset + random.normal(0.0, FORCE_NOISE, time.size),
        name=name,
    )
    return Simulated(
        recording, Truth(depth, force, last if isinstance(last, MemorylessLaw) else None, scenario.changes)
    )


def _force(scenario: Scenario, time: Array, depths: Array) -> Array:
    """True force [N], the law advanced along the true motion."""
    force = np.empty(time.size)
    state = scenario.law(0.0).initial_state()
    samples = zip(time.tolist(), depths.tolist(), np.gradient(depths, time).tolist(), strict=True)
    for index, (now, depth, speed) in enumerate(samples):
        state, force[index], _ = advance(scenario.law(now), state, depth, speed, SAMPLE_PERIOD)
    return force


def _presses(press_depth: float) -> Callable[[Array, float, int], Array]:
    """Presses of a palpating hand, out of contact in between: see `ScriptedOperator`."""

    def motion(time: Array, surface: float, seed: int) -> Array:
        operator = ScriptedOperator(surface, press_depth, seed)
        return np.array([operator.read(round(1e9 * now)) for now in time.tolist()])

    return motion


def _approach(time: Array, surface: float, clearance: float) -> Array:
    """Move from 0 to a position above the surface, smoothly and well within the second of free air."""
    return (surface - clearance) * _ramp(time / 0.6)


def _taps(time: Array, surface: float, seed: int) -> Array:
    """Two and a half taps a second of 3 to 5 mm, out of contact for half of the time."""
    clearance = 0.0005
    since = np.maximum(time - FREE_AIR, 0.0)
    size = 0.004 * (1.0 + 0.25 * np.sin(2.0 * np.pi * 0.3 * since)) * _ramp(since / 0.4)
    return _approach(time, surface, clearance) + size * np.sin(2.0 * np.pi * 2.5 * since)


def _palpation(time: Array, surface: float, seed: int) -> Array:
    """Once in contact, always in contact, 2 to 14 mm deep: changes of the law are then felt at once."""
    clearance = 0.002
    since = np.maximum(time - FREE_AIR, 0.0)
    waves = 0.0035 * np.sin(2.0 * np.pi * 0.9 * since) + 0.0025 * np.sin(2.0 * np.pi * 0.37 * since)
    return _approach(time, surface, clearance) + (0.008 + clearance) * _ramp(since / 0.6) + waves * _ramp(since / 0.6)


def _ramp(fraction: Array) -> Array:
    return np.array([minimum_jerk(value) for value in fraction.tolist()])


def gradual_law(time: float) -> ContinuousSwitching:
    """Law of the change from Hunt-Crossley to Kelvin-Voigt in 25 s, as in Fig. 8 of the paper, after a time [s].

    n = 1.4 - 0.056 t as printed, written so that it ends at 0 and not at a rounding error below it.
    """
    part = time / GRADUAL_DURATION
    return ContinuousSwitching(3000.0 + 120.0 * time, 1500.0 - 40.0 * time, 1.4 * (1.0 - part), part)


def _gradual(time: float) -> ContactModel:
    return gradual_law(min(max(time - FREE_AIR, 0.0), GRADUAL_DURATION))


def _sudden(time: float) -> ContactModel:
    """Change from Hunt-Crossley to Kelvin-Voigt in two steps, as in Fig. 7c of the paper."""
    return (HUNT_CROSSLEY, BETWEEN, KELVIN_VOIGT)[sum(time >= FREE_AIR + change for change in CHANGES)]


def _material(name: str) -> Callable[[], Scenario]:
    def scenario() -> Scenario:
        material = make_material(name)
        return Scenario(15.0, _presses(material.press_depth), lambda time: material.model)

    return scenario


SIMULATED: Final[dict[str, Callable[[], Scenario]]] = {
    "kelvin-voigt": lambda: Scenario(12.0, _presses(0.010), lambda time: KELVIN_VOIGT),
    "hunt-crossley": lambda: Scenario(12.0, _presses(0.015), lambda time: HUNT_CROSSLEY),
    "continuous-switching": lambda: Scenario(12.0, _presses(0.012), lambda time: BETWEEN),
    "gradual-change": lambda: Scenario(FREE_AIR + GRADUAL_DURATION, _palpation, _gradual),
    "sudden-change": lambda: Scenario(
        FREE_AIR + 22.0, _palpation, _sudden, tuple(FREE_AIR + change for change in CHANGES)
    ),
    "tapping": lambda: Scenario(10.0, _taps, lambda time: HUNT_CROSSLEY),
    "sponge": _material("sponge"),
    "foam": _material("foam"),
    "hand": _material("hand"),
}
"""The simulated recordings by name."""


@dataclass(frozen=True)
class Case:
    """One recording to compare on.

    Attributes:
        name: For tables: the file as it was given, or the name of the simulated recording.
        path: Path of the file, absolute, for a worker may run elsewhere; empty where it is simulated.
        simulated: Whether it is simulated, with known truth.
        seed: Seed of a simulated one.
        options: Options for reading the file; a map of its columns or topics by its absolute path.
        changed_ns: Time of the last change of the file, so that a worker does not take an old one for it.
    """

    name: str
    path: str = ""
    simulated: bool = False
    seed: int = 0
    options: RecordingOptions = field(default_factory=RecordingOptions)
    changed_ns: int = 0

    @property
    def score_from(self) -> float:
        """Start of scoring where none is given [s]."""
        return 3.0 if self.simulated else 1.5


class Loaded(NamedTuple):
    """A case in memory."""

    recording: Recording  # recording of the follower
    truth: Truth | None = None  # the truth, where it is known
    log: SessionLog | None = None  # log of a file that holds a session: the prediction is then on the leader's motion


def file_case(
    path: str | PathLike[str], options: RecordingOptions | None = None, **named: Unpack[ReadingKeywords]
) -> Case:
    """A recording in a file; options, or named attributes of them, are for reading it, as `read_recording` takes them.

    Also where the file is missing or cannot be read there is a case: its combinations fail with that reason. An
    UnknownNameError says that a unit or force channel is not known, an ArgumentTypeError that a path or unit is none.
    """
    require_path("path", path)
    options = options_of(options, named)
    files = [Path(path)]
    if options.map_file is not None:
        files.append(Path(options.map_file))
        options = replace(options, map_file=os.path.abspath(options.map_file))
    changed = max(file.stat().st_mtime_ns if file.exists() else 0 for file in files)
    return Case(str(path), path=os.path.abspath(path), options=options, changed_ns=changed)


def simulated_case(name: str, seed: int = 0) -> Case:
    """A simulated recording, by its name in `SIMULATED`, of a seed as of `simulate`, with whose errors.

    Everything that was chosen on simulated recordings was chosen on seed 0.
    """
    if name not in SIMULATED:
        raise UnknownNameError("simulated recording", name, SIMULATED)
    return Case(name, simulated=True, seed=seed)


def simulated_cases(seed: int = 0) -> list[Case]:
    """All simulated recordings, of one seed."""
    return [simulated_case(name, seed) for name in SIMULATED]


@lru_cache(maxsize=2)
def load(case: Case) -> Loaded:
    """The recording of a case, or a ForetouchError where its file cannot be used.

    The newest two are kept, for a worker is given all estimators of one recording in turn.
    """
    if case.simulated:
        made = simulate(case.name, seed=case.seed)
        return Loaded(made.recording, made.truth)
    read = read_with_notes(case.path, case.options)
    log = read_session(case.path) if case.options.map_file is None and is_session(case.path) else None
    return Loaded(read.recording, log=log)
