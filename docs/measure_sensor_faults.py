"""Measure how soon `SensorWatch` finds each fault of `FaultySensor`, and write the table into the page of the room.

The simulated arm presses every material 0.8 times a second; each fault begins at eight phases of the press, and once
more where the arm stands still. The watch is told what tool weight and inertia make of the force.

Usage: `.venv/bin/python docs/measure_sensor_faults.py`; it takes about a minute.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from measured_blocks import fill

from foretouch.identification import SensorState, SensorWatch
from foretouch.robot import MATERIALS, SENSOR_FAULTS, FaultySensor, SensorFault, make_robot

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


def main() -> None:
    """Print the table and fill the page."""
    head = "| Fault | Found as | Median [ms] | Largest [ms] | Not within 2 s | Still, largest [ms] |"
    lines = [head, "| --- | --- | --: | --: | --: | --: |", *(row(kind) for kind in SENSOR_FAULTS)]
    print("\n".join(lines))
    fill(PAGE, {"sensor-faults": "\n".join(lines) + "\n"})


if __name__ == "__main__":
    main()
