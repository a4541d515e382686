"""Compare designs of a learner of contact maps, the shipped one and those that lost, and write what they gave.

Usage: `.venv/bin/python docs/compare_designs.py [TABLE ...]`, without names for all tables; `--files` prints every
recording instead of groups. Where all tables were measured, some of their lines go into the block `designs` of
`docs/contact-map.md`. It takes about three minutes on two cores.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Protocol

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from designs.basis import Features  # noqa: E402
from designs.kernels import Kernel  # noqa: E402
from designs.maps import Map  # noqa: E402
from designs.presses import COLUMNS, NAMES, Array, Press, press  # noqa: E402
from designs.shares import Shares, Shipped  # noqa: E402
from measured_blocks import chosen, fill  # noqa: E402

from foretouch.identification.contact_map.learning import PERIOD  # noqa: E402

PAGE = HERE / "contact-map.md"

ALONE = Features(plays=(), averages=())


class Design(Protocol):
    """Anything that predicts a recorded press, each sample from what was felt a delay before."""

    def predict(self, press: Press) -> tuple[Array, float]:
        """The late prediction at every sample [N], and the cost of an update [us], NaN where there is none."""


TABLES: dict[str, dict[str, Design]] = {
    "experts": {
        "shipped: law, coarse and fine map": Shipped(),
        "the same, zero of the springs not given": Shipped(told=False),
        "law and coarse map": Shipped(("law", "coarse")),
        "coarse and fine map": Shipped(("coarse", "fine")),
        "law and fine map": Shipped(("law", "fine")),
        "coarse map alone": Shipped(("coarse",)),
        "fine map alone": Shipped(("fine",)),
        "law alone": Shipped(("law",)),
    },
    "learners": {
        "coarse map, rebuilt here": Map(),
        "the same, fitted to the whole file": Map(whole=True, restart=False),
        "Gaussian process of 25 samples": Kernel(25),
        "Gaussian process of 50 samples": Kernel(50),
        "Gaussian process of 100 samples": Kernel(100),
        "the same, of samples more alike": Kernel(100, new=0.01),
        "the same, of samples nearly the same": Kernel(100, new=0.001),
        "local basis 0.5 mm and velocity, ridge": Map(ALONE, spacing=0.5, ridge=3.0, beyond="prior"),
        "local basis 1 mm and velocity, ridge": Map(ALONE, ridge=3.0, beyond="prior"),
        "local basis 1 mm, all features, ridge": Map(ridge=3.0, beyond="prior"),
        "local basis 1 mm, all features, ridge, held": Map(ridge=3.0),
    },
    "features": {
        "velocity, plays, averages": Map(),
        "no averages": Map(Features(averages=())),
        "no plays": Map(Features(plays=())),
        "neither (velocity)": Map(ALONE),
        "nothing but depth": Map(Features(velocity=False, plays=(), averages=())),
        "one play, 0.3 mm": Map(Features(plays=(3e-4,))),
        "three plays, to 1 mm": Map(Features(plays=(1e-4, 3e-4, 1e-3))),
        "two averages, no 1.5 s": Map(Features(averages=(0.05, 0.3))),
        "acceleration too": Map(Features(acceleration=True)),
        "features beyond their range": Map(clamp_features=False),
    },
    "forgetting": {
        "as shipped: 50 minutes, new beginning after a change": Map(),
        "none at all": Map(inflation=0.0, restart=False),
        "factor, 10 s": Map(forgetting=math.exp(-PERIOD / 10.0), inflation=0.0, restart=False),
        "factor, 3 s": Map(forgetting=math.exp(-PERIOD / 3.0), inflation=0.0, restart=False),
        "factor, 1 s": Map(forgetting=math.exp(-PERIOD / 1.0), inflation=0.0, restart=False),
        "towards the prior, 300 s": Map(inflation=1.0 / 300.0),
        "towards the prior, 30 s": Map(inflation=1.0 / 30.0),
        "towards the prior, 3 s": Map(inflation=1.0 / 3.0),
        "output multiplied by a gain": Map(gain=True),
        "a third of the noise": Map(noise=1.0 / 3.0),
        "three times the noise": Map(noise=3.0),
    },
    "shares": {
        "shipped": Shipped(),
        "shares as shipped, of these experts": Shares(),
        "power 2": Shares(power=2.0),
        "power 32": Shares(power=32.0),
        "late errors of 0.3 s": Shares(duration=0.3),
        "late errors of 5 s": Shares(duration=5.0),
        "errors one update ahead": Shares(late=False),
        "equal": Shares("equal"),
        "stacked, late": Shares("stacked"),
        "stacked, late, 5 s": Shares("stacked", duration=5.0),
        "stacked, one update ahead": Shares("stacked", late=False),
    },
    "beyond": {
        "last slope, held by the chord": Map(),
        "last slope": Map(beyond="tangent"),
        "chord": Map(beyond="chord"),
        "clamped at the deepest": Map(beyond="clamp"),
        "as the prior goes on": Map(beyond="prior"),
        "knots every 0.5 mm": Map(spacing=0.5),
        "knots every 2 mm": Map(spacing=2.0),
        "everything scaled to 0.5 mm": Map(length=5e-4),
        "everything scaled to 2 mm": Map(length=2e-3),
    },
}
"""What is compared, table by table; the first line of each is what the others depart from."""

ON_PAGE: dict[str, tuple[str, str]] = {
    "shipped: law, coarse and fine map": ("experts", "shipped: law, coarse and fine map"),
    "zero of the springs not given": ("experts", "the same, zero of the springs not given"),
    "without the fine map": ("experts", "law and coarse map"),
    "without the law": ("experts", "coarse and fine map"),
    "without the coarse map": ("experts", "law and fine map"),
    "equal weights": ("shares", "equal"),
    "fitted to the whole file": ("learners", "the same, fitted to the whole file"),
    "Gaussian process of 100 samples": ("learners", "Gaussian process of 100 samples"),
    "local basis and ridge": ("learners", "local basis 1 mm, all features, ridge"),
    "without memory": ("features", "neither (velocity)"),
    "forgetting in 3 s": ("forgetting", "factor, 3 s"),
    "clamped at the deepest": ("beyond", "clamped at the deepest"),
}
"""Lines of the page, by their titles there: table and design."""

SHOWN = ("Foam, median", "Foam, worst", "Springs", "Rigid", "Skin", "Laws", "Sudden", "Materials")
"""Columns of the page."""


def errors(name: str, designs: dict[str, Design]) -> dict[str, tuple[float, float]]:
    """Error [%] and cost [us] of these designs on one recording."""
    pressed = press(name)
    found = {}
    for title, design in designs.items():
        predicted, cost = design.predict(pressed)
        found[title] = pressed.error(predicted), cost
    return found


def measure(tables: list[str]) -> dict[str, dict[str, dict[str, tuple[float, float]]]]:
    """Error and cost by recording, table and design; two recordings at a time."""
    from joblib import Parallel, delayed

    jobs = [(name, table) for name in reversed(NAMES) for table in tables]
    if len(jobs) > len(NAMES):
        errors("tapping", {title: design for table in tables for title, design in list(TABLES[table].items())[:1]})
    done = Parallel(n_jobs=2)(delayed(errors)(name, TABLES[table]) for name, table in jobs)
    found: dict[str, dict[str, dict[str, tuple[float, float]]]] = {name: {} for name in NAMES}
    for (name, table), row in zip(jobs, done, strict=True):
        found[name][table] = row
    return found


def figure(value: float) -> str:
    """An error [%]."""
    if math.isnan(value):
        return "–"
    return f"{value:.1f}" if value < 100.0 else f"{min(value, 9999.0):.0f}"


def cells(title: str, rows: dict[str, dict[str, tuple[float, float]]]) -> dict[str, str]:
    """One design by the heads of its columns: median and worst of the foam, worst of each other group, cost."""
    by_name = {recording: row[title] for recording, row in rows.items()}
    foam = [by_name[recording][0] for recording in COLUMNS["foam"]]
    others = list(COLUMNS)[1:]
    worst = {key.capitalize(): figure(max(by_name[name][0] for name in COLUMNS[key])) for key in others}
    costs = [cost for _, cost in by_name.values()]
    cost = "–" if math.isnan(costs[0]) else f"{np.median(costs):.0f}"
    return {
        "Foam, median": figure(float(np.median(foam))),
        "Foam, worst": figure(max(foam)),
        **worst,
        "Cost [us]": cost,
    }


def summary(lines: dict[str, dict[str, str]]) -> str:
    """One line for each design, below the heads of its columns."""
    heads = list(next(iter(lines.values())))
    found = [["Design", *heads], ["---", *["--:"] * len(heads)]]
    found += [[title, *line.values()] for title, line in lines.items()]
    return "\n".join("| " + " | ".join(line) + " |" for line in found) + "\n"


def shown(found: dict[str, dict[str, dict[str, str]]]) -> str:
    """The lines and columns of the page, of the cells of all tables."""
    lines = {title: found[table][design] for title, (table, design) in ON_PAGE.items()}
    return summary({title: {head: line[head] for head in SHOWN} for title, line in lines.items()})


def by_file(rows: dict[str, dict[str, tuple[float, float]]], designs: dict[str, Design]) -> str:
    """One line for each recording, one column for each design, numbered."""
    lines = [f"{number}: {title}" for number, title in enumerate(designs)]
    lines.append(f"{'':22s}" + "".join(f"{number:8d}" for number in range(len(designs))))
    lines += [
        f"{recording:22s}" + "".join(f"{figure(row[title][0]):>8s}" for title in designs)
        for recording, row in rows.items()
    ]
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> None:
    """Measure these tables, or all; print them, and write what the page shows of all of them."""
    names = chosen([word for word in arguments if word != "--files"], TABLES)
    found = measure(names)
    written = {}
    for name in names:
        rows = {recording: tables[name] for recording, tables in found.items()}
        written[name] = {title: cells(title, rows) for title in TABLES[name]}
        print(
            f"{name}\n{by_file(rows, TABLES[name]) if '--files' in arguments else summary(written[name])}", flush=True
        )
    if PAGE.is_file() and len(written) == len(TABLES):
        fill(PAGE, {"designs": shown(written)})


if __name__ == "__main__":
    main(sys.argv[1:])
