"""Replay of a recorded session under other delays, faults, laws or estimators, by the runners in simulated time.

In three dimensions the hand moves as recorded, and all else is simulated again.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import GRIPS, Device, Hand, SpatialDevice
from foretouch.errors import RecordingError, SettingError
from foretouch.link import FaultStage
from foretouch.messages import SessionLog, Status
from foretouch.quantities import Rows
from foretouch.quantities.pose import Vector
from foretouch.robot import MATERIALS, Robot, material_names
from foretouch.session.network.playout import Playout
from foretouch.session.replay.machines import PlayedOperator, PlayedRobot
from foretouch.session.runners.simulated import simulate
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.setup import make_session_robot
from foretouch.session.workspace import LINE, SPACE, framed_device, inverse
from foretouch.settings import NO_GRIP, SIMULATED, is_simulated

_REAL = "is of a robot in three dimensions other than the simulated one, and cannot be simulated again"
_HELD = "is of a hand in three dimensions, which is run again with --closed-loop alone"
_UNKNOWN = "does not say what its hand meant in three dimensions: --closed-loop takes scripted and recorded"
_STILL = "holds no place of the operator's hand: there is no motion to run again"


class PlayedSpatialOperator(SpatialDevice):
    """A hand that moves through the world as it did in a recorded session, whatever it feels or sees.

    The rows are of one process; their positions, some of which are known, are the follower's, by the position scale.
    """

    def __init__(self, name: str, space: Rows, *, position_scale: float = 1.0) -> None:
        known = space[np.isfinite(space["hand_x"])]
        self._name = name
        self._time = (known["time_ns"] - space["time_ns"][0]).astype(np.float64)
        self._axes = [known[f"hand_{axis}"] / position_scale for axis in "xyz"]
        self._place: Vector = (math.nan, math.nan, math.nan)

    @property
    def name(self) -> str:  # type: ignore[override]  # of the recorded operator
        """Name of the operator."""
        return self._name

    def read(self, now_ns: int) -> Vector:
        """Position of the hand [m]; between the recorded ticks interpolated linearly."""
        x, y, z = (float(np.interp(now_ns, self._time, axis)) for axis in self._axes)
        self._place = (x, y, z)
        return self._place

    @property
    def intention(self) -> Vector:
        """Position of the hand: it does not react to forces."""
        return self._place


def _replay_scene(
    log: SessionLog, settings: SessionSettings, closed_loop: bool, progress: Callable[[float], None] | None
) -> SessionLog:
    """Run one segment of a simulated session in three dimensions again; see `replay_under`.

    World, robot and camera are simulated again from the settings and their seed. In an open loop the hand follows its
    recorded path; in a closed loop the script is played again to a hand that the force moves.
    """
    _require_grip(settings, closed_loop)
    robot_name = log.settings.get("robot", SIMULATED)
    if not is_simulated(robot_name) or not np.isfinite(log.follower_space["exact_x"]).any():
        raise RecordingError("session", _REAL)
    if not np.isfinite(log.leader_space["hand_x"]).any():
        raise RecordingError("session", _STILL)
    if (material := log.settings.get("material", settings.material)) not in material_names():
        raise RecordingError("session", f"was of the material {material!r}, which is not here to be simulated again")
    name = log.settings.get("operator", settings.operator)
    operator: SpatialDevice | None = None  # the settings' own, which plays again
    if not closed_loop:
        if settings.grip != NO_GRIP:
            raise RecordingError("session", _HELD)
        played = PlayedSpatialOperator(name, log.leader_space, position_scale=settings.position_scale)
        operator = framed_device(played, inverse(settings.leader_frame))
    elif name not in ("scripted", "recorded"):
        raise RecordingError("session", _UNKNOWN)
    ticks = round(np.ptp(log.leader["time_ns"]) * 1e-9 / SAMPLE_PERIOD) + 1
    session = simulate(
        settings,
        duration=ticks * SAMPLE_PERIOD,
        operator=operator,
        description=_told(log, settings, closed_loop),
        progress=progress,
        say=_miss_camera,
    )
    return session.log


def _miss_camera(line: str) -> None:
    problem = line.partition(";")[0].removeprefix("camera: ")
    raise RecordingError("session", f"has images, which are drawn again: {problem}")


Times = NDArray[np.int64]

FIXED_MOTION = "the operator's motion is fixed: who feels another force would have moved otherwise"
"""Note on a replay in an open loop."""

CLOSED_LOOP = "the hand answers: the force that is rendered now moves it"
"""Note on a replay in a closed loop."""

_PERIOD_NS = round(SAMPLE_PERIOD * 1e9)


def replay_under(
    log: SessionLog,
    settings: SessionSettings,
    closed_loop: bool = False,
    progress: Callable[[float], None] | None = None,
) -> SessionLog:
    """Run a recorded session again, under other settings.

    In an open loop the hand moves as it was recorded, in a closed loop its recorded intention moves a simulated hand,
    with the settings' grip, against the force that is rendered now. A simulated material reacts: it and its robot are
    simulated again, from the settings and their seed. Of a real robot, or one moved by a person, only the force
    measured on its path is known: it follows its recorded path and feels the recorded force, later or earlier by the
    change in the commands' delay.

    Both sides run in ticks of exactly `SAMPLE_PERIOD`, over one clock. A simulated session under its own settings is
    reproduced bit by bit.

    Args:
        log: The session; if a side began again in it, the longest segment is used.
        settings: All settings; `recorded_settings` has those of the recording.
        closed_loop: Whether the force moves the hand.
        progress: Called now and then with the time that has been replayed [s].

    Returns:
        The resulting session. Its `settings` also contain ``replay``, "open loop" or "closed loop".

    Raises:
        RecordingError: A side or the motion of the hand is missing; or part of a session in three dimensions cannot be
            simulated again.
        SettingError: A closed loop without a grip, or with a robot that does not react.
    """
    log = log.longest()
    if not log.leader.size or not log.follower.size:
        raise RecordingError("session", "a side is missing: there is nothing to run again")
    there, here = (name or "a line" for name in (log.settings.get("scene"), settings.scene))
    if there != here:
        problem = f"is one in three dimensions or along a line, and its settings are not: {there}, and {here}"
        raise RecordingError("session", problem)
    return REPLAYS[settings.workspace](log, settings, closed_loop, progress)


def _replay_line(
    log: SessionLog, settings: SessionSettings, closed_loop: bool, progress: Callable[[float], None] | None
) -> SessionLog:
    """Run one segment of a session along a line again; see `replay_under`."""
    operator = _operator(log, log.leader, settings, closed_loop)
    ticks = round(int(np.ptp(log.leader["time_ns"])) / _PERIOD_NS) + 1
    if material_answers(log):
        robot, _ = make_session_robot(settings)
        return _run(log, settings, closed_loop, operator, robot, ticks, progress)
    if closed_loop:
        rule = "needs a material that answers: of this robot there is only the force where it was measured"
        raise SettingError("closed loop", True, rule)
    felt = _felt_at(log, settings)
    ticks = min(ticks, int(felt[-1]) // _PERIOD_NS + 1)  # after its last sample there is nothing to learn from
    if ticks < 2:
        raise RecordingError("session", "the robot felt nothing while the operator moved")
    played = PlayedRobot(log.follower, felt, ticks)
    return _as_it_was(_run(log, settings, closed_loop, operator, played, ticks, progress), played.rows)


REPLAYS = {LINE: _replay_line, SPACE: _replay_scene}


def material_answers(log: SessionLog) -> bool:
    """Whether what the robot pressed can be simulated again: it was simulated, and no person moved the robot."""
    log = log.longest()
    follower = log.follower
    known = log.settings.get("material") in MATERIALS and bool(np.isfinite(follower["exact_force"]).all())
    return known and not (follower["status"] == Status.SHADOW).any()


def replay_notes(log: SessionLog, settings: SessionSettings, closed_loop: bool = False) -> tuple[str, ...]:
    """Notes on a replay: what is fixed in it, what reacts, and what of the recording is missing.

    Args:
        log: The session.
        settings: As for `replay_under`.
        closed_loop: As for `replay_under`.

    Returns:
        Sentences without a full stop; the first states whether the operator's motion is fixed.
    """
    segments, segment = log.segments(), log.longest()
    leader = segment.leader
    notes = [CLOSED_LOOP if closed_loop else FIXED_MOTION]
    if closed_loop and not np.isfinite(leader["intended_position"]).any():
        notes.append("what the hand meant was not recorded: where it was is taken for that")
    if not closed_loop and settings.grip != NO_GRIP:
        if segment.settings.get("replay") != "open loop":
            lets = ": --closed-loop lets it" if material_answers(log) else ""
            notes.append(f"recorded in a closed loop, and the hand does not answer here{lets}")
        notes.append("the hand is where it was; how far the robot is from it comes of the replay's own models")
    if material_answers(log):
        beside = settings.workspace.again
        notes.append(f"the robot and its material ({settings.material}){beside} are simulated again")
    else:
        notes.append("the robot's motion is fixed too: its measured force comes as late as its commands do")
    if len(segments) > 1:
        notes.append(f"a side began again: of {len(segments)} segments the longest is run again")
    if len(segment.phases()) > 1:
        notes.append("the network was changed meanwhile: it is run again as it was at the end")
    if log.emergencies:
        notes.append("the recording's emergency stops are not given again")
    if settings.sensor_fault and material_answers(log):
        notes.append("nobody says again that the sensors are mended")
    if (np.diff(leader["time_ns"]) != _PERIOD_NS).any():
        notes.append("the session was in real time: its late ticks are not late again")
    return tuple(notes)


def _operator(log: SessionLog, leader: Rows, settings: SessionSettings, closed_loop: bool) -> Device:
    """Operator that moves the leader in the replay."""
    played = PlayedOperator(
        log.settings.get("operator", settings.operator),
        leader,
        position_scale=settings.position_scale,
        intends=closed_loop,
    )
    if not math.isfinite(played.read(0)):
        raise RecordingError("session", "holds no position of the operator's hand: there is no motion to run again")
    if not closed_loop:
        return played
    _require_grip(settings, closed_loop)
    return Hand(played, GRIPS[settings.grip], settings.device, settings.clutch)


def _require_grip(settings: SessionSettings, closed_loop: bool) -> None:
    if closed_loop and settings.grip == NO_GRIP:
        grips = ", ".join(sorted(GRIPS))
        raise SettingError("grip", settings.grip, f"in a closed loop the force moves a hand: choose a grip of {grips}")


def _told(log: SessionLog, settings: SessionSettings, closed_loop: bool) -> dict[str, str]:
    """Texts of the recording beside its settings, and those of this replay."""
    chosen = settings.as_text()
    texts = {name: text for name, text in log.settings.items() if name not in chosen}
    return texts | {"replay": "closed loop" if closed_loop else "open loop"}


def _run(
    log: SessionLog,
    settings: SessionSettings,
    closed_loop: bool,
    operator: Device,
    robot: Robot,
    ticks: int,
    progress: Callable[[float], None] | None,
) -> SessionLog:
    """Run the session; the log contains the recording's texts beside its settings."""
    chosen = settings.as_text()
    # The played operator counts as the session does.
    framed = dataclasses.replace(settings, leader_frame=SessionSettings.leader_frame)
    texts = {name: chosen[name] for name in ("leader_frame", "follower_frame")}
    if isinstance(robot, PlayedRobot):
        framed = dataclasses.replace(framed, follower_frame=SessionSettings.follower_frame)
        texts["material"] = log.settings.get("material", settings.material)
    session = simulate(
        framed,
        duration=ticks * SAMPLE_PERIOD,
        operator=operator,
        robot=robot,
        description=_told(log, settings, closed_loop) | texts,
        progress=progress,
    )
    return session.log


