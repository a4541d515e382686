"""Writes files of the two formats that the measured recordings were published in, with known content."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

Array = NDArray[np.float64]

LEVER = 0.075
"""Of a TU/e lever [m]."""

COLUMNS = "\t".join(["Sample", *(f"AI{channel}" for channel in range(8)), "AO0", "AO1", "Stim"])


class Signals(NamedTuple):
    """What a TU/e file holds: angles [rad] and torques [N m] of leader and follower, and the force bridge [V]."""

    time: Array
    angles: Array
    torques: Array
    bridge: Array


def signals(count: int = 2000) -> Signals:
    """A follower that follows its leader, and a force that its low-pass shows late."""
    time = 12.5 + np.arange(count) / 2000.0
    leader = 0.1 * np.sin(2.0 * np.pi * time)
    follower = 0.95 * np.roll(leader, 3)
    torque = 2.0 * np.maximum(follower, 0.0)
    return Signals(time, np.stack((leader, follower), 1), np.stack((-torque, np.roll(torque, 6)), 1), 2.3 + torque)


def write_tue(path: Path, held: Signals) -> Path:
    """A ``.mat`` with the structures of the experiment."""
    scope = _structures(held.angles, held.torques, held.torques)
    bridges = _structures(held.bridge, held.bridge, held.bridge)
    savemat(
        path, {"scope": {"time": held.time, "signals": scope}, "env_est3": {"signals": bridges}}, do_compression=True
    )
    return path


def write_aurora(path: Path, volts: Array) -> Path:
    """A ``.ddf`` with these volts of length and force, shape (n, 2)."""
    zeros = "\t".join(["0.000000"] * 8)
    head = [
        "DMCv5.3 Data File",
        "Sample Frequency (Hz): 2000",
        "Calibration Data:",
        "Channel\t" + COLUMNS.removeprefix("Sample\t").removesuffix("\tStim"),
        "Units\tmm\tmN\t\t\t\t\t\t\tmm\tmN",
        f"Scale (units/V)\t1.000000\t500.000000\t{zeros}",
        f"Offset (volts)\t0.000000\t0.000000\t{zeros}",
        "",
        "Test Data in Volts:",
        "",
        COLUMNS,
    ]
    rows = [f"{number}\t{length:.6f}\t{force:.6f}\t{zeros}\t0" for number, (length, force) in enumerate(volts)]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="latin-1")
    return path


def _structures(*values: Array) -> NDArray[np.void]:
    """What MATLAB has as an array of structures with one field."""
    made = np.empty(len(values), [("values", object)])
    for place, value in enumerate(values):
        made[place] = (value,)
    return made
