"""Conformance checks of a driven arm's `ArmLink`: what it says and does before anything is made safe."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.robot.along_line import AlongLine
from foretouch.robot.drivers import ArmLink, ArmState, DrivenArm
from foretouch.robot.drivers.driven_arm import FARTHEST, SILENT, is_force, is_place
from foretouch.robot.robot import Wrapped
from foretouch.session.conformance.finding import Result, percentile_time
from foretouch.session.conformance.robot_checks import Subject, checked

LISTENED = 0.5  # Time for which states are taken [s]
CAUGHT_UP, STARTING = 0.02, 2.0  # Time for which the newest state is sought, and for which a start is waited for [s]
PROMPT = 2e-4  # Longest duration of a call that asks for the state [s]
TURNS = 4.0 * math.pi  # Largest position of a joint [rad]
NOISIER, STILL = 3.0, 1e-3
"""Largest ratio of the noise at rest to the stated one; largest motion of an arm that is commanded nothing [m]."""
NUDGE, FOLLOWED, ASIDE = 0.002, (0.7, 1.3), 0.3
"""Way of an arm that may be moved, along each axis and back [m]; parts of it that count as followed, and the part that
may go along another axis."""
NUDGED = 0.5  # Time of a way, of which the second half is a rest [s]
SENT = 5.0 * PROMPT  # Longest duration of a command, which goes out over a network [s]

Rows = NDArray[np.float64]


def link_of(robot: object) -> ArmLink | None:
    """The driver of an arm that is inside a robot; None where there is none."""
    while isinstance(robot, AlongLine | Wrapped):
        robot = robot.arm if isinstance(robot, AlongLine) else robot.robot
    return robot.link if isinstance(robot, DrivenArm) else None


def _of_arm(look: Callable[[ArmLink], Result]) -> Callable[[Subject], Result]:
    """The check where there is an arm behind a driver; no finding where there is none."""

    @functools.wraps(look)
    def looked(it: Subject) -> Result:
        link = link_of(it.robot)
        return None if link is None else look(link)

    return looked


def _if_moved(look: Callable[[ArmLink], Result]) -> Callable[[Subject], Result]:
    """The same where it may be moved."""
    inner, unseen = _of_arm(look), (None, "it is a real one: --move lets it move", "see docs/drivers.md")
    return lambda it: inner(it) if it.move or link_of(it.robot) is None else unseen


def _listened(link: ArmLink) -> list[ArmState]:
    """States over half a second, as often as a session asks."""
    states, end = [], time.monotonic() + LISTENED
    while time.monotonic() < end:
        if (state := link.state()) is not None:
            states.append(state)
        time.sleep(1e-3)
    return states


def _distinct(states: list[ArmState]) -> Rows:
    """When the different states were measured [s]."""
    return np.unique([state.measured_ns for state in states]) * 1e-9


@checked("driver: name", "a text by which a person knows the arm: it begins every line about it")
@_of_arm
def _name(link: ArmLink) -> Result:
    return isinstance(link.name, str) and bool(link.name.strip()), repr(link.name)


@checked(
    "driver: reach",
    f"lowest and highest place, each of three numbers in m within {FARTHEST:g} m of the base; the same one twice is an "
    "axis along which it does not move",
)
@_of_arm
def _reach(link: ArmLink) -> Result:
    low, high = link.reach
    ordered = is_place(low) and is_place(high) and all(a <= b for a, b in zip(low, high, strict=True))
    return ordered and low != high, f"{low} to {high} m"


@checked("driver: begins within its reach", "the tip is within the reach: move the arm there, or state another reach")
@_of_arm
def _within(link: ArmLink) -> Result:
    place, (low, high) = _state(link).place, link.reach
    return all(a <= value <= b for a, value, b in zip(low, place, high, strict=True)), f"at {_said(place)} m"


@checked("driver: rate", "sample_period is 0.001, 0.002, 0.004 or 0.005 s: that of the arm's own command cycle")
@_of_arm
def _rate(link: ArmLink) -> Result:
    return round(link.specification.sample_period, 9) in (
        1e-3,
        2e-3,
        4e-3,
        5e-3,
    ), f"{link.specification.sample_period} s"


@checked("driver: force limit", "the sensor's range is at least the force limit: above its range a force is not seen")
@_of_arm
def _limit(link: ArmLink) -> Result:
    own = link.specification
    return own.sensor_range >= own.force_limit, f"{own.force_limit:g} N, of a range of {own.sensor_range:g} N"


@checked("driver: state", "state() gives an ArmState, or None before the first")
@_of_arm
def _kind(link: ArmLink) -> Result:
    state: object = link.state()
    return isinstance(state, ArmState), f"a {type(state).__name__}"


@checked("driver: place", "place is three finite numbers in m, in the axes of the base")
@_of_arm
def _place(link: ArmLink) -> Result:
    places = [state.place for state in _listened(link)]
    return bool(places) and all(map(is_place, places)), _said(places[-1]) if places else "no state"


@checked("driver: force", "force is three finite numbers in N within the sensor's range, in the axes of the base")
@_of_arm
def _force(link: ArmLink) -> Result:
    forces, most = [state.force for state in _listened(link)], link.specification.sensor_range
    kept = bool(forces) and all(is_force(force) and math.hypot(*force) <= most for force in forces)
    return kept, f"{_said(forces[-1])} N" if forces else "no state"


@checked(
    "driver: nothing is felt in free air",
    "the force is at most largest_offset: weigh the tool out, set its payload, or take it off what it touches",
)
@_of_arm
def _free(link: ArmLink) -> Result:
    force, most = np.mean([state.force for state in _listened(link)], axis=0), link.specification.largest_offset
    size = float(np.linalg.norm(force))
    return size <= most, f"{size:.3g} N, of at most {most:g} N"


@checked(
    "driver: force noise", f"at most {NOISIER:g} times sensor_noise: state what it is, for a contact counts from 6 on"
)
@_of_arm
def _noise(link: ArmLink) -> Result:
    forces, own = np.array([state.force for state in _listened(link)]), link.specification.sensor_noise
    noise = float(np.std(np.diff(forces, axis=0), axis=0).max() / math.sqrt(2.0)) if len(forces) > 2 else math.nan
    return noise <= NOISIER * own + 1e-9, f"{noise:.2g} N, and {own:g} N is stated"


@checked("driver: joints", "joints are finite, in rad, or none")
@_of_arm
def _joints(link: ArmLink) -> Result:
    joints = _state(link).joints
    return all(math.isfinite(one) and abs(one) <= TURNS for one in joints), f"{len(joints)} joints"


@checked("driver: it takes commands", 'refuses is "" where it does, else why not: release what stopped it')
def _refuses(it: Subject) -> Result:
    link = link_of(it.robot)
    if link is None:
        return None
    refuses, end = _state(link).refuses, time.monotonic() + STARTING
    while it.move and refuses and time.monotonic() < end:  # some begin with the first command
        link.command(_state(link).place)
        refuses = _state(link).refuses
    return isinstance(refuses, str) and not refuses, repr(refuses)


@checked("driver: clock", "measured_ns is by time.monotonic_ns of this machine, and not ahead of it")
@_of_arm
def _clock(link: ArmLink) -> Result:
    measured_ns = _state(link).measured_ns
    age = (time.monotonic_ns() - measured_ns) * 1e-9
    return -1e-3 <= age <= 1.0, f"the newest state is {1e3 * age:.3g} ms old"


@checked("driver: order", "measured_ns never goes back: drop what was overtaken")
@_of_arm
def _order(link: ArmLink) -> Result:
    back = int((np.diff([state.measured_ns for state in _listened(link)]) < 0).sum())
    return back == 0, f"{back} times"


@checked("driver: new states", "as many a second as sample_period says, at least four fifths: state the true period")
@_of_arm
def _news(link: ArmLink) -> Result:
    rate, stated = _distinct(_listened(link)).size / LISTENED, 1.0 / link.specification.sample_period
    return rate >= 0.8 * min(stated, 900.0), f"{rate:.0f} a second, and {stated:.0f} are stated"


@checked("driver: gaps", f"no longer than {1e3 * SILENT:g} ms, or five periods: then its sensors count as failed")
@_of_arm
def _gaps(link: ArmLink) -> Result:
    gap = float(np.diff(_distinct(_listened(link))).max(initial=0.0))
    return gap <= max(SILENT, 5.0 * link.specification.sample_period), f"{1e3 * gap:.3g} ms at most"


@checked("driver: time of state()", f"99 of 100 within {1e3 * PROMPT:g} ms: let a thread wait for the library")
@_of_arm
def _prompt(link: ArmLink) -> Result:
    taken = percentile_time(lambda _: link.state(), 300, 99.0)
    return taken <= PROMPT, f"{1e3 * taken:.3g} ms"


@checked("driver: at rest", f"an arm that is commanded nothing stays within {1e3 * STILL:g} mm")
@_of_arm
def _rest(link: ArmLink) -> Result:
    way = float(np.ptp([state.place for state in _listened(link)], axis=0).max())
    return way <= STILL, f"{1e3 * way:.3g} mm"


def _follows(link: ArmLink, axis: int) -> Result:
    if link.reach[0][axis] == link.reach[1][axis]:
        return None
    moved, taken = _nudged(link, axis)
    part, aside = float(moved[axis]) / NUDGE, float(np.abs(np.delete(moved, axis)).max())
    kept = FOLLOWED[0] <= part <= FOLLOWED[1] and aside <= ASIDE * NUDGE and taken <= SENT
    return kept, f"{part:.2f} of the way, {1e3 * aside:.2g} mm aside; command() within {1e3 * taken:.2g} ms"


for number, letter in enumerate("xyz"):
    rule = f"told to go {1e3 * NUDGE:g} mm along {letter} of the base, it does, and aside along no other axis"
    checked(f"driver: follows along {letter}", rule)(_if_moved(functools.partial(_follows, axis=number)))


@checked(
    "driver: holds without commands", f"without a command for {1e3 * LISTENED:g} ms it stays within {1e3 * STILL:g} mm"
)
@_if_moved
def _holds(link: ArmLink) -> Result:
    link.command(_state(link).place)
    time.sleep(0.05)
    way = float(np.ptp([state.place for state in _listened(link)], axis=0).max())
    return way <= STILL, f"{1e3 * way:.3g} mm"


@checked("close", "a second close does nothing")
def _close(it: Subject) -> Result:
    it.robot.close()
    it.robot.close()
    return True, "closed twice"


def _state(link: ArmLink) -> ArmState:
    """The newest state. Where nobody has asked for a while, a link may have older ones to hand out first."""
    end, state = time.monotonic() + CAUGHT_UP, link.state()
    while time.monotonic() < end:
        time.sleep(1e-3)
        state = link.state()
    if state is None:
        raise ValueError("no state has come")
    return state


def _nudged(link: ArmLink, axis: int) -> tuple[Rows, float]:
    """How far it went, told to go a little up the axis, and back then [m]; 99 % of the commands took less [s]."""
    home, period = np.array(_state(link).place), link.specification.sample_period
    taken: list[float] = []

    def go(begin: float, end: float) -> Rows:
        ticks = round(NUDGED / period)
        for tick in range(ticks):
            place = home.copy()
            place[axis] += begin + (end - begin) * min(2.0 * tick / ticks, 1.0)
            begun = time.perf_counter()
            link.command((float(place[0]), float(place[1]), float(place[2])))
            taken.append(time.perf_counter() - begun)
            link.state()  # as a session does
            time.sleep(period)
        return np.asarray(np.array(_state(link).place) - home)

    moved = go(0.0, NUDGE)
    go(NUDGE, 0.0)
    return moved, float(np.percentile(taken, 99.0))


def _said(vector: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.3g}" for value in vector)
