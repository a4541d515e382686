"""Measure sessions with the arms of the package beside the plain robot: the blocks of `docs/arms.md`.

Usage: `.venv/bin/python docs/measure_arms.py [line] [speed]`; all without arguments, in about ten
minutes on two cores.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path

from joblib import Parallel, delayed
from measured_blocks import chosen, fill
from measuring import figure, table

from foretouch.report import session_figures
from foretouch.robot import ArticulatedArm, GantryArm, SpatialRobot, read_arm
from foretouch.session import SessionSettings
from foretouch.session.runners.simulated import simulate
from foretouch.settings import ARMS, SIMULATED

PAGE = Path(__file__).parent / "arms.md"

SEEDS = range(310, 318)
"""Nothing was chosen on these."""

ROBOTS = (SIMULATED, *ARMS)
MATERIALS = ("hunt-crossley", "kelvin-voigt", "foam-measured")
LENGTH = 20.0  # Of a session [s]


def predicted(robot: str, material: str, scene: str, seed: int) -> tuple[float, float] | None:
    """Errors of the prediction, at equal command and with the same model at the robot's place [%]; None without one."""
    settings = SessionSettings(robot=robot, material=material, scene=scene, seed=seed)
    figures = session_figures(simulate(settings, duration=LENGTH, say=lambda _: None).log)
    error, there = figures["prediction_error_percent"], figures["equal_position"]["prediction_error_percent"]
    return None if error is None or there is None else (error, there)


def errors(places: tuple[tuple[str, str], ...], heads: tuple[str, ...]) -> str:
    """A table of medians and worst cases by robot, with the ratio of the medians to those of the plain robot."""
    cases = [(robot, material, scene, seed) for robot in ROBOTS for material, scene in places for seed in SEEDS]
    found = dict(zip(cases, Parallel(n_jobs=2)(delayed(predicted)(*case) for case in cases), strict=True))
    rows, plain = [], {}
    for robot in ROBOTS:
        for place in places:
            several = [one for seed in SEEDS if (one := found[robot, *place, seed]) is not None]
            errors, there = zip(*several, strict=True)
            median = statistics.median(errors)
            plain.setdefault(place, median)
            rows.append(
                [
                    f"`{robot}`",
                    place[1] or place[0],
                    str(len(several)),
                    f"{figure(median)} / {figure(max(errors))}",
                    f"{median / plain[place]:.2f}",
                    f"{figure(statistics.median(there))} / {figure(max(there))}",
                ]
            )
    return table(heads, rows)


def line() -> str:
    """Along a line, by material."""
    heads = (
        "`--robot`",
        "Material",
        "Sessions with a score",
        "Prediction error [%]",
        "To that of `simulated`",
        "At the robot's place [%]",
    )
    return errors(tuple((material, "") for material in MATERIALS), heads)


def speed() -> str:
    """How long a simulated millisecond takes, in free air; and how much faster than real time a session runs."""
    rows = []
    for name in ROBOTS:
        took = sorted(exchange_times(name))
        begun = time.perf_counter()
        simulate(SessionSettings(robot=name, material="hunt-crossley"), duration=LENGTH)
        whole = LENGTH / (time.perf_counter() - begun)
        middle, late = took[len(took) // 2], took[int(0.99 * len(took))]
        rows.append([f"`{name}`", f"{1e6 * statistics.fmean(took):.0f}", f"{1e6 * middle:.0f}", f"{1e6 * late:.0f}"])
        rows[-1].append(f"{whole:.1f}")
    heads = ("`--robot`", "Mean of an exchange [us]", "Median [us]", "99 % [us]", "`simulate`, times real time")
    return table(heads, rows)


def exchange_times(name: str) -> list[float]:
    """Times of exchanges [s]."""

    def nothing(*_: object) -> tuple[float, float, float]:
        return 0.0, 0.0, 0.0

    plain = name == SIMULATED
    robot: SpatialRobot = GantryArm(nothing, seed=0) if plain else ArticulatedArm(read_arm(name), nothing, seed=0)
    took = []
    for k in range(5000):
        place = (0.0, 0.0, 0.05 - 1e-6 * k)
        begun = time.perf_counter()
        robot.exchange(place)
        took.append(time.perf_counter() - begun)
    return took


MEASURED = {"line": line, "speed": speed}


if __name__ == "__main__":
    for name in chosen(sys.argv[1:], MEASURED):
        text = MEASURED[name]()
        print(f"{name}\n\n{text}\n", flush=True)
        fill(PAGE, {name: text})
