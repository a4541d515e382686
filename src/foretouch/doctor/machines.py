"""What a robot or device that is really connected does: rate, jitter, noise, drift, steps, latency, sign and frame.

It is made and exchanged with in a process of its own, which a driver may crash or hang; by reading alone, unless it was
allowed to move.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.doctor.finding import Finding, Verdict
from foretouch.files.children import last_line

Array = NDArray[np.float64]

PERIOD = 1e-3  # Of a session's tick [s]
PATIENCE = 120.0  # Longest time beside that of looking [s]: connecting, and compiling where it was not

AXES = ("x", "y", "z")

SLOW_ENOUGH = 2.0  # Time of a way out and back [s]
LONGEST_LATENCY = 0.3  # That is looked for [s]
TOUCHES = 0.2  # Least change of a force that is a contact's [N]

NOISE_FORCE, NOISE_PLACE = 0.1, 5e-5
"""Standard deviations of a sensor at rest above which a session runs less well: contact is noticed above six times the
force's [N], and a velocity is the difference of two positions [m]."""

DRIFT = 0.02  # Of the force, at rest [N/s]: a session follows 1.2 N a minute in free air, and less in contact
STEP_PLACE = 2e-5  # Of the position [m]
LATE, TOO_LATE = 0.03, 0.1  # Latencies of the robot that cost accuracy, and that a session should not have [s]
MOVED = 0.7, 1.3  # A way that is less, or more, of the one that was told, has another unit or is not followed
ASIDE = 0.2  # Largest part of a way that goes along another axis: more is another frame


def check_machine(what: str, name: str, seconds: float, move: float) -> list[Finding]:
    """Look at a robot or device.

    Args:
        what: ``"robot"`` or ``"device"``.
        name: As on the command line.
        seconds: Time to look at it while it rests [s].
        move: Distance by which a robot may move, out and back [m], 0 for not at all.
    """
    command = [sys.executable, "-m", "foretouch.doctor.machines", what, name, str(seconds), str(move)]
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE + 2.0 * seconds)
    except subprocess.TimeoutExpired:
        why = f"it did not answer within {PATIENCE + 2.0 * seconds:g} s"
        return [Finding(f"{what} {name}", Verdict.BAD, why, f"foretouch plugins check {name}")]
    try:
        report = json.loads(child.stdout.splitlines()[-1])
    except (ValueError, IndexError):
        why = last_line(child.stderr, "without a word")
        return [Finding(f"{what} {name}", Verdict.BAD, f"it ended with exit code {child.returncode}: {why}")]
    if "problem" in report:
        return [Finding(f"{what} {name}", Verdict.BAD, report["problem"])]
    return list(judge(f"{what} {name}", report))


def judge(name: str, report: Mapping[str, Any]) -> Iterator[Finding]:
    """What the figures of a machine mean for a session, a finding each."""
    rules = _ROBOT if "force_noise" in report else _DEVICE
    for title, rule in rules.items():
        found = rule(report)
        if found is not None:
            verdict, text = found
            yield Finding(f"{name}: {title}", verdict, text, figures=report)


Judged = tuple[Verdict, str] | None


def _verdict(*, bad: bool = False, warning: bool = False) -> Verdict:
    return Verdict.BAD if bad else Verdict.WARNING if warning else Verdict.GOOD


def _rate(report: Mapping[str, Any]) -> Judged:
    taken, rate, apart = report["exchange_p99_s"], report["rate"], report["apart_p99_s"]
    text = f"a call takes {1e3 * report['exchange_p50_s']:.3g} ms (99 % below {1e3 * taken:.3g} ms) of a tick's 1 ms"
    if rate is None:
        text += "; nothing changed while it rested, so its rate is not known"
    else:
        text += f"; {rate:.0f} new values a second, 99 % of them within {1e3 * apart:.3g} ms of the one before"
        if rate < 900.0:
            text += f": commands and forces are up to {1e3 / rate - 1.0:.2g} ms later than at 1 kHz"
    return _verdict(bad=taken > 3.0 * PERIOD, warning=taken > PERIOD or (rate is not None and rate < 900.0)), text


def _nowhere(report: Mapping[str, Any]) -> Judged:
    share = report["missing"]
    text = f"{100.0 * share:.2g} % of the samples were no numbers"
    return _verdict(bad=share > 0.01, warning=share > 0.0), text if share else "every sample was a number"


