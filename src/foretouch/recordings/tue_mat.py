"""Reads the measured presses of the TU/e one-degree-of-freedom teleoperation experiment (MATLAB ``.mat``).

A person moves the leader lever, the follower lever presses a material; both are 0.075 m long, sampled at 2 kHz.
"""

from __future__ import annotations

import warnings
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, UnknownNameError
from foretouch.files import within_budget
from foretouch.quantities import Recording
from foretouch.recordings.excerpt_file import FORCES, LEADER, SUFFIX, read_excerpt

__all__ = ["FORCE_CHANNELS", "TUE_CONTACT_FLOOR", "is_tue", "read_leader_motion", "read_tue"]

LEVER = 0.075
"""Length of the levers [m]."""

TORQUE_PER_VOLT = 0.2361
"""Torque on the follower lever for one volt of its force bridge [N m/V]."""

TUE_CONTACT_FLOOR = 0.3
"""Smallest force [N] that counts as contact: lever friction and inertia stay below it."""

FORCE_CHANNELS: Final = tuple(FORCES)
"""Forces of a file: the raw bridge, and the torque that the experiment logged."""

_VARIABLES = ["scope", "env_est3"]

Array = NDArray[np.float64]


def read_tue(path: str | PathLike[str], force_channel: str = "raw", *, flip: bool = False) -> Recording:
    """The follower's press: position = 0.075 m times its angle, force = torque / 0.075 m.

    In these files the angle and both torques already grow while pressing.

    Args:
        path: The file.
        force_channel: ``"raw"``, the force bridge with its offset of 7 to 8 N; or ``"logged"``, the environment
            torque that the experiment logged, which lags by about 3 ms behind a first-order low-pass.
        flip: Change the sign of the positions.

    Raises:
        RecordingError: The file is no such recording.
        UnknownNameError: Another force channel.
    """
    if force_channel not in FORCE_CHANNELS:
        raise UnknownNameError("force channel", force_channel, FORCE_CHANNELS)
    time, angles, torques, bridge = _signals(path)
    torque = bridge * TORQUE_PER_VOLT if force_channel == "raw" else torques[:, 1]
    lever = -LEVER if flip else LEVER
    return Recording(time, lever * angles[:, 1], torque / LEVER, name=str(path), contact_floor=TUE_CONTACT_FLOOR)


def read_leader_motion(path: str | PathLike[str]) -> tuple[Array, Array]:
    """Motion of the leader lever in a TU/e file or its excerpt: a real hand.

    Returns:
        Time since the first sample [s] and position [m], 0.075 m times the leader's angle, growing with depth.

    Raises:
        RecordingError: The file is no such recording.
    """
    time, position = within_budget(path, None, _leader_motion, path)
    motion = Recording(time, position, np.zeros(time.size), name=str(path))  # checks time and position
    return motion.time - motion.time[0], motion.position


def _leader_motion(path: str | PathLike[str]) -> tuple[Array, Array]:
    if Path(path).suffix.lower() != SUFFIX:
        time, angles, _, _ = _signals(path)
        return time, LEVER * angles[:, 0]
    about, columns = read_excerpt(path)
    if LEADER not in columns:
        raise RecordingError(path, f"{about.name} has no motion of a leader: take one of tue/")
    return columns["time"], columns[LEADER]


def is_tue(path: str | PathLike[str]) -> bool:
    """Whether a file is a MATLAB file with the variables of these recordings."""
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings(action="ignore"):  # of what has no name in these files
            return loadmat(str(path), variable_names=_VARIABLES).keys() >= set(_VARIABLES)
    except Exception:  # of another version, or none: who reads it says so
        return False


def _signals(path: str | PathLike[str]) -> tuple[Array, Array, Array, Array]:
    """Time (n,), leader and follower angle (n, 2), minus operator and environment torque (n, 2), bridge (n,)."""
    from scipy.io import loadmat

    try:
        content: dict[str, Any] = loadmat(str(path), squeeze_me=True, struct_as_record=False, variable_names=_VARIABLES)
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror or error}") from None
    except Exception as error:  # SciPy raises many kinds on a damaged or foreign file
        raise RecordingError(path, f"is no MATLAB file that can be read: {' '.join(str(error).split())}") from None
    try:
        scope = content["scope"]
        time = np.asarray(scope.time, dtype=np.float64)
        angles = np.asarray(scope.signals[0].values, dtype=np.float64)
        torques = np.asarray(scope.signals[1].values, dtype=np.float64)
        bridge = np.asarray(content["env_est3"].signals[2].values, dtype=np.float64)
    except (KeyError, AttributeError, IndexError, TypeError, ValueError):
        angles = torques = bridge = time = np.empty(0)
    if time.ndim != 1 or angles.shape != (time.size, 2) or torques.shape != angles.shape or bridge.shape != time.shape:
        raise RecordingError(
            path, "is no TU/e teleoperation recording (no scope with angles, torques and force bridge): use CSV"
        )
    return time, angles, torques, bridge
