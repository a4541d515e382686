"""The settings, operator and robot of a recorded session, for its replay.

The operator moves as recorded; the robot feels the recorded force.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import OPERATORS, Device
from foretouch.devices.device import limit_force
from foretouch.errors import InputError
from foretouch.link import network_trace
from foretouch.quantities import LARGEST_POSITION, Rows
from foretouch.robot import Robot, RobotSample, RobotSpecification, material_names
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.settings import DEFAULTS, PAPER_DELAYS

_DEFAULTS = {name: default for name, default in DEFAULTS.items() if name not in ("robot", "calibration")}
"""Defaults of a recording's settings: its robot is replayed, whatever it was, with values already calibrated."""


def recorded_settings(
    texts: Mapping[str, str], changes: Mapping[str, Any] | None = None
) -> tuple[SessionSettings, tuple[str, ...]]:
    """The settings that a recording names, some of them changed.

    A setting that the recording lacks, or that this version does not know, has its default. A changed law has its own
    default estimator, unless that is changed too; with another network the recorded delays are left out.

    Args:
        texts: `foretouch.messages.SessionLog.settings`.
        changes: Fields of `SessionSettings` and their new values.

    Returns:
        The settings, and one sentence on each thing for which a default was taken.

    Raises:
        SettingError: A changed value is out of range, or does not go with the others; or the recorded network is a file
            that is not here.
        UnknownNameError: A changed name, or a recorded network, that does not exist.
    """
    values, notes = _parsed(texts)
    changes = dict(changes or {})
    if network := changes.get("network", values.get("network")):
        network_trace(network)  # without it nothing would be as it was
    try:
        SessionSettings(**values)
    except InputError:
        values, refused = _understood(values)
        notes += refused
    if "model" in changes and changes["model"] != values.get("model"):
        values.pop("estimator", None)
    if "network" in changes:  # another network has delays of its own
        values = {name: value for name, value in values.items() if name not in PAPER_DELAYS}
    return SessionSettings(**values | changes), tuple(notes)


def _parsed(texts: Mapping[str, str]) -> tuple[dict[str, Any], list[str]]:
    """The values in the texts, by name, and notes on the others."""
    values: dict[str, Any] = {}
    missing, notes = [], []
    for name, default in _DEFAULTS.items():
        if name not in texts:
            missing.append(name)
        elif name == "operator" and texts[name] not in OPERATORS:
            continue  # a shadow, or a device from elsewhere: it is replayed, whatever it was
        elif name == "material" and texts[name] not in material_names():
            continue  # of a package that is not installed: its output is replayed
        else:
            try:
                values[name] = (float if default is None else type(default))(texts[name])  # None: a number not stated
            except ValueError:
                notes.append(_not_known(name, texts[name]))
    if missing:
        notes.insert(0, f"the recording does not say {', '.join(missing)}: defaults are taken")
    return values, notes