def _force(report: Mapping[str, Any]) -> Judged:
    noise, drift, step = report["force_noise"], report["force_drift"], report["force_step"]
    if noise is None:
        return Verdict.BAD, "it shows no force: nothing can be learnt from it"
    text = f"{report['force_rest']:.3g} N at rest, noise {noise:.2g} N, drift {60.0 * drift:.2g} N a minute"
    if step:
        text += f", in steps of {step:.2g} N"
    text += f"; a contact is noticed from {6.0 * noise:.2g} N on" if noise else "; without any noise: is it a real one?"
    return _verdict(warning=noise > NOISE_FORCE or abs(drift) > DRIFT), text


def _place(report: Mapping[str, Any]) -> Judged:
    noise, step = report["place_noise"], report["place_step"]
    if noise is None:
        return Verdict.BAD, "it shows no position"
    text = f"noise {1e6 * noise:.3g} um, moved by {1e3 * report['place_moved']:.2g} mm while it was told nothing"
    if step:
        text += f", in steps of {1e6 * step:.3g} um"
    return _verdict(warning=noise > NOISE_PLACE or (step or 0.0) > STEP_PLACE), text


def _latency(report: Mapping[str, Any]) -> Judged:
    if not report["moved"]:
        return Verdict.UNKNOWN, "it was not allowed to move: --move 5 lets it go 5 mm out and back, in free air"
    late = report["latency"]
    if late is None:
        return Verdict.BAD, "it did not move as it was told to"
    text = f"{1e3 * late:.1f} ms from a command to its motion: 50 mm/s is followed {50.0 * late:.2g} mm behind"
    return _verdict(bad=late > TOO_LATE, warning=late > LATE), f"{text}; what the hand feels does not wait for it"


def _frame(report: Mapping[str, Any]) -> Judged:
    ways = report["moved"]
    if not ways:
        return None
    wrong = []
    for axis, (along, aside) in ways.items():
        if not MOVED[0] <= along <= MOVED[1]:
            wrong.append(f"{axis}: {along:.2f} of the way" + (", the wrong way round" if along < 0.0 else ""))
        elif aside > ASIDE:
            wrong.append(f"{axis}: {100.0 * aside:.0f} % of the way goes along another axis")
    good = (
        "it goes along " + ", ".join(f"{axis} by {along:.2f}" for axis, (along, _) in ways.items()) + " of what is told"
    )
    return _verdict(bad=bool(wrong)), "; ".join(wrong) + ": see --follower-frame" if wrong else good


def _felt_after(report: Mapping[str, Any]) -> Judged:
    if not report["moved"]:
        return None
    late = report["force_latency"]
    if late is None:
        return Verdict.UNKNOWN, "nothing was touched on the way, so it is not known how late a force is"
    return _verdict(warning=late > LATE), f"{1e3 * late:.1f} ms from the motion to the force that it makes"


_ROBOT: dict[str, Callable[[Mapping[str, Any]], Judged]] = {
    "rate": _rate,
    "samples": _nowhere,
    "force": _force,
    "position": _place,
    "latency": _latency,
    "sign and frame": _frame,
    "force after motion": _felt_after,
}


def _hand(report: Mapping[str, Any]) -> Judged:
    noise, step, moved = report["place_noise"], report["place_step"], report["place_moved"]
    if noise is None:
        return Verdict.BAD, "it shows no position"
    text = f"moved by {1e3 * moved:.3g} mm meanwhile, noise {1e6 * noise:.3g} um"
    text += f", in steps of {1e6 * step:.3g} um" if step else ""
    return _verdict(warning=noise > NOISE_PLACE or (step or 0.0) > STEP_PLACE), text


def _carries(report: Mapping[str, Any]) -> Judged:
    if report["stiffness"] is None:
        return Verdict.GOOD, "it gives no force: what is touched is seen and not felt"
    text = f"carries {report['stiffness']:.0f} N/m with the damping of {report['damping']:g} N s/m that is stated"
    return _verdict(warning=report["stiffness"] < 100.0), f"{text}: state the true one (--device-damping)"


_DEVICE: dict[str, Callable[[Mapping[str, Any]], Judged]] = {
    "rate": _rate,
    "samples": _nowhere,
    "position": _hand,
    "force": _carries,
}


