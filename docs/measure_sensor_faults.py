"""Measure how soon faults of the sensors are found, and how hard a robot presses with them, and write the tables.

- `sensor-faults`, on the page of the room: how soon `SensorWatch` finds each fault of `FaultySensor`. The simulated arm
  presses every material 0.8 times a second; each fault begins at eight phases of the press, and once more where the arm
  stands still. The watch is told what tool weight and inertia make of the force.
- `lying-sensors`, on the page on safety: what a follower does whose force sensor begins to lie while it presses a
  material with all that it may, told to be 30 mm deep, and two seconds later.
- `blind-sensors`, on the same page: the same of faults from the start, or that come while it moves out or in free
  air, before the robot is told to go 30 mm deep once more.

Usage: `.venv/bin/python docs/measure_sensor_faults.py [TABLE ...]`, without names for all; it takes some minutes.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from measured_blocks import chosen, fill

from foretouch.identification import SensorState, SensorWatch
from foretouch.messages import VERSION, Command
from foretouch.robot import MATERIALS, SENSOR_FAULTS, FaultySensor, RobotSample, SensorFault, make_robot
from foretouch.session import SessionSettings
from foretouch.session.steps import follower

SAFETY_PAGE = Path(__file__).parent / "safety.md"
PAGE = Path(__file__).parent / "rooms" / "identification.md"
PERIOD, BEFORE, AFTER = 1.25, 1.5, 2.0
PHASES = tuple(BEFORE + step * PERIOD / 8.0 for step in range(8))


def press(time: float, surface: float) -> float:
    """Position of a hand that presses and comes back out [m]."""
    return surface + 0.006 * math.sin(2.0 * math.pi * time / PERIOD) - 0.002


def delay(kind: str, material: str, begin: float, motion: Callable[[float, float], float]) -> tuple[float, SensorState]:
    """From the first wrong sample until something is found [s], infinite for nothing in 2 s; and what was found."""
    arm = make_robot(material, seed=1)
    robot = FaultySensor(arm, SensorFault(kind, begin), seed=2)
    watch = SensorWatch((-robot.specification.sensor_range, robot.specification.sensor_range))
    period, first = robot.specification.sample_period, math.nan
    for tick in range(1, round((begin + AFTER) / period)):
        sample = robot.exchange(motion(tick * period, arm.surface))
        tool_force = robot.specification.tool_force(sample.acceleration)
        if robot.faulty and math.isnan(first):
            first = tick * period
        state = watch.update(tick * period, sample.position, sample.sensor_force, tool_force)
        if state is not SensorState.GOOD:
            return tick * period - first, state
    return math.inf, SensorState.GOOD


def row(kind: str) -> str:
    """What is found of one fault, over all materials and phases."""
    moving = [delay(kind, material, begin, press) for material in MATERIALS for begin in PHASES]
    still = [delay(kind, material, BEFORE, lambda _, surface: surface - 0.005) for material in MATERIALS]
    found = sorted({state.name for wait, state in moving + still if wait < math.inf})
    waits = sorted(wait for wait, _ in moving)
    missed = sum(wait == math.inf for wait in waits)
    known = [wait for wait in waits if wait < math.inf]
    largest = f"{1e3 * known[-1]:.0f}" if known else "–"
    rest = max(wait for wait, _ in still)
    return (
        f"| `{kind}` | {', '.join(f'`{name}`' for name in found)} | {1e3 * waits[len(waits) // 2]:.0f} | {largest} "
        f"| {missed} of {len(waits)} | {1e3 * rest:.0f} |"
    )


def sensor_faults() -> str:
    """Table of how soon each fault is found."""
    head = "| Fault | Found as | Median [ms] | Largest [ms] | Not within 2 s | Still, largest [ms] |"
    return "\n".join([head, "| --- | --- | --: | --: | --: | --: |", *(row(kind) for kind in SENSOR_FAULTS)]) + "\n"


# --- sensors that lie -------------------------------------------------------------------------------------------------

OFFSET, NOISE = 0.3, 0.02
"""What the arm's sensor shows in free air, and its noise [N]."""
PRESSED, LIES, LATE = 4.0, 2.0, 20
"""When the sensor begins to lie, and for how long it is looked at [s]; how many ticks a late one is late."""
DRIVES = ((1000.0, True), (1000.0, False), (15.0, False))
"""Where the drive is clipped [N], and whether it tells its effort."""
PRESSED_MATERIALS = ("bone", "foam", "hand", "hunt-crossley", "kelvin-voigt")

Lie = Callable[[float, float, float, deque[float]], float]
"""What is shown of a force [N], so long after it began [s], with a draw of noise and the forces so far [N]."""

LIES_OF: dict[str, Lie] = {
    "shows its offset and noise": lambda force, time, noise, past: OFFSET + NOISE * noise,
    "shows exactly 0": lambda force, time, noise, past: 0.0,
    "its sign is turned": lambda force, time, noise, past: -force,
    "ends at 8 N": lambda force, time, noise, past: min(force, 8.0 + NOISE * noise),
    "late by 20 ms": lambda force, time, noise, past: past[0],
    "half": lambda force, time, noise, past: OFFSET + (force - OFFSET) / 2.0,
    "5 N less": lambda force, time, noise, past: force - 5.0,
    "drifts by -1 N/s": lambda force, time, noise, past: force - time,
    "drifts by -5 N/s": lambda force, time, noise, past: force - 5.0 * time,
    "stuck": lambda force, time, noise, past: past[-1] if time == 0.0 else math.nan,
}


