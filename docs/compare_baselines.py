"""Compare what is rendered from models with both baselines, and write what came out into `docs/baselines.md`.

Usage: `.venv/bin/python docs/compare_baselines.py`; it takes some minutes.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from measured_blocks import fill

from foretouch.devices import GRIPS, Device, Hand, ScriptedOperator
from foretouch.devices.device import minimum_jerk
from foretouch.messages import SessionLog
from foretouch.report import session_figures
from foretouch.robot import make_robot
from foretouch.session import SessionSettings, simulate

PAGE = Path(__file__).parent / "baselines.md"

ROUND_TRIPS = (0.0, 0.02, 0.4, 2.0)
"""[s], half of it in each direction."""

CASES = (
    ("foam-measured", "soft"),
    ("hunt-crossley", "stiff"),
    ("kelvin-voigt", "normal"),
)
"""Materials and grips of the table."""

STILL = 0.5
"""A hand that wants to stand and moves by less [mm] is stable."""


class Press(Device):
    """Touches once, for as long as the network needs to tell of it, leaves, and then presses for ever."""

    name = "scripted"
    closed_loop = False

    def __init__(self, surface: float, depth: float, round_trip: float) -> None:
        self._top, self._way = surface - 0.003, depth + 0.003
        move = max(0.5, 1.875 * self._way / 0.08)
        stay = move + 1.0 + 2.0 * round_trip
        self._move = move
        self._begins = (2.0, 2.0 + stay, 2.0 + 2.0 * stay)
        self.pressed = self._begins[-1] + move

    def read(self, now_ns: int) -> float:
        """Where it wants to be [m]."""
        time = now_ns * 1e-9
        first, back, again = (minimum_jerk((time - begin) / self._move) for begin in self._begins)
        return self._top * minimum_jerk(time / 1.5) + self._way * (first - back + again)

    def render(self, force: float) -> float:
        """Feels nothing."""
        return force


def run(settings: SessionSettings, round_trip: float | None = None) -> SessionLog:
    """Presses by script for 15 s; with a round trip [s], one that asks for 2 N and half the usual depth, held."""
    robot = make_robot(settings.material, seed=settings.seed)
    surface, depth, duration = robot.material.surface, robot.material.press_depth, 15.0
    intention: Device = ScriptedOperator(surface, depth)
    if round_trip is not None:
        intention = Press(surface, 0.5 * depth + 2.0 / GRIPS[settings.grip].stiffness, round_trip)
        duration = intention.pressed + 5.0 + 5.0 * round_trip
    operator = Hand(intention, GRIPS[settings.grip], settings.device)
    return simulate(settings, duration=duration, operator=operator, robot=robot).log


def surplus(log: SessionLog) -> float:
    """Largest energy that the hand was given beyond the bound of one tick [mJ]."""
    return max(-1e3 * float(np.min(log.leader["energy"] + log.leader["energy_bound"])), 0.0)


def measure(which: str, material: str, grip: str, round_trip: float) -> tuple[str, ...]:
    """Swing of a held press, its surplus, and the error of scripted presses."""
    settings = SessionSettings(
        material=material,
        grip=grip,
        position_delay=0.5 * round_trip,
        force_delay=0.5 * round_trip,
        baseline=which,
        model="contact-map" if which == "none" else "kelvin-voigt",  # nobody renders a baseline's: the quickest
    )
    held = run(settings, round_trip)
    tail = held.leader[-int(max(2000, 3000 * round_trip)) :]
    swing = 1e3 * float(np.ptp(tail["exact_hand_position"]))
    error = session_figures(run(settings))["rendered_error_percent"]
    return (
        f"**{swing:.2g}**" if swing > STILL else f"{swing:.2f}",
        _energy(surplus(held)),
        "–" if error is None else f"{error:.0f}",
    )


def _energy(value: float) -> str:
    return "0" if value < 5e-3 else f"{value:.2g}" if value < 10.0 else f"{value:.0f}"


def compared() -> Iterator[list[str]]:
    """The rows of the table, heads first."""
    yield ["Material", "Grip", "Round trip [ms]", "Models", "`delayed`", "`delayed-tdpa`"]
    for material, grip in CASES:
        for round_trip in ROUND_TRIPS:
            cells = [" / ".join(measure(which, material, grip, round_trip)) for which in WHICH]
            yield [material, grip, f"{1e3 * round_trip:.0f}", *cells]


WHICH = ("none", "delayed", "delayed-tdpa")


def main() -> None:
    """Measure the table, print it and write it into the page."""
    lines = []
    for row in compared():
        lines.append("| " + " | ".join(row) + " |")
        print(lines[-1], flush=True)
        if len(lines) == 1:
            lines.append("|" + " --- |" * len(row))
    fill(PAGE, {"compared": "\n".join(lines) + "\n"})


if __name__ == "__main__":
    main()
