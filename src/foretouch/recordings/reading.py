"""Reads a recording, whatever its format: it is opened by the ending of its name, and read by what its columns mean."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Final, NamedTuple, Unpack

import numpy as np

from foretouch.errors import RecordingError, RecordingWarning
from foretouch.errors.checks import require_path
from foretouch.files import within_budget
from foretouch.quantities import Recording
from foretouch.recordings.formats.arrays import Hdf5Table, open_mat
from foretouch.recordings.formats.bags import Rosbag2
from foretouch.recordings.formats.mcap import McapFile
from foretouch.recordings.formats.published import is_tue, read_aurora, read_tue, recording_of
from foretouch.recordings.formats.tables import CsvTable, ParquetTable
from foretouch.recordings.formats.topics import TOPICS
from foretouch.recordings.meaning.guess import HELP, guess_mapping
from foretouch.recordings.meaning.mapped import read_mapped
from foretouch.recordings.meaning.mapping import Mapping, Signal, TimeSource, Velocity, mapping_text, read_mapping
from foretouch.recordings.meaning.names import REQUIRED, VELOCITY_KEY, ReadingKeywords, RecordingOptions, name_says
from foretouch.recordings.session.reader import read_follower
from foretouch.recordings.source import Bag, Table, reading, require_names

OPENERS: Final[dict[str, Callable[[str | PathLike[str]], Table | Bag]]] = {
    ".csv": CsvTable,
    ".parquet": ParquetTable,
    ".mat": open_mat,
    ".h5": Hdf5Table,
    ".hdf5": Hdf5Table,
    ".mcap": McapFile,
    ".db3": Rosbag2,
}
"""Readers by file ending; a folder is a rosbag2."""

SUFFIXES: Final = (".csv", ".parquet", ".mat", ".ddf", ".npz", ".mcap", ".h5", ".hdf5", ".db3")
"""Endings of the files that can be read; a folder is read as a rosbag2."""


def require_readable(path: str | PathLike[str]) -> str:
    """The ending of a recording that is there, empty for a folder."""
    file, suffix = Path(path), Path(path).suffix.lower()
    if file.is_dir() and (suffix not in SUFFIXES or (file / "metadata.yaml").is_file()):
        return ""
    if suffix not in SUFFIXES:
        problem = f"cannot be read: its name must end with one of {', '.join(SUFFIXES)}"
        raise RecordingError(path, f"{problem}, or be a rosbag2 folder")
    if not file.is_file():
        raise RecordingError(path, "is no file" if file.exists() else "no such file")
    return suffix


def open_source(path: str | PathLike[str]) -> Table | Bag:
    """An opened table or bag.

    Raises:
        RecordingError: It cannot be read, or is no format with columns or topics.
        MissingExtraError: The format needs a package of the extra ``recordings``.
    """
    suffix = require_readable(path)
    if suffix in (".ddf", ".npz"):
        what = "an Aurora .ddf file" if suffix == ".ddf" else "an excerpt of a measured recording"
        raise RecordingError(path, f"{what} has no columns to map: leave --map out")
    with reading(path):
        return OPENERS[suffix](path) if suffix else Rosbag2(path)


SHORTEST_STEP, LONGEST_STEP = 2e-5, 0.2  # steps of a recording of presses lie between these [s]


class Read(NamedTuple):
    """A recording and how it was read.

    Attributes:
        recording: The recording.
        notes: Sentences for people: a map that was guessed, clocks, samples that were left out.
        mapping: Map that it was read by, None for formats that state their own.
    """

    recording: Recording
    notes: tuple[str, ...]
    mapping: Mapping | None


def read_recording(
    path: str | PathLike[str],
    options: RecordingOptions | None = None,
    *,
    budget: float | None = None,
    **named: Unpack[ReadingKeywords],
) -> Recording:
    """Recording from a file; its ending gives the format.

    What was guessed, and what looks wrong (signs, clocks), is a `foretouch.errors.RecordingWarning`; a map that is
    given leaves nothing to guess, and `read_with_notes` returns the sentences.

    - ``.csv``, ``.parquet``: columns ``time_s``, ``position_m``, ``force_N`` and perhaps ``velocity_m_s``, or others
      that a map or their own names identify.
    - ``.mat``: a TU/e teleoperation recording, or any variables by a map. ``.ddf``: an Aurora skin indentation.
    - ``.npz``: an excerpt of these, which the package carries: `foretouch.recordings.excerpt`.
    - ``.h5``, ``.hdf5``: datasets.
    - ``.mcap``: a session of foretouch, the follower's position and sensor force; or any ROS 2 messages.
    - a folder, or ``.db3``: a rosbag2.

    Args:
        path: The file.
        options: How it is to be read, where the file does not say so by itself.
        budget: How many times the usual memory and time its reading may take, which is done in a separate process
            (`foretouch.files.budget_for`); without it, the environment variable ``FORETOUCH_FILE_BUDGET`` is used.
        **named: In place of `options`, its attributes by name: ``position_unit``, ``force_unit``, ``flip``,
            ``flip_force``, ``force_channel`` and ``map_file``, as `foretouch.recordings.RecordingOptions` has them.

    Raises:
        RecordingError: The file cannot be used, or is over the budget; the message names file, row and rule.
        UnknownNameError: A unit or force channel that is not known.
        ArgumentTypeError: A path or a unit that is none.
        TypeError: Options are given as one object and by name too.
        MissingExtraError: The format needs a package of the extra ``recordings``.
    """
    read = read_with_notes(path, options, budget=budget, **named)
    for note in read.notes:
        warnings.warn(f"{path}: {note}", RecordingWarning, stacklevel=2)
    return read.recording


def read_with_notes(
    path: str | PathLike[str],
    options: RecordingOptions | None = None,
    *,
    budget: float | None = None,
    **named: Unpack[ReadingKeywords],
) -> Read:
    """The same with sentences on how: see `read_recording`, whose errors it raises."""
    require_path("path", path)
    options = options_of(options, named)
    suffix = require_readable(path)
    if suffix not in (".mat", ".npz") and options.force_channel != "raw":
        raise RecordingError(path, "only a TU/e recording has another --force-channel: leave it out")
    if options.map_file is None:
        return within_budget(path, budget, _by_itself, path, suffix, options)
    if replace(options, map_file=None) != RecordingOptions():
        given = "--position-unit, --force-unit, --flip, --flip-force"
        raise RecordingError(options.map_file, f"a map states units and signs: leave {given} out")
    return within_budget(path, budget, _by_given_map, path, read_mapping(options.map_file))


def options_of(options: RecordingOptions | None, named: ReadingKeywords) -> RecordingOptions:
    """The options, given as one object or by name; a TypeError where it is both."""
    if options is None:
        return RecordingOptions(**named)
    if named:
        raise TypeError(f"options are given, and {', '.join(named)} beside them: give all in one way")
    return options


def is_session(path: str | PathLike[str]) -> bool:
    """Whether a file is a recorded session of foretouch, or what is left of one; False for all that is not read."""
    file = Path(path)
    if file.suffix.lower() != ".mcap" or not file.is_file():
        return False
    if file.stat().st_size < 64:
        return True  # cut off before anything was flushed, as the reader of sessions reports
    try:
        return within_budget(path, None, _has_our_topics, path)
    except RecordingError:
        return True  # damaged: that reader reports where


def _has_our_topics(path: str | PathLike[str]) -> bool:
    topics = McapFile(path, peek=True).topics
    ours = {topic.name for topic in TOPICS.values()}
    return not topics or any(topic.name in ours and topic.type_name.startswith("foretouch_msgs/") for topic in topics)


def _by_given_map(path: str | PathLike[str], mapping: Mapping) -> Read:
    return _by_map(open_source(path), mapping)


def _by_itself(path: str | PathLike[str], suffix: str, options: RecordingOptions) -> Read:
    stated = _stated(path, suffix, options.force_channel)
    if stated is not None:
        if options.position_unit or options.force_unit:
            problem = f"a {suffix} file states its own units: leave --position-unit and --force-unit out"
            raise RecordingError(path, problem)
        recording = stated()
        flips = {"position": options.flip, "force": options.flip_force}
        turned = {name: -getattr(recording, name) for name, flip in flips.items() if flip}
        return Read(replace(recording, **turned) if turned else recording, (), None)
    source = open_source(path)
    if options.force_channel != "raw":
        raise RecordingError(path, "only a TU/e recording has another --force-channel: leave it out")
    columns = source.columns if isinstance(source, Table) and suffix in (".csv", ".parquet") else ()
    names = [column.name for column in columns]
    if set(REQUIRED) <= set(names) and not source.stated_map and not any(column.unit for column in columns):
        return _by_map(source, _by_names(names, options), guessed=False)
    guess = guess_mapping(source)
    missing = guess.problems and not any(guess.candidates.values())
    if missing and set(REQUIRED) & set(names):  # where one column has such a name, the others were meant too
        require_names(path, names, REQUIRED, row=1)
    mapping = guess.in_units(options).mapping()
    read = _by_map(source, mapping, guessed=not source.stated_map)
    return read._replace(notes=(*read.notes, *guess.notes))


def _stated(path: str | PathLike[str], suffix: str, force_channel: str) -> Callable[[], Recording] | None:
    """How a file is read that states columns and units itself; None for any other."""
    if suffix == ".npz":
        return partial(recording_of, path, force_channel)
    if suffix == ".mat" and is_tue(path):
        return partial(read_tue, path, force_channel)
    if suffix == ".ddf":
        return partial(read_aurora, path)
    return partial(read_follower, path) if suffix == ".mcap" and is_session(path) else None


def _by_names(names: list[str], options: RecordingOptions) -> Mapping:
    return Mapping(
        Signal(column="position_m", unit=options.position_unit or "m", sign=-1 if options.flip else 1),
        Signal(column="force_N", unit=options.force_unit or "N", sign=-1 if options.flip_force else 1),
        TimeSource(column="time_s"),
        Velocity(column=VELOCITY_KEY) if VELOCITY_KEY in names else None,
    )


def _by_map(source: Table | Bag, mapping: Mapping, *, guessed: bool = False) -> Read:
    recording, notes = read_mapped(source, mapping)
    if guessed and isinstance(source, Table):
        _require_likely_times(source, mapping, recording)
    if guessed:
        text = " ".join(mapping_text(mapping).replace("\n", "; ").replace("; ; ", " ").replace("]; ", "] ").split())
        notes.insert(0, f"columns guessed: {text.strip('; ')}")
    if isinstance(source, Table):
        notes += source.notes
    elif not source.whole:
        notes.insert(0, "was not ended by its recorder; read as far as it goes")
    _give_back()
    return Read(recording, tuple(notes), mapping)


def _require_likely_times(table: Table, mapping: Mapping, recording: Recording) -> None:
    """Refuse times of unstated unit that as seconds have steps that no recording of presses has."""
    stated = next((column.unit for column in table.columns if column.name == mapping.time.column), "")
    if not mapping.time.column or mapping.time.unit != "s" or name_says(mapping.time.column, stated).unit:
        return
    step = float(np.median(np.diff(recording.time)))
    if not SHORTEST_STEP <= step <= LONGEST_STEP:
        problem = f"time {mapping.time.column} states no unit, and in seconds its steps are {step:.3g} s; {HELP}"
        raise RecordingError(table.path, problem)


def _give_back() -> None:
    """Give back what reading took: pyarrow keeps twice a table's size for a next one."""
    pyarrow = sys.modules.get("pyarrow")
    if pyarrow is not None:
        pyarrow.default_memory_pool().release_unused()
