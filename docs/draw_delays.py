"""Draw the plots of prediction error against delay again, of every measured file and of the simulated recordings.

Usage: `.venv/bin/python docs/draw_delays.py [GROUP ...]`, without names for all groups; the images go to `docs/images`.
It takes some fifteen minutes on two cores.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from foretouch import comparison
from foretouch.recordings import excerpt, list_datasets

IMAGES = Path(__file__).parent / "images"

SKIN = comparison.Scoring(tuple(sorted({0.02, *comparison.SWEEP})), score_from=0.5, score_to=1.6)
"""A press of the skin lasts 0.25 s; outside this window the motor's control chatters off contact."""


def files(kind: str) -> list[comparison.Case]:
    """The measured recordings that the design was chosen on in which this kind of material is touched."""
    chosen = [dataset.name for dataset in list_datasets(kind) if dataset.seen]
    return [replace(comparison.file_case(excerpt(name)), name=name) for name in chosen]


GROUPS: dict[str, tuple[str, Callable[[], list[comparison.Case]], comparison.Scoring]] = {
    "foam": ("foam, measured", lambda: files("foam"), comparison.Scoring(comparison.SWEEP)),
    "spring": ("springs, measured", lambda: files("spring"), comparison.Scoring(comparison.SWEEP)),
    "rigid": ("something rigid, measured", lambda: files("rigid"), comparison.Scoring(comparison.SWEEP)),
    "skin": ("skin, measured, 0.5 to 1.6 s", lambda: files("skin"), SKIN),
    "simulated": (
        "simulated, without what nothing before t - delay could tell",
        comparison.simulated_cases,
        comparison.Scoring(comparison.SWEEP),
    ),
}
"""Title, recordings and scoring of each plot."""


def main(names: list[str]) -> None:
    """Draw these groups, or all."""
    unknown = set(names) - GROUPS.keys()
    if unknown:
        raise SystemExit(f"no such group: {', '.join(unknown)}; there are {', '.join(GROUPS)}")
    for name, (what, cases, scoring) in GROUPS.items():
        if names and name not in names:
            continue
        print(f"drawing {name}")
        figure = comparison.delay_figure(
            comparison.compare(cases(), scoring=scoring), f"Prediction error against delay: {what}"
        )
        figure.savefig(IMAGES / f"error-against-delay-{name}.png", dpi=90)


if __name__ == "__main__":
    main(sys.argv[1:])