class Watched:
    """Samples of a machine, taken a thousand times a second.

    Args:
        ask: Gives one sample: places [m], and forces [N] where there are any; each of one or three numbers.
    """

    def __init__(self, ask: Callable[[], tuple[tuple[float, ...], tuple[float, ...]]]) -> None:
        self._ask = ask
        self.times: list[float] = []
        self.took: list[float] = []
        self.rows: list[tuple[float, ...]] = []
        self._places = 0

    def take(self, ticks: int, before: Callable[[int], None] = lambda _: None) -> None:
        """Take so many samples; `before` is called with the number of each."""
        due = time.perf_counter()
        for tick in range(ticks):
            before(tick)
            begun = time.perf_counter()
            places, forces = self._ask()
            self.took.append(time.perf_counter() - begun)
            self.times.append(begun)
            self.rows.append((*places, *forces))
            self._places = len(places)
            due += PERIOD
            time.sleep(max(due - time.perf_counter(), 0.0))

    @property
    def places(self) -> Array:
        """Places, shape (n, 1) or (n, 3) [m]."""
        return np.array(self.rows)[:, : self._places]

    @property
    def forces(self) -> Array:
        """Forces, shape (n, 0), (n, 1) or (n, 3) [N]."""
        return np.array(self.rows)[:, self._places :]

    def figures(self) -> dict[str, Any]:
        """Figures of the time that it rested."""
        rows, times = np.array(self.rows), np.array(self.times)
        news = 1 + np.flatnonzero((np.diff(rows, axis=0) != 0.0).any(axis=1))
        apart = np.diff(times[news])
        return {
            "exchange_p50_s": float(np.percentile(self.took, 50.0)),
            "exchange_p99_s": float(np.percentile(self.took, 99.0)),
            "rate": float(1.0 / np.mean(apart)) if apart.size > 10 else None,
            "apart_p99_s": float(np.percentile(apart, 99.0)) if apart.size > 10 else None,
            "missing": float((~np.isfinite(rows)).any(axis=1).mean()),
            **_rested("place", times, self.places),
            **(_rested("force", times, self.forces) if self.forces.size else {}),
        }


def _rested(name: str, times: Array, values: Array) -> dict[str, float | None]:
    """Noise, drift, mean, way and step of what rested, of the axis in which each is largest; the step of the finest."""
    finite = np.isfinite(values).all(axis=1)
    parts = ("noise", "drift", "rest", "moved", "step")
    if finite.sum() < 10:
        return {f"{name}_{part}": None for part in parts}
    time_, values = times[finite] - times[finite][0], values[finite]
    slope = np.polyfit(time_, values, 1)[0]
    # Noise from one sample to the next: a hand that moves, or a drift, is none.
    second = np.diff(values, n=2, axis=0)
    noise = np.sqrt((second**2).mean(axis=0) / 6.0)
    steps = [step for axis in values.T if (step := _step(axis)) is not None]
    found = (
        noise.max(),
        slope[np.abs(slope).argmax()],
        np.linalg.norm(values.mean(axis=0)),
        np.ptp(values, axis=0).max(),
    )
    return dict(zip((f"{name}_{part}" for part in parts), (*map(float, found), min(steps, default=None)), strict=True))


def _step(values: Array) -> float | None:
    """The step in which a sensor counts; None where it shows none."""
    apart = np.diff(np.unique(values))
    if apart.size < 3 or np.unique(values).size > 0.5 * values.size:
        return None
    return float(np.percentile(apart, 10.0))


