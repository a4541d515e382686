"""Measure how hard the simulated arm presses with and without the safety layer, and write it into the page on safety.

- `impacts`: peak force where a ramp of commands drives the arm into walls, beside v sqrt(m K), and the figure of it.
- `unloading`: how soon each material is let go when the commands end.
- `in-the-way`: peak force in a spring that is put where the arm went through the air before.
- `sessions`: the largest force of whole sessions on every material, with every hand and over bad networks.

Usage: `.venv/bin/python docs/measure_impacts.py [TABLE ...]`, without names for all; it takes about ten minutes.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from measured_blocks import chosen, fill

from foretouch.devices import GRIPS, Device, Hand, ScriptedOperator
from foretouch.identification import Conditioner
from foretouch.models import KelvinVoigt
from foretouch.report import COLOURS, finished, new_figure
from foretouch.robot import MATERIALS, RcmArm, make_robot
from foretouch.robot.materials.catalogue import LinearResponse, Material
from foretouch.robot.materials.contacts import RelaxingContact
from foretouch.session import SessionSettings, simulate
from foretouch.session.safety import kernel
from foretouch.session.safety.safety import Safety, SafetyLimits

PAGE = Path(__file__).parent / "safety.md"
IMAGE = Path(__file__).parent / "images" / "safety-impacts.png"
TICK = 1e-3
CEILING, NO_LIMIT = 15.0, 1000.0
STIFFNESSES = (1e3, 3e3, 1e4, 3e4, 1e5)
SPEEDS = (0.02, 0.05, 0.1, 0.2, 0.4)
SHOWN, SHOWN_WALLS = SPEEDS[::2], STIFFNESSES[::2]
"""Speeds [m/s] and walls [N/m] of the table; the figure has all of them."""
MARKERS = "osv^D"  # one for each wall, for eyes and printers without colours
START, INSIDE = 0.02, 0.02
"""How far before the wall the ramp begins, and how far inside it ends [m]."""

NETWORKS: dict[str, dict[str, float]] = {
    "no delay": {"position_delay": 0.0, "force_delay": 0.0},
    "2 s": {"position_delay": 1.0, "force_delay": 1.0},
    "0.38 s and all faults": {
        "jitter": 0.05,
        "loss": 0.05,
        "burst": 5.0,
        "reorder": 0.1,
        "duplicate": 0.1,
        "outage": 0.7,
        "stall": 0.7,
    },
}
SECONDS = 6.0


def wall(stiffness: float) -> Material:
    """A spring that is so stiff when it is struck [N/m] and loses three tenths of it within 2 ms, as bone does here."""
    law = RelaxingContact(elastic=LinearResponse(stiffness), relaxation=((0.3, 0.002),))
    return Material("wall", "a wall", "for this measurement", law, press_depth=0.005, surface=START)


class Guarded:
    """The arm behind its conditioner and, unless it is raw, the safety layer, as in the follower."""

    def __init__(self, arm: RcmArm, *, raw: bool = False) -> None:
        self.arm, self.raw, self.sample = arm, raw, arm.read()
        specification = arm.specification
        limits = SafetyLimits(workspace=specification.workspace, mass=specification.moved_mass)
        self.safety, self.conditioner = Safety(limits, TICK), Conditioner()
        self.ticks, self.silence = 0, 0.0

    def tick(self, wanted: float, *, silent: bool = False) -> float:
        """One tick; the force after it [N]."""
        self.ticks += 1
        self.silence = self.silence + TICK if silent else 0.0
        if not self.raw:
            position, force = self.sample.position, self.sample.sensor_force
            force -= self.arm.specification.tool_force(self.sample.acceleration)
            felt = self.conditioner.update(TICK * self.ticks, position, force)
            sensed = position, felt.force, felt.in_contact, self.conditioner.surface, self.silence
            kernel.keep_safe(self.safety.memories, False, wanted, *sensed, False, False, -math.inf, False)
            wanted = kernel.limit(self.safety.memories)
        self.sample = self.arm.exchange(wanted)
        return self.sample.exact_force


def peak(stiffness: float, speed: float, *, raw: bool) -> float:
    """Largest force where the commands run into a wall twice [N]; the first time nobody knows where it is."""
    guarded = Guarded(make_robot(wall(stiffness), seed=1, force_limit=CEILING if raw else NO_LIMIT), raw=raw)
    way = round((START + INSIDE) / speed / TICK)
    ramp = [min(speed * TICK * tick, START + INSIDE) for tick in range(way + 1500)]
    return max(guarded.tick(place) for place in ramp + [0.0] * 600 + ramp)


def impacts() -> str:
    """Table of the peaks, and the figure."""
    cases = list(itertools.product(STIFFNESSES, SPEEDS, (True, False)))
    found = dict(zip(cases, Parallel(2)(delayed(peak)(k, v, raw=raw) for k, v, raw in cases), strict=True))
    mass = make_robot(wall(1e3), seed=1).specification.moved_mass
    lines = [
        "| Wall [kN/m] | " + " | ".join(f"{speed:g} m/s" for speed in SHOWN) + " |",
        "| --: |" + " --: |" * len(SHOWN),
    ]
    for stiffness in SHOWN_WALLS:
        cells = [
            f"{speed * math.sqrt(mass * stiffness):.1f} / {found[stiffness, speed, True]:.1f} / "
            f"**{found[stiffness, speed, False]:.1f}**"
            for speed in SHOWN
        ]
        lines.append(f"| {stiffness / 1e3:g} | {' | '.join(cells)} |")
    draw(found, mass)
    return "\n".join(lines) + "\n"


def draw(found: dict[tuple[float, float, bool], float], mass: float) -> None:
    """Peak force against speed: the formula, the raw path and the layer, a colour for each wall."""
    figure: Any = new_figure(4.4)
    raw, safe = figure.subplots(1, 2, sharey=True)
    speeds = np.array((0.0, SPEEDS[-1]))
    for number, stiffness in enumerate(STIFFNESSES):
        colour, marker = COLOURS[number], MARKERS[number]
        for axes, is_raw in ((raw, True), (safe, False)):
            peaks = [found[stiffness, speed, is_raw] for speed in SPEEDS]
            axes.plot(speeds, speeds * math.sqrt(mass * stiffness), ":", color=colour, linewidth=1.0)
            axes.plot(SPEEDS, peaks, f"{marker}-", color=colour, label=f"{stiffness / 1e3:g} kN/m", markersize=5)
    for axes, title in ((raw, "Without the layer, drive clipped at 15 N"), (safe, "With the layer, drive not clipped")):
        axes.axhline(CEILING, color="k", linewidth=1.0, zorder=0)
        axes.set(title=title, xlabel="speed of the commands [m/s]", ylim=(0.0, 62.0), xlim=(0.0, 0.41))
    safe.text(0.005, CEILING + 1.0, "ceiling, 15 N", fontsize=8)
    raw.set_ylabel("largest contact force [N]")
    raw.legend(title="wall; dotted: v sqrt(m K)", fontsize=8, title_fontsize=8, loc="upper left")
    finished(figure, 1).savefig(IMAGE, dpi=100)


def let_go(material: str) -> tuple[float, float]:
    """Force when the commands end [N], and time from then until it is below 1 N for good [s]."""
    guarded = Guarded(make_robot(material, seed=1, force_limit=NO_LIMIT))
    inside = guarded.arm.surface + 0.03
    pressed = [guarded.tick(inside) for _ in range(2500)][-1]
    forces = [guarded.tick(inside, silent=True) for _ in range(4000)]
    return pressed, TICK * max(tick + 1 for tick, force in enumerate(forces) if force >= 1.0)


def unloading() -> str:
    """Table of how soon a material is let go."""
    lines = ["| Material | Pressed with [N] | Below 1 N after the last command [s] |", "| --- | --: | --: |"]
    lines += [f"| {name} | {force:.1f} | {time:.2f} |" for name in sorted(MATERIALS) for force, time in [let_go(name)]]
    return "\n".join(lines) + "\n"


def met(stiffness: float, limit: float) -> float:
    """Largest force in a spring that stands where the arm has gone through the air five times before [N]."""
    law = KelvinVoigt(stiffness=stiffness, damping=1e-3)
    far, here, inside = 2.0 * START, START, 1.8 * START
    guarded = Guarded(
        make_robot(Material("s", "a spring", "this", law, press_depth=5e-3, surface=far), seed=1, force_limit=limit)
    )
    for _ in range(5):
        air = [guarded.tick(place) for place in [inside] * 2500 + [0.0] * 500]
        assert max(air) == 0.0
    guarded.arm.surface = here
    return max(guarded.tick(inside) for _ in range(400))


def in_the_way() -> str:
    """Table of springs that nobody expected where the air was free."""
    lines = [
        "| Spring [kN/m] | v sqrt(m K) [N] | Drive clipped at 15 N [N] | Not clipped [N] |",
        "| --: | --: | --: | --: |",
    ]
    for stiffness in STIFFNESSES:
        formula = SafetyLimits().speed * math.sqrt(SafetyLimits().mass * stiffness)
        forces = " | ".join(f"{met(stiffness, limit):.0f}" for limit in (CEILING, NO_LIMIT))
        lines.append(f"| {stiffness / 1e3:g} | {formula:.0f} | {forces} |")
    return "\n".join(lines) + "\n"


def largest(material: str, grip: str, network: str, first_touch: str) -> float:
    """Largest contact force of a session [N]; the arm's drive is not clipped."""
    settings = SessionSettings(material=material, grip=grip, first_touch=first_touch, **NETWORKS[network])  # type: ignore[arg-type]
    robot = make_robot(material, seed=0, force_limit=NO_LIMIT)
    operator: Device = ScriptedOperator(robot.surface, robot.material.press_depth, 0)
    if grip != "none":
        operator = Hand(operator, GRIPS[grip], settings.device)
    session = simulate(settings, duration=SECONDS, operator=operator, robot=robot)
    return float(np.max(session.log.follower["exact_force"]))


