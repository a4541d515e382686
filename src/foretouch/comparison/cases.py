"""What is compared on: a file, or a simulated recording; both are small names that a worker process loads itself."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from foretouch.comparison.simulated import SIMULATED, simulate
from foretouch.comparison.truth import Truth
from foretouch.errors import UnknownNameError
from foretouch.messages import SessionLog
from foretouch.models.checks import require_path
from foretouch.quantities import Recording
from foretouch.recordings import is_session, read_session, read_with_notes

__all__ = ["Case", "Loaded", "file_case", "load", "simulated_case", "simulated_cases"]


@dataclass(frozen=True)
class Case:
    """One recording to compare on.

    Attributes:
        name: For tables: the file as it was given, or the name of the simulated recording.
        path: Of the file, absolute, for a worker may run elsewhere; empty where it is simulated.
        simulated: Whether it is simulated, with known truth.
        seed: Of a simulated one.
        position_unit: Of the file, as `read_recording`.
        force_unit: Of the file.
        flip: Of the file.
        flip_force: Of the file.
        force_channel: Of the file.
        map_file: Map of its columns or topics, absolute, empty for none.
        changed_ns: When the file was changed last, so that a worker does not take an old one for it.
    """

    name: str
    path: str = ""
    simulated: bool = False
    seed: int = 0
    position_unit: str | None = None
    force_unit: str | None = None
    flip: bool = False
    flip_force: bool = False
    force_channel: str = "raw"
    map_file: str = ""
    changed_ns: int = 0

    @property
    def score_from(self) -> float:
        """When scoring begins if nothing else is asked for [s]."""
        return 3.0 if self.simulated else 1.5


class Loaded(NamedTuple):
    """A case in memory.

    Attributes:
        recording: What the follower felt.
        truth: Where it is known.
        log: Of a file that holds a session: the prediction is then made on the leader's motion.
    """

    recording: Recording
    truth: Truth | None = None
    log: SessionLog | None = None


def file_case(path: str | PathLike[str], **units: Any) -> Case:
    """A recording in a file.

    Args:
        path: Any that `read_recording` takes.
        **units: As `read_recording` takes them.

    Returns:
        A case, also where the file is missing or cannot be read: its combinations fail with that reason.

    Raises:
        ArgumentTypeError: A path that is none.
    """
    require_path("path", path)
    given = units.pop("map_file", None)
    if given is not None:
        require_path("map_file", given)
    files = [Path(path), *([Path(given)] if given else [])]
    changed = max(file.stat().st_mtime_ns if file.exists() else 0 for file in files)
    map_file = os.path.abspath(given) if given else ""
    return Case(str(path), path=os.path.abspath(path), map_file=map_file, changed_ns=changed, **units)


def simulated_case(name: str, seed: int = 0) -> Case:
    """A simulated recording.

    Args:
        name: One of `SIMULATED`.
        seed: As of `simulate`; everything that was chosen on simulated recordings was chosen on seed 0.

    Raises:
        UnknownNameError: No such recording.
    """
    if name not in SIMULATED:
        raise UnknownNameError("simulated recording", name, SIMULATED)
    return Case(name, simulated=True, seed=seed)


def simulated_cases(seed: int = 0) -> list[Case]:
    """All simulated recordings, of one seed."""
    return [simulated_case(name, seed) for name in SIMULATED]


@lru_cache(maxsize=2)
def load(case: Case) -> Loaded:
    """The recording of a case; the newest two are kept, for a worker is given all estimators of one recording in turn.

    Raises:
        ForetouchError: The file cannot be used.
    """
    if case.simulated:
        made = simulate(case.name, seed=case.seed)
        return Loaded(made.recording, made.truth)
    read = read_with_notes(
        case.path,
        position_unit=case.position_unit,
        force_unit=case.force_unit,
        flip=case.flip,
        flip_force=case.flip_force,
        force_channel=case.force_channel,
        map_file=case.map_file or None,
    )
    log = read_session(case.path) if not case.map_file and is_session(case.path) else None
    return Loaded(read.recording, log=log)
