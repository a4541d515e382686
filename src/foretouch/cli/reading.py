"""How commands read recordings: what was guessed, joined or left out is said in one line each."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import say
from foretouch.cli.progress import pulsing

if TYPE_CHECKING:
    from foretouch.quantities import Recording

RECORDING_HELP = "CSV, Parquet, HDF5, MAT, MCAP, a rosbag2 folder, TU/e .mat or Aurora .ddf."

MapFile = Annotated[
    Path | None,
    typer.Option(
        "--map", help="TOML that says which column or topic is what, in which unit: `foretouch recordings inspect`."
    ),
]

DatasetName = Annotated[
    str | None,
    typer.Option("--dataset", help="Instead of a file a measured recording that is here: `foretouch datasets list`."),
]


def chosen_recording(path: Path | None, dataset: str | None) -> tuple[Path, str]:
    """The recording that a command works on, and its name for people.

    Raises:
        SettingError: None is given, or two are.
        UnknownNameError: No measured recording has that name.
    """
    from foretouch.errors import SettingError
    from foretouch.recordings import excerpt

    if path is not None and dataset is not None:
        raise SettingError("dataset", dataset, f"{path} is given too: give one of them")
    if path is not None:
        return path, str(path)
    if dataset is None:
        raise SettingError("RECORDING", "nothing", "give a file, or --dataset with a name of `foretouch datasets list`")
    return excerpt(dataset), dataset


def read_and_say(
    path: Path,
    *,
    position_unit: str | None = None,
    force_unit: str | None = None,
    flip: bool = False,
    flip_force: bool = False,
    force_channel: str = "raw",
    map_file: Path | None = None,
) -> Recording:
    """A recording as `foretouch.recordings.read_recording` reads it, and its notes on the error stream."""
    from foretouch.recordings import read_with_notes

    read = pulsing(
        f"reading {path.name}",
        read_with_notes,
        path,
        position_unit=position_unit,
        force_unit=force_unit,
        flip=flip,
        flip_force=flip_force,
        force_channel=force_channel,
        map_file=map_file,
    )
    for note in read.notes:
        say(f"{path}: {note}")
    return read.recording


def say_how_it_is_read(
    path: Path,
    *,
    position_unit: str | None,
    force_unit: str | None,
    flip: bool,
    flip_force: bool,
    force_channel: str,
    map_file: Path | None,
) -> None:
    """The same notes where others read the recording; nothing where it cannot be read, for they say why."""
    from foretouch.errors import ForetouchError
    from foretouch.recordings import is_session

    if path.suffix.lower() == ".ddf" or (map_file is None and is_session(path)):
        return
    try:
        read_and_say(
            path,
            position_unit=position_unit,
            force_unit=force_unit,
            flip=flip,
            flip_force=flip_force,
            force_channel=force_channel,
            map_file=map_file,
        )
    except ForetouchError:
        return
