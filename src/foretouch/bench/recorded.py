"""Recordings as files: presses in and out of a Hunt-Crossley material, with the offset and the noise of a sensor."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import VERSION, Hello, Telemetry
from foretouch.recordings import SessionWriter, write_columns

Array = NDArray[np.float64]

RATE = 1000.0
SURFACE, HIGHEST, DEEPEST, PRESSES = 0.010, 0.004, 0.006, 0.9
"""Where the material begins, how far the probe goes out and in [m], and presses a second."""

OFFSET, NOISE = 0.5, 0.005
"""Of the force sensor [N]."""

COLUMNS = 3
"""Time, position and force, 8 bytes each a sample."""


def recorded_press(seconds: float, seed: int = 0) -> dict[str, Array]:
    """Columns of a recording at 1 kHz, by the names that files have.

    Args:
        seconds: Its length.
        seed: Of the noise.
    """
    time = np.arange(round(seconds * RATE)) / RATE
    middle, swing = SURFACE + 0.5 * (DEEPEST - HIGHEST), 0.5 * (DEEPEST + HIGHEST)
    position = middle - swing * np.cos(2.0 * np.pi * PRESSES * time)
    velocity = swing * 2.0 * np.pi * PRESSES * np.sin(2.0 * np.pi * PRESSES * time)
    force = np.maximum(np.maximum(position - SURFACE, 0.0) ** 1.4 * (3000.0 + 1500.0 * velocity), 0.0)
    noise = NOISE * np.random.default_rng(seed).standard_normal(time.size)
    return {"time_s": time, "position_m": position, "force_N": force + OFFSET + noise}


def write_recording(path: Path, seconds: float) -> None:
    """Write such a recording as CSV, Parquet or MCAP, whichever the name ends with.

    Args:
        path: The file.
        seconds: Length of the recording.
    """
    columns = recorded_press(seconds)
    if path.suffix == ".mcap":
        _write_session(path, columns)
    else:
        write_columns(path, columns)


def _write_session(path: Path, columns: dict[str, Array]) -> None:
    """As a follower would have said it."""
    with SessionWriter(path) as writer:
        writer.write(Hello(VERSION, 1, 0, "follower", (), ()), 0)
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        for sequence, (time, position, force) in zip(itertools.count(1), rows):
            now = round(time * 1e9)
            said = Telemetry(
                VERSION, sequence, now, 0, position, position, 0.0, force, force - OFFSET, force, True, False, 0, 0, 0
            )
            writer.write(said, now)
