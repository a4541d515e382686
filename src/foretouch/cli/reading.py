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
        """The file.

        Raises:
            SettingError: None is given, or two are.
            UnknownNameError: No measured recording has that name.
        """
        from foretouch.recordings import excerpt

        if self.dataset is None:
            if self.recording is None:
                wanted = "give a file, or --dataset with a name of `foretouch datasets list`"
                raise SettingError("RECORDING", "nothing", wanted)
            return self.recording
        if self.recording is not None:
            raise SettingError("dataset", self.dataset, f"{self.recording} is given too: give one of them")
        return excerpt(self.dataset)


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