def _felt_at(segment: SessionLog, settings: SessionSettings) -> Times:
    """Times at which the replay's robot feels what the recorded one felt, since the first tick [ns]: as commands come.

    The offset of two clocks is in the transit of the commands that they show; the replay's own transit replaces it.
    """
    rows = segment.rows()
    if not rows.leader.size:
        raise RecordingError("session", "the robot applied no command: there is nothing to run again")
    shown = _usual(rows.follower["time_ns"] - rows.leader["time_ns"])
    later = _usual_transit(settings, segment.leader.size) - shown
    return np.asarray(segment.follower["time_ns"] + later - segment.leader["time_ns"][0])


def _usual_transit(settings: SessionSettings, ticks: int) -> int:
    """Usual time until commands are played in a replay [ns]."""
    stage: FaultStage[int] = FaultStage(settings.command_faults)
    playout, taken, applied, newest = Playout(), [], 0, 0
    for tick in range(ticks):
        for sequence in stage.pop_due(tick * _PERIOD_NS):
            if sequence > newest:  # an overtaken command is refused
                newest = sequence
                playout.push(sequence, 0.0)
        playout.advance()
        if playout.applied != applied:
            applied = playout.applied
            taken.append((tick + 1 - applied) * _PERIOD_NS)
        stage.push(tick * _PERIOD_NS, tick + 1)
    return _usual(np.array(taken)) if taken else 0


def _usual(times: Times) -> int:
    """Median of these times, as one of them."""
    return int(np.percentile(times, 50.0, method="lower"))


def _as_it_was(log: SessionLog, recorded: Rows) -> SessionLog:
    """Replay of a robot that followed its own path: it is held back where the recording or the replay reports it.

    Ticks in which the robot is held back, or did not follow, are not scored.
    """
    follower = log.follower.copy()
    follower["guarded"] |= recorded["guarded"]
    elsewhere = ~np.isin(recorded["status"], (Status.FOLLOWING, Status.GUARDED))
    follower["status"] = np.where(elsewhere, recorded["status"], follower["status"])
    watched = recorded["status"] == Status.SHADOW
    follower["guarded"][watched] = False
    follower["desired_position"][watched] = math.nan
    return dataclasses.replace(log, follower=follower)
