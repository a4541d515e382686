"""How commands read recordings: by which options, and what was guessed, joined or left out, in one line each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import say
from foretouch.cli.progress import pulsing
from foretouch.errors import ForetouchError, SettingError

if TYPE_CHECKING:
    from foretouch.messages import SessionLog
    from foretouch.quantities import Recording
    from foretouch.recordings import RecordingOptions

RECORDING_HELP = "CSV, Parquet, HDF5, MAT, MCAP, a rosbag2 folder, TU/e .mat or Aurora .ddf."


def recording_options(
    position_unit: Annotated[
        str | None, typer.Option(help="Unit of positions, where the file states none: m, cm, mm or um; position_m: m.")
    ] = None,
    force_unit: Annotated[
        str | None, typer.Option(help="Unit of forces, where the file states none: N, mN, cN or kN; force_N: N.")
    ] = None,
    flip: Annotated[bool, typer.Option("--flip", help="Positions in the file shrink with depth.")] = False,
    flip_force: Annotated[
        bool, typer.Option("--flip-force", help="Forces in the file are negative under load.")
    ] = False,
    force_channel: Annotated[str, typer.Option(help="Force of a TU/e file: raw bridge or logged torque.")] = "raw",
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map", help="TOML that says which column or topic is what, in which unit: `foretouch recordings inspect`."
        ),
    ] = None,
) -> RecordingOptions:
    """How a recording is to be read, from the options of a command."""
    from foretouch.recordings import RecordingOptions

    return RecordingOptions(position_unit, force_unit, flip, flip_force, force_channel, map_file)


@dataclass(frozen=True)
class Source:
    """The recording that a command works on: a file, or a measured recording by its name."""

    recording: Annotated[Path | None, typer.Argument(help=RECORDING_HELP)] = None
    dataset: Annotated[
        str | None,
        typer.Option(
            "--dataset", help="Instead of a file a measured recording that is here: `foretouch datasets list`."
        ),
    ] = None

    @property
    def name(self) -> str:
        """For people."""
        return self.dataset or str(self.recording)

    def path(self) -> Path:
        """The file; a SettingError says that none is given, or two are, an UnknownNameError that none has the name."""
        from foretouch.recordings import excerpt

        if self.dataset is None:
            if self.recording is None:
                wanted = "give a file, or --dataset with a name of `foretouch datasets list`"
                raise SettingError("RECORDING", "nothing", wanted)
            return self.recording
        if self.recording is not None:
            raise SettingError("dataset", self.dataset, f"{self.recording} is given too: give one of them")
        return excerpt(self.dataset)


@dataclass(frozen=True)
class Scored:
    """Which part of a recording is scored; the recording says what is not given."""

    score_from: Annotated[
        float | None, typer.Option(help="Scoring begins [s after the first sample]: 1.5, simulated recordings 3.")
    ] = None
    score_to: Annotated[float | None, typer.Option(help="Scoring ends [s after the first sample].")] = None
    contact_floor: Annotated[
        float | None, typer.Option(help="Least force that counts as contact [N]; TU/e 0.3, Aurora 0.005, others 0.05.")
    ] = None


def read_and_say(path: Path, options: RecordingOptions) -> Recording:
    """A recording as `foretouch.recordings.read_recording` reads it, and its notes on the error stream."""
    from foretouch.recordings import read_with_notes

    read = pulsing(f"reading {path.name}", read_with_notes, path, options)
    for note in read.notes:
        say(f"{path}: {note}")
    return read.recording


def say_how_it_is_read(path: Path, options: RecordingOptions) -> None:
    """The same notes where other code reads the recording; none where it is unreadable, which that code reports."""
    from foretouch.recordings import is_session

    if path.suffix.lower() == ".ddf" or (options.map_file is None and is_session(path)):
        return
    try:
        read_and_say(path, options)
    except ForetouchError:
        return


def say_what_is_left_out(path: Path, log: SessionLog | None = None) -> None:
    """One line on each thing that is left out of a session's recording by those who learn from it; else nothing."""
    from foretouch.recordings import follower_samples, is_session, read_follower_samples
    from foretouch.report import left_out

    if not is_session(path):
        return
    say_if_cut(path)
    for sentence in left_out(read_follower_samples(path) if log is None else follower_samples(log)):
        say(f"{path}: {sentence}")


def say_if_cut(path: Path, log: SessionLog | None = None) -> None:
    """One line on a session's recording that was read and ends before its session did: what can be done about it."""
    from foretouch.recordings import is_whole

    if path.suffix.lower() != ".mcap":
        return
    if not is_whole(path):
        mend = f"`foretouch recordings repair {path}` makes it whole"
        say(f"{path}: was not ended by its recorder; read as far as it goes; {mend}")
    elif log is not None and log.counts.get("truncated"):
        say(f"{path}: ends before its session did")
