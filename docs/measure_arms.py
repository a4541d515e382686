"""Measure sessions with the arms of the package beside the plain robot: the blocks of `docs/arms.md`.

Usage: `.venv/bin/python docs/measure_arms.py [line] [scenes] [speed] [held]`; all without arguments, in about twenty
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


def predicted(robot: str, material: str, scene: str, seed: int) -> tuple[float, float]:
    """Errors of the prediction, at equal command and with the same model at the robot's place [%]."""
    settings = SessionSettings(robot=robot, material=material, scene=scene, seed=seed)
    figures = session_figures(simulate(settings, duration=LENGTH, say=lambda _: None).log)
    return figures["prediction_error_percent"], figures["equal_position"]["prediction_error_percent"]


def errors(places: tuple[tuple[str, str], ...], heads: tuple[str, ...]) -> str:
    """A table of medians and worst cases by robot, with the ratio of the medians to those of the plain robot."""
    cases = [(robot, material, scene, seed) for robot in ROBOTS for material, scene in places for seed in SEEDS]
    found = dict(zip(cases, Parallel(n_jobs=2)(delayed(predicted)(*case) for case in cases), strict=True))
    rows, plain = [], {}
    for robot in ROBOTS:
        for place in places:
            several = [found[robot, *place, seed] for seed in SEEDS]
            errors, there = zip(*several, strict=True)
            median = statistics.median(errors)
            plain.setdefault(place, median)
            rows.append(
                [
                    f"`{robot}`",
                    place[1] or place[0],
                    f"{figure(median)} / {figure(max(errors))}",
                    f"{median / plain[place]:.2f}",
                    f"{figure(statistics.median(there))} / {figure(max(there))}",
                ]
            )
    return table(heads, rows)


def line() -> str:
    """Along a line, by material."""
    heads = ("`--robot`", "Material", "Prediction error [%]", "To that of `simulated`", "At the robot's place [%]")
    return errors(tuple((material, "") for material in MATERIALS), heads)


def scenes() -> str:
    """In scenes, with a camera."""
    heads = ("`--robot`", "Scene", "Prediction error [%]", "To that of `simulated`", "At the robot's place [%]")
    return errors((("hunt-crossley", "plane"), ("hunt-crossley", "hill")), heads)


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


def held() -> str:
    """Closed loops: the hand's energy, and whether it oscillates."""
    cases = [(robot, grip, late) for robot in ARMS for grip in ("soft", "normal", "stiff") for late in (0.3, 1.0)]
    rows = Parallel(n_jobs=2)(delayed(felt)(*case) for case in cases)
    heads = ("`--robot`, grip, delay", "Energy, least [uJ]", "Allowed [uJ]", "Kept in every tick", "Oscillates")
    return table((*heads, "Largest force, hand / robot [N]", "Prediction error [%]"), rows)


def felt(robot: str, grip: str, late: float) -> list[str]:
    """A row of a session in a closed loop, where 0.3 s stands for 80 ms of position delay and 1 s for 1 s of each."""
    ways = {"position_delay": 0.08 if late < 1.0 else 1.0, "force_delay": late}
    settings = SessionSettings(robot=robot, material="hunt-crossley", grip=grip, seed=SEEDS[0], **ways)
    figures = session_figures(simulate(settings, duration=LENGTH).log)
    hand = figures["hand"]
    return [
        f"`{robot}`, {grip}, {late:g} s",
        figure(1e6 * figures["net_energy_J"]),
        figure(-1e6 * figures["energy_bound_J"]),
        "yes" if hand["certificate_holds"] else "NO",
        "YES" if hand["oscillation"]["oscillates"] else "no",
        f"{hand['peak_force_hand_N']:.1f} / {hand['peak_force_robot_N']:.1f}",
        figure(figures["prediction_error_percent"]),
    ]


MEASURED = {"line": line, "scenes": scenes, "speed": speed, "held": held}


if __name__ == "__main__":
    for name in chosen(sys.argv[1:], MEASURED):
        text = MEASURED[name]()
        print(f"{name}\n\n{text}\n", flush=True)
        fill(PAGE, {name: text})
