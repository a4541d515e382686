"""Measure how well spots are found in what was learnt.

Usage: `.venv/bin/python docs/measure_spots.py [rasters] [sessions]`; both without arguments. Rasters are those of
`docs/designs/rasters.py`; they fill the block `spots` of `docs/surfaces.md`, in some five minutes. Sessions are whole,
with images, touches and both delays; their table is printed, after half an hour on two cores.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from designs.places import LawAndScale  # noqa: E402
from designs.rasters import raster_over  # noqa: E402
from measure_scenes import simulated  # noqa: E402
from measured_blocks import chosen, fill  # noqa: E402
from measuring import figure, table  # noqa: E402

from foretouch.report import look_at_scene, pair  # noqa: E402
from foretouch.report.scene.map import PRESSED, stiffness_map  # noqa: E402
from foretouch.report.scene.spots import Spot, find_spots  # noqa: E402
from foretouch.session.spatial import Inclusion, Scene, make_scene  # noqa: E402
from foretouch.session.spatial.scenes import MIDDLE  # noqa: E402

PAGE = HERE / "surfaces.md"

SECONDS = 40.0  # Once over the whole specimen
RADIUS, FURTHEST = 0.008, 0.012
"""Of the inclusion, and how far from the middle it is, either way: all of it is where the hand goes [m]."""

RATIOS = {"twice as stiff": 2.0, "half as stiff": 0.5, "plain": 1.0}


class Found(NamedTuple):
    """What was found of an inclusion: the spot about its middle, if there is one, and all others."""

    inclusion: Inclusion
    spot: Spot | None
    false: int

    def errors(self) -> tuple[float, float, float, float]:
        """How far the place is off [mm], the radius [mm] and the ratio [%], and the number of deviations."""
        assert self.spot is not None
        off = 1e3 * np.hypot(*np.subtract(self.spot.middle, self.inclusion.middle[:2]))
        radius, ratio = self.spot.radius - self.inclusion.radius, self.spot.ratio / self.inclusion.ratio - 1.0
        return float(off), 1e3 * abs(radius), 100.0 * abs(ratio), self.spot.deviations


def phantom(ratio: float, seed: int) -> Scene:
    """The phantom with another inclusion, at a place of this seed."""
    x, y = np.random.default_rng([seed, 11]).uniform(-FURTHEST, FURTHEST, 2).tolist()
    inclusion = Inclusion((MIDDLE[0] + x, MIDDLE[1] + y, MIDDLE[2]), RADIUS, ratio)
    return dataclasses.replace(make_scene("phantom"), inclusion=inclusion)


def spots_of_raster(scene: Scene, material: str, seed: int) -> list[Spot]:
    """What is found in a raster."""
    felt, design = raster_over(scene, material, seed, SECONDS), LawAndScale()
    for tick in range(felt.time.size):
        design.learn(felt, tick)
    learnt = design.learner.learnt()
    if learnt.model is None:
        raise SystemExit("no law was learnt")
    touched = felt.point[felt.force > PRESSED][::10, :2]
    return find_spots(stiffness_map(touched, design.field(), learnt.model, scene, None, learnt.surface))


def spots_of_session(scene: Scene, material: str, seed: int) -> list[Spot]:
    """What is found in a whole session."""
    log = simulated(scene, SECONDS, material=material, scene="phantom", seed=seed)
    return list(look_at_scene(log, pair(log)).spots)


Finder = Callable[[Scene, str, int], list[Spot]]
"""What is found in a scene, of a material, with a seed."""


def found(finder: Finder, material: str, ratio: float, seed: int) -> Found:
    """The inclusion is found where a spot of its kind has its middle within the radius."""
    scene = phantom(ratio, seed)
    inclusion = scene.inclusion
    assert inclusion is not None
    spots = finder(scene, material, seed)
    its = [
        spot
        for spot in spots
        if (spot.ratio - 1.0) * (ratio - 1.0) > 0.0
        and np.hypot(*np.subtract(spot.middle, inclusion.middle[:2])) < RADIUS
    ]
    return Found(inclusion, its[0] if its else None, len(spots) - len(its[:1]))


def measured(finder: Finder, materials: tuple[str, ...], seeds: range) -> str:
    """A line for each material and inclusion: how many are found, and the median and worst error of these."""
    from joblib import Parallel, delayed

    cases = [(material, title) for material in materials for title in RATIOS]
    jobs = [(finder, material, RATIOS[title], seed) for material, title in cases for seed in seeds]
    results = Parallel(n_jobs=JOBS)(delayed(found)(*job) for job in jobs)
    rows = []
    for number, (material, title) in enumerate(cases):
        count = len(seeds)
        some = results[number * count : (number + 1) * count]
        errors = np.array([one.errors() for one in some if one.spot is not None]).reshape(-1, 4)
        hits = "–" if title == "plain" else f"{len(errors)} of {count}"
        cells = [f"{figure(float(np.median(one)))} / {figure(one.max())}" if one.size else "–" for one in errors.T[:3]]
        sure = figure(float(errors[:, 3].min())) if len(errors) else "–"
        rows.append([f"`{material}`, {title}", hits, str(sum(one.false for one in some)), *cells, sure])
    heads = ("Inclusion", "Found", "False", "Place off by [mm]", "Radius [mm]", "Ratio [%]", "Deviations, least")
    return table(heads, rows)


def rasters() -> str:
    """Rasters of two materials; the constants of the search were chosen on seeds below 10, and nothing on these."""
    return measured(spots_of_raster, ("hunt-crossley", "foam-measured"), range(100, 110))


def sessions() -> str:
    """Whole sessions, of the same seeds."""
    return measured(spots_of_session, ("hunt-crossley",), range(100, 110))


MEASURED = {"rasters": rasters, "sessions": sessions}
BLOCKS = {"rasters": "spots"}  # What is measured, and the block of the page that it fills
JOBS = 2


def main() -> None:
    """Measure what was asked for, and fill its block where it has one."""
    for name in chosen(sys.argv[1:], MEASURED):
        text = MEASURED[name]()
        print(f"{name}\n\n{text}", flush=True)
        fill(PAGE, {BLOCKS[name]: text} if name in BLOCKS else {})


if __name__ == "__main__":
    main()
