"""Reads and writes the TOML file of a sensor's calibration."""

from __future__ import annotations

from os import PathLike

import msgspec

from foretouch.files import read_toml
from foretouch.quantities import SensorCalibration
from foretouch.recordings.output import atomic_path

__all__ = ["read_calibration", "write_calibration"]


def read_calibration(path: str | PathLike[str]) -> SensorCalibration:
    """A calibration from its file; an unknown key is an error.

    Raises:
        RecordingError: The file cannot be read, or is no calibration.
    """
    return read_toml(path, SensorCalibration, "sensor calibration")


def write_calibration(path: str | PathLike[str], calibration: SensorCalibration) -> None:
    """Write a calibration: one line a number, SI units; what is not known is left out.

    Raises:
        RecordingError: The file cannot be written.
    """
    known = {name: value for name, value in msgspec.structs.asdict(calibration).items() if value is not None}
    # repr gives the shortest decimals that read back as the same float, in a form that TOML has too
    lines = [f"{name} = {list(value) if isinstance(value, tuple) else value!r}" for name, value in known.items()]
    text = "\n".join(["# Sensor calibration, SI units, vectors in the sensor's frame: foretouch calibrate", *lines, ""])
    with atomic_path(path) as part:
        part.write_text(text, encoding="utf-8")