class Case(NamedTuple):
    """A lie, when it begins at the earliest [s], below which force [N], and whether the robot goes out before."""

    lie: Lie
    begins: float
    below: float = math.inf
    goes_out: bool = False


OUT, IN = 2.0, 3.0
"""When a robot that goes out is told so, and when it is told to go in again [s]."""

DEAD = LIES_OF["shows its offset and noise"]
BLIND: dict[str, Case] = {
    "shows its offset and noise, from the start": Case(DEAD, 0.0),
    "shows exactly 0, from the start": Case(LIES_OF["shows exactly 0"], 0.0),
    "its sign is turned, from the start": Case(LIES_OF["its sign is turned"], 0.0),
    "half, from the start": Case(LIES_OF["half"], 0.0),
    "ends at 8 N, from the start": Case(LIES_OF["ends at 8 N"], 0.0),
    "drifts by -1 N/s, from the start": Case(LIES_OF["drifts by -1 N/s"], 0.0),
    "dies while the probe moves out, at 5 N": Case(DEAD, OUT, below=5.0, goes_out=True),
    "dies while the probe moves out, at 1 N": Case(DEAD, OUT, below=1.0, goes_out=True),
    "dies in the air, after a press": Case(DEAD, 0.5 * (OUT + IN), below=0.0, goes_out=True),
}
"""Faults that are there before the robot presses; the last three go in a second time."""


def pressed(case: Case, material: str, limit: float, tells: bool) -> tuple[float, float]:
    """Largest force under the fault [N], and how long after the first touch under it that was found [s].

    Infinite if it was not, negative if it was before. For a robot that goes out, the touch is the next one.
    """
    arm, numbers = make_robot(material, seed=1, force_limit=limit), np.random.default_rng(2)
    settings = SessionSettings(material=material, model="kelvin-voigt", first_touch="follow")
    state, sample = follower.start(arm.specification, settings), arm.read()
    past: deque[float] = deque([sample.sensor_force], LATE)
    largest, found, shown = 0.0, math.inf, 0.0
    began = touched = math.inf
    for tick in range(1, round(1e3 * (PRESSED + LIES))):
        now, time = tick * 1_000_000, 1e-3 * tick
        is_in = time > 0.3 and not (case.goes_out and OUT <= time < IN)
        command = Command(VERSION, tick, now, arm.surface + 0.03 if is_in else 0.0, 0, False, "this", 1)
        state, said = follower.step(state, follower.Inputs([command], sample, 1_000_000, 0), now)
        raw: RobotSample = arm.exchange(said.desired_position)
        sample = raw if tells else raw._replace(effort=math.nan)
        if time >= case.begins and raw.exact_force <= case.below:
            began = min(began, time)
        if time >= began:
            lie = case.lie(raw.sensor_force, time - began, float(numbers.standard_normal()), past)
            shown = shown if math.isnan(lie) else lie
            sample = sample._replace(sensor_force=shown)
            largest = max(largest, raw.exact_force)
            if raw.exact_force > 0.0 and not (case.goes_out and time < IN):
                touched = min(touched, time)
            if state.watch.state is not SensorState.GOOD and math.isinf(found):
                found = time
        past.append(raw.sensor_force)
    return largest, found if math.isinf(found) else found - touched


def lying_sensors() -> str:
    """Table of what begins while the robot presses."""
    return table_of({kind: Case(lie, PRESSED) for kind, lie in LIES_OF.items()})


def blind_sensors() -> str:
    """Table of what is there from the start, or begins while it moves out or in free air."""
    return table_of(BLIND)


def last_of(waits: list[float]) -> str:
    """When the last one was found [ms], or how many were not."""
    if math.inf in waits:
        return f"{waits.count(math.inf)} of {len(waits)} not"
    return f"{1e3 * max(waits):.0f}" if max(waits) >= 0.0 else "before"


def table_of(kinds: dict[str, Case]) -> str:
    """When each is found if the drive tells its effort, and how hard it presses, the worst of five materials."""
    cases = [(kind, material, *drive) for kind in kinds for drive in DRIVES for material in PRESSED_MATERIALS]
    measured = Parallel(2)(delayed(pressed)(kinds[kind], *rest) for kind, *rest in cases)
    done = dict(zip(cases, measured, strict=True))
    lines = [
        "| The sensor | Found after [ms] | Largest force [N] | Without the effort [N] | Drive clipped at 15 N [N] |",
        "| --- | --: | --: | --: | --: |",
    ]
    for kind in kinds:
        found = [[done[kind, material, *drive] for material in PRESSED_MATERIALS] for drive in DRIVES]
        forces = [f"{max(force for force, _ in each):.1f}" for each in found]
        lines.append(f"| {kind} | {last_of([when for _, when in found[0]])} | {' | '.join(forces)} |")
    return "\n".join(lines) + "\n"


TABLES: dict[str, tuple[Path, Callable[[], str]]] = {
    "sensor-faults": (PAGE, sensor_faults),
    "lying-sensors": (SAFETY_PAGE, lying_sensors),
    "blind-sensors": (SAFETY_PAGE, blind_sensors),
}


def main(names: list[str]) -> None:
    """Print these tables, or all, and fill the pages."""
    for name in chosen(names, TABLES):
        page, measure = TABLES[name]
        table = measure()
        print(table)
        fill(page, {name: table})


if __name__ == "__main__":
    main(sys.argv[1:])
