"""Measure how the numbers that notice a change of the material matter, halved and doubled, and write it into the page.

Presses of 1.25 s on two materials become softer or harder by six factors at five moments. Nothing changes in the
measured recordings and in simulated ones.

Usage: `.venv/bin/python docs/measure_changes.py`; it takes some ten minutes, for each variant compiles anew.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from measured_blocks import fill
from measuring import Row, figure, middle, table

from foretouch.comparison import simulate
from foretouch.identification import Learner, Status
from foretouch.identification.contact_map import learning, scores
from foretouch.models import advance
from foretouch.quantities import Recording
from foretouch.recordings import excerpt, list_datasets, read_recording
from foretouch.robot import make_material

PAGE = Path(__file__).parent / "contact-map.md"

CONSTANTS = {
    "SURE": scores,
    "CLEAR": scores,
    "YOUNG": learning,
    "LEARNING_TIME": scores,
    "CHANGED_FROM": learning,
}
"""Where they stand."""

MATERIALS, FACTORS = ("foam-measured", "hunt-crossley"), (0.3, 0.5, 0.7, 1.4, 2.0, 3.0)
MOMENTS = (8.7, 9.0, 9.3, 9.6, 9.9)  # [s]
UNCHANGED, SEEDS = (
    ("kelvin-voigt", "hunt-crossley", "continuous-switching", "tapping", "sponge", "foam", "hand"),
    range(6),
)
PERIOD = 1e-3  # [s]


def pressed(material: str, factor: float, at: float, seed: int = 0) -> tuple[Recording, np.ndarray]:
    """Presses of a material whose force is so many times as large from a moment [s] on; and the true force [N]."""
    law, time = make_material(material).model, np.arange(0.0, 13.0, PERIOD)
    size = 0.0055 * (0.8 + 0.2 * np.sin(2.0 * np.pi * 0.11 * time))
    depth = -0.002 + size * (1.0 - np.cos(2.0 * np.pi * 0.8 * np.maximum(time - 1.0, 0.0)))
    state, force = law.initial_state(), np.empty(time.size)
    for index, (x, v) in enumerate(zip(depth.tolist(), np.gradient(depth, time).tolist(), strict=True)):
        state, force[index], _ = advance(law, state, x, v, PERIOD)
    force[time >= at] *= factor
    noise = np.random.default_rng(seed).normal(0.0, 0.02, time.size)
    return Recording(time, np.round((0.01 + depth) / 5e-6) * 5e-6, force + 0.3 + noise), force


def said(recording: Recording, **settings: Any) -> list[float]:
    """When a change is said [s]."""
    learner, times = Learner(**settings), []
    for sample in zip(recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), strict=True):
        learner.update(*sample)
        if learner.status is Status.CHANGED:
            times.append(sample[0])
    return times


def noticed() -> dict[str, Any]:
    """How many changes are noticed, after how much contact [s], how many twice; and how many there are not."""
    after, once = [], 0
    for material in MATERIALS:
        for factor in FACTORS:
            for at in MOMENTS:
                recording, force = pressed(material, factor, at)
                times = said(recording)
                once += len(times) == 1
                if times and times[0] >= at:
                    felt = (recording.time >= at) & (recording.time < times[0]) & (force > 0.05)
                    after.append(PERIOD * int(felt.sum()))
    measured = (read_recording(excerpt(dataset.name)) for dataset in list_datasets())
    false = sum(len(said(recording, contact_floor=recording.contact_floor)) for recording in measured)
    simulated = sum(len(said(simulate(name, seed=seed).recording)) for name in UNCHANGED for seed in SEEDS)
    return {
        "noticed": len(after),
        "once": once,
        "contact": middle(after) if after else None,
        "longest": max(after, default=None),
    } | {
        "measured": false,
        "simulated": simulated,
    }


def variant(name: str, factor: float) -> dict[str, Any]:
    """`noticed` with one number changed, in a process and with compiled code of its own."""
    with tempfile.TemporaryDirectory() as kept:
        command = [sys.executable, __file__, name, str(factor)]
        done = subprocess.run(
            command, env=os.environ | {"NUMBA_CACHE_DIR": kept}, capture_output=True, text=True, check=True
        )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def row(what: str, found: dict[str, Any]) -> Row:
    """A line of the table."""
    presses = len(MATERIALS) * len(FACTORS) * len(MOMENTS)
    contact = f"{figure(found['contact'])} / {figure(found['longest'])}"
    counts = [str(found[key]) for key in ("measured", "simulated")]
    return [what, f"{found['noticed']} of {presses}", str(found["once"]), contact, *counts]


def changes() -> str:
    """The numbers as they are, halved and doubled."""
    asked = [("SURE", 1.0), *((name, factor) for name in CONSTANTS for factor in (0.5, 2.0))]
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda one: variant(*one), asked))
    words = {0.5: "halved", 1.0: "shipped", 2.0: "doubled"}
    named = ["shipped", *(f"`{name}` {words[factor]}" for name, factor in asked[1:])]
    heads = ("Number", "Noticed", "Once", "After contact, median / longest [s]", "False, measured", "False, simulated")
    return table(heads, [row(what, one) for what, one in zip(named, found, strict=True)])


def main() -> None:
    """Fill the table."""
    fill(PAGE, {"changes": changes()})


if __name__ == "__main__":
    if sys.argv[1:]:
        constant, times = sys.argv[1], float(sys.argv[2])
        module = CONSTANTS[constant]
        setattr(module, constant, times * getattr(module, constant))
        print(json.dumps(noticed()))
    else:
        main()