def sessions() -> str:
    """Table of the largest force on each material, over all hands, networks and both ways of the first touch."""
    hands = ("none", *sorted(GRIPS))
    cases = list(itertools.product(sorted(MATERIALS), hands, NETWORKS, ("guarded", "follow")))
    forces = dict(zip(cases, Parallel(2, verbose=1)(delayed(largest)(*case) for case in cases), strict=True))
    lines = ["| Material | Largest force [N] |", "| --- | --: |"]
    for material in sorted(MATERIALS):
        lines.append(f"| {material} | {max(force for case, force in forces.items() if case[0] == material):.1f} |")
    worst = max(cases, key=forces.__getitem__)
    lines += ["", f"{len(cases)} sessions; the largest force, {forces[worst]:.2f} N, was in {', '.join(worst)}."]
    return "\n".join(lines) + "\n"


TABLES: dict[str, Callable[[], str]] = {
    "impacts": impacts,
    "unloading": unloading,
    "in-the-way": in_the_way,
    "sessions": sessions,
}


def main(names: list[str]) -> None:
    """Print these tables, or all, and fill the page."""
    for name in chosen(names, TABLES):
        table = TABLES[name]()
        print(table)
        fill(PAGE, {name: table})


if __name__ == "__main__":
    main(sys.argv[1:])
