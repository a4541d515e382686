"""Reads the skin indentations measured with an Aurora dual-mode motor (``.ddf``, text, volts at 2 kHz)."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.quantities import Recording

__all__ = ["AURORA_CONTACT_FLOOR", "read_aurora"]

AURORA_CONTACT_FLOOR = 0.005
"""Smallest force [N] that counts as contact."""


def read_aurora(path: str | PathLike[str], *, flip: bool = False) -> Recording:
    """A whole ``.ddf`` file: length (channel AI0) and force (AI1), scaled as the file's header says.

    The length grows as the tip goes into the skin, and the force is positive under compression. The press is at 0.5 to
    1.6 s; outside it the motor's force control chatters off contact, so score from 0.5 to 1.6.

    Raises:
        RecordingError: The file is no such recording, or a row of it holds no numbers.
    """
    lines = Path(path).read_text(encoding="latin-1").split("\n")
    header = next((index for index, line in enumerate(lines) if line.startswith("Sample\tAI0\tAI1\t")), None)
    if header is None or not lines[0].startswith("DMC"):
        raise RecordingError(path, "is no Aurora recording (no line of columns 'Sample, AI0, AI1, ...')")
    rate = _header_values(path, lines[:header], "Sample Frequency (Hz):", " ")[0]
    scale = _header_values(path, lines[:header], "Scale (units/V)", "\t")
    offset = _header_values(path, lines[:header], "Offset (volts)", "\t")
    if not any(line.startswith("Units\tmm\tmN\t") for line in lines[:header]) or rate <= 0:
        raise RecordingError(path, "channels AI0 and AI1 are not length in mm and force in mN")
    volts = _rows(path, lines, header + 1)
    length = (volts[:, 1] - offset[0]) * scale[0] / (-1e3 if flip else 1e3)
    force = (volts[:, 2] - offset[1]) * scale[1] / 1e3
    return Recording(
        volts[:, 0] / rate, length, force, name=str(path), contact_floor=AURORA_CONTACT_FLOOR, first_row=header + 2
    )


def _header_values(path: object, header: list[str], label: str, separator: str) -> list[float]:
    for line in header:
        if line.startswith(label):
            try:
                return [float(value) for value in line[len(label) :].strip().split(separator)]
            except ValueError:
                break
    raise RecordingError(path, f"has no numbers for {label!r} in its header")


def _rows(path: object, lines: list[str], first: int) -> NDArray[np.float64]:
    """Sample number, AI0 and AI1 of every line."""
    rows = []
    for number, line in enumerate(lines[first:], first + 1):
        if not line.strip():
            continue
        cells = line.split("\t", 3)[:3]
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError:
            rows.append([])
        if len(rows[-1]) != 3:
            raise RecordingError(path, "does not hold sample number, AI0 and AI1 as numbers", row=number)
    return np.array(rows).reshape(-1, 3)