def _understood(values: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Those values that are consistent, as many as possible, and notes on the others."""
    taken: dict[str, Any] = {}
    left = dict(values)
    for _ in range(2):  # some depend on others that come later
        for name in list(left):
            try:
                SessionSettings(**taken, **{name: left[name]})
            except InputError:
                continue
            taken[name] = left.pop(name)
    return taken, [_not_known(name, str(value)) for name, value in left.items()]


def _not_known(name: str, text: str) -> str:
    default = _DEFAULTS[name] or "its default"
    return f"the recording says {name} = {text!r}, which this version does not take: {default} is taken"


Array = NDArray[np.float64]


class PlayedOperator(Device):
    """A hand that moves as it did in a recorded session, whatever it feels.

    Between the recorded ticks the motion is linear; after the last it stays. A hand that felt something waited until it
    was coupled with the follower: its time began then, and here it waits again.

    Args:
        name: Name of the recorded operator.
        leader: Rows of one process of the leader, at least 1, with some position of the hand in them.
        position_scale: Position scale of the session: old recordings have only the proxy's position.
        intends: Whether to play the hand's intended motion, where that is known, and not the measured one. It feels
            nothing then: it is for a `foretouch.devices.Hand` to follow.
    """

    def __init__(self, name: str, leader: Rows, *, position_scale: float = 1.0, intends: bool = False) -> None:
        felt = bool(np.isfinite(leader["exact_hand_position"]).any())
        engaged = np.maximum.accumulate(leader["engaged"])  # the clutch is pressed after they have met, or never
        clutched = engaged & ~leader["engaged"]
        if felt:
            met = np.flatnonzero((leader["telemetry_sequence"] > 0) | (leader["model_sequence"] > 0))
            begun = min(int(met[0]) + 1 if met.size else leader.size, leader.size - 1)
            leader, clutched = leader[begun:], clutched[begun:]
        hand, wanted = leader["hand_position"], leader["intended_position"]
        hand = np.where(np.isfinite(hand), hand, leader["position"] / position_scale)
        self._name, self._waits = name, felt and not intends
        self._clutched = clutched
        self._time = (leader["time_ns"] - leader["time_ns"][0]) * 1e-9
        self._place = _filled(np.where(np.isfinite(wanted), wanted, hand) if intends else hand)
        self._exact, self._wanted = leader["exact_hand_position"].copy(), wanted.copy()
        self._now = 0.0

    @property
    def name(self) -> str:  # type: ignore[override]  # of the recorded operator
        """Name of the operator."""
        return self._name

    @property
    def closed_loop(self) -> bool:  # type: ignore[override]  # a hand that felt something waited, and waits again
        """Whether the hand waits for the follower; no force moves it."""
        return self._waits

    @property
    def duration(self) -> float:
        """Length of the motion [s], without the waiting before it."""
        return float(self._time[-1])

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]."""
        self._now = max(self._now, now_ns * 1e-9)
        return float(np.interp(self._now, self._time, self._place))

    def render(self, force: float) -> float:
        """The force [N], clipped to the limit of every device; it moves nothing."""
        return limit_force(force)

    @property
    def exact_position(self) -> float:
        """Exact position of the hand [m]; NaN where it is unknown."""
        return float(np.interp(self._now, self._time, self._exact))

    @property
    def intention(self) -> float:
        """Intended position of the hand [m]; NaN where it is unknown."""
        return float(np.interp(self._now, self._time, self._wanted))

    @property
    def clutched(self) -> bool:
        """Whether hand and follower, once coupled, were apart: the clutch was pressed, or the robot stopped."""
        return bool(self._clutched[np.searchsorted(self._time, self._now, side="right") - 1])


class PlayedRobot(Robot):
    """A robot that follows its recorded path and feels the recorded force, whatever is commanded.

    Weight and inertia of the tool are already subtracted from the recorded force. Samples of sensors not trusted
    are NaN, so that they are rejected again. Before the first sample and after the last that one is repeated.

    Args:
        rows: Rows of `foretouch.messages.SessionLog.follower`, of one process, at least 1; as an attribute, the newest
            at each tick, shape (ticks,).
        time_ns: Time at which each of them is felt, from the replay's first tick [ns], increasing, shape of `rows`.
        ticks: Number of ticks of the replay.
    """

    def __init__(self, rows: Rows, time_ns: NDArray[np.int64], ticks: int) -> None:
        clock = np.arange(ticks) * round(1e9 * SAMPLE_PERIOD)
        self.rows = rows[np.maximum(np.searchsorted(time_ns, clock, side="right") - 1, 0)]
        force = np.where(rows["validity"] == 0, rows["sensor_force"], math.nan)
        columns = (rows["position"], force, rows["exact_force"])
        self._columns: list[list[float]] = [np.interp(clock, time_ns, column).tolist() for column in columns]
        self._clipped = self.rows["clipped"].tolist()
        self._tick, self._last = 0, ticks - 1
        self.specification = RobotSpecification(
            sample_period=SAMPLE_PERIOD,
            force_limit=math.inf,
            encoder_resolution=0.0,
            encoder_noise=0.0,
            tool_mass=0.0,
            gravity=0.0,
            sensor_noise=0.0,
            accelerometer_noise=0.0,
            sensor_bandwidth=math.inf,
            workspace=(-LARGEST_POSITION, LARGEST_POSITION),
            simulated=bool(np.isfinite(rows["exact_force"]).all()),
        )

    def read(self) -> RobotSample:
        """Sensor sample at this tick."""
        position, force, exact = (column[self._tick] for column in self._columns)
        return RobotSample(position, force, 0.0, exact, math.nan, position, self._clipped[self._tick])

    def exchange(self, desired_position: float) -> RobotSample:
        """Let one sample period pass; the command is left out."""
        self._tick = min(self._tick + 1, self._last)
        return self.read()


def _filled(values: Array) -> Array:
    """Replace values that are not finite by the last finite one, and at the beginning by the first."""
    known = np.isfinite(values)
    if not known.any():
        return values
    first = int(np.argmax(known))
    newest = np.maximum.accumulate(np.where(known, np.arange(values.size), first))
    return np.asarray(values[newest])