def watch_robot(robot: Any, seconds: float, move: float) -> dict[str, Any]:
    """Figures of a robot of a session, which rests, and then goes out and back by so much along each axis [m]."""
    from foretouch.robot import SpatialRobot

    in_space = isinstance(robot, SpatialRobot)
    told = [math.nan] * (3 if in_space else 1)  # no command

    def ask() -> tuple[tuple[float, ...], tuple[float, ...]]:
        sample = robot.exchange(tuple(told) if in_space else told[0])
        return (sample.place, sample.force) if in_space else ((sample.position,), (sample.sensor_force,))

    resting = Watched(ask)
    resting.take(round(seconds / PERIOD))
    report = resting.figures() | {"moved": {}, "latency": None, "force_latency": None}
    if move <= 0.0 or report["place_noise"] is None:
        return report
    home, went = resting.places[-1].tolist(), []
    for axis in range(len(home)):
        wanted = move * _out_and_back() * (1.0 if in_space else -1.0)  # away from what is pressed

        def go(tick: int, axis: int = axis, wanted: Array = wanted) -> None:
            told[:] = home
            told[axis] += wanted[tick]

        moving = Watched(ask)
        moving.take(wanted.size, go)
        went.append(_went(moving, wanted, axis, 20.0 * (report["force_noise"] or 0.0)))
    names = AXES if in_space else ("its line",)
    late, felt = ([one[part] for one in went] for part in ("late", "felt"))
    return report | {
        "moved": {name: (one["along"], one["aside"]) for name, one in zip(names, went, strict=True)},
        "latency": None if None in late else max(late),
        "force_latency": max((one for one in felt if one is not None), default=None),
    }


def _out_and_back() -> Array:
    """A soft way from 0 to 1 and back, and a rest, a sample for each tick."""
    ticks = np.arange(round((SLOW_ENOUGH + LONGEST_LATENCY) / PERIOD)) * PERIOD / SLOW_ENOUGH
    return np.asarray(0.5 - 0.5 * np.cos(2.0 * math.pi * np.minimum(ticks, 1.0)))


def _went(moving: Watched, wanted: Array, axis: int, least: float) -> dict[str, Any]:
    """How a robot went along an axis: parts of the way, and how late it and its force were [s]."""
    from foretouch.session.latency import time_shift

    when, places, force = np.array(moving.times) - moving.times[0], moving.places - moving.places[0], moving.forces
    place, felt = places[:, axis], force[:, axis]
    along = float(np.dot(place, wanted) / np.dot(wanted, wanted))
    aside = np.ptp(np.delete(places, axis, axis=1), axis=0).max(initial=0.0) / np.ptp(wanted)
    late = time_shift(when, wanted, place / along, LONGEST_LATENCY) if abs(along) > 0.1 else None
    touched = np.ptp(felt) > max(least, TOUCHES) and np.ptp(place) > 0.0
    # Of an elastic contact the force is a multiple of the way.
    after = time_shift(when, place, felt * np.ptp(place) / np.ptp(felt), LONGEST_LATENCY) if touched else None
    return {"along": along, "aside": float(aside), "late": late, "felt": after}


def watch_device(device: Any, seconds: float) -> dict[str, Any]:
    """Figures of a device that rests, or is moved by a hand; it is given no force."""

    def ask() -> tuple[tuple[float, ...], tuple[float, ...]]:
        place = device.read(time.monotonic_ns())
        return (tuple(place) if isinstance(place, tuple) else (place,)), ()

    watched = Watched(ask)
    watched.take(round(seconds / PERIOD))
    own = device.specification
    carried = None if own is None else own.largest_stiffness(PERIOD)
    return watched.figures() | {"stiffness": carried, "damping": None if own is None else own.damping}


def main(what: str, name: str, seconds: str, move: str) -> None:
    """Make it, look at it, and print as JSON what came of it."""
    from foretouch.errors import ForetouchError

    try:
        report = _watched(what, name, float(seconds), float(move))
    except ForetouchError as error:
        report = {"problem": str(error)}
    sys.stdout.write("\n" + json.dumps(report) + "\n")


def _watched(what: str, name: str, seconds: float, move: float) -> dict[str, Any]:
    from foretouch.errors import SettingError

    try:
        machine = _made(what, name, "plane")  # in space, which shows more
    except SettingError:
        machine = _made(what, name, "")
    try:
        return watch_robot(machine, seconds, move) if what == "robot" else watch_device(machine, seconds)
    finally:
        machine.close()


def _made(what: str, name: str, scene: str) -> Any:
    from foretouch.devices import UNKNOWN_REACH
    from foretouch.session import SessionSettings, make_session_robot
    from foretouch.session.setup import setup_of

    if what == "robot":
        return make_session_robot(SessionSettings(robot=name, scene=scene))[0]
    return setup_of(SessionSettings(operator=name, scene=scene)).operator(UNKNOWN_REACH, lambda _: None)


if __name__ == "__main__":
    main(*sys.argv[1:])
