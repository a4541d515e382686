"""Compare designs of a material over a surface on the same rasters, the shipped one and those that lost.

Usage: `.venv/bin/python docs/compare_places.py`; it fills the block `places` of `docs/surfaces.md`, in some five
minutes on two cores.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from designs import places  # noqa: E402
from designs.rasters import raster  # noqa: E402
from measured_blocks import fill  # noqa: E402
from measuring import figure, table  # noqa: E402

PAGE = HERE / "surfaces.md"

DESIGNS: dict[str, Callable[[], places.Design]] = {
    "shipped: one law, and a scale at each place": places.LawAndScale,
    "the same, 1 at once beyond what was touched": places.WithoutNeighbours,
    "the same, the law learns all that the scale leaves": places.LawOfAll,
    "one law, and a Gaussian process of all nodes": places.WholeProcess,
    "one law alone": places.OneLaw,
    "a law in each cell of 6 mm": places.LawInEachCell,
    "a quadratic law at each node of 6 mm": places.QuadraticField,
}

MATERIALS, SEEDS = ("hunt-crossley", "foam-measured"), (101,)
"""Nothing was chosen on this seed."""


def errors(title: str, scene: str, material: str, seed: int) -> tuple[float, float]:
    """Error of a design in all, and where the past could tell [%]."""
    recorded = raster(scene, material, seed)
    predicted = places.predicted(DESIGNS[title](), recorded)
    return recorded.error(predicted), recorded.error(predicted, recorded.told())


def compared() -> str:
    """A line for each design: medians, and the worst, over materials and seeds."""
    from joblib import Parallel, delayed

    jobs = [
        (title, scene, material, seed)
        for seed in SEEDS
        for material in MATERIALS
        for scene in ("hill", "phantom")
        for title in DESIGNS
    ]
    found = dict(zip(jobs, Parallel(n_jobs=2)(delayed(errors)(*job) for job in jobs), strict=True))
    rows = []
    for title in DESIGNS:
        cells = [title]
        for scene in ("hill", "phantom"):
            for which in (1, 0):
                some = [both[which] for job, both in found.items() if job[:2] == (title, scene)]
                cells.append(f"{figure(float(np.median(some)))} / {figure(max(some))}")
        rows.append(cells)
    heads = ("Design", "Hill, told", "Hill, all", "Phantom, told", "Phantom, all")
    return table(heads, rows)


if __name__ == "__main__":
    text = compared()
    print(text)
    fill(PAGE, {"places": text})
