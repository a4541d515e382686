"""Measure what a remembered map changes, of the same and of other materials, and write it into the page.

Sessions of 15 s over simulated materials, and the measured recordings; every map is one that was learnt from another
press. The error is that of forces 0.3 s late, from 1.5 s on.

Usage: `.venv/bin/python docs/measure_memory.py`; it takes some two minutes.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
from measured_blocks import fill
from measuring import figure, table

from foretouch.identification import ContactMap, Learner, predict
from foretouch.models import ContactMapModel
from foretouch.quantities import Recording
from foretouch.recordings import excerpt, list_datasets, read_recording
from foretouch.report import delayed_force, lowest_mean, score_prediction
from foretouch.session import SessionSettings, simulate

PAGE = Path(__file__).parent / "contact-map.md"

MATERIALS = ("kelvin-voigt", "hunt-crossley", "foam", "foam-measured", "sponge", "hand", "thin-layer", "bone")
SEEDS = (200, 201)
DELAY = 0.3  # [s]
OTHERS = ("200", "201")  # Which press of another simulated material is pressed, and which is remembered

Press = tuple[str, str]  # Material, and which press of it


def presses() -> Iterator[tuple[Press, Recording]]:
    """What is pressed."""
    for material, seed in product(MATERIALS, SEEDS):
        log = simulate(SessionSettings(material=material, seed=seed, jitter=0.01), duration=15.0).log
        rows = log.follower[log.follower["command_sequence"] > 0]
        time = (rows["time_ns"] - rows["time_ns"][0]) * 1e-9
        yield (material, str(seed)), Recording(time, rows["position"], rows["sensor_force"])
    for dataset in list_datasets():
        for kind in ("foam", "rigid", "spring"):
            if kind in dataset.name:
                yield (f"measured {kind}", dataset.name), read_recording(excerpt(dataset.name))


def error(recording: Recording, spring: bool, memory: ContactMapModel | None) -> tuple[float, ContactMap]:
    """Prediction error [%], and the estimator; a spring that is never left has the zero that is its lowest mean."""
    estimator = ContactMap()
    if memory is not None:
        estimator.recall(memory)
    zero = lowest_mean(recording.time, recording.force) if spring else None
    learner = Learner(estimator, contact_floor=recording.contact_floor, force_offset=zero)
    predicted = predict(recording, learner, delay=DELAY).force
    known = delayed_force(recording.time, recording.force, DELAY)
    scores = score_prediction(
        recording.time,
        recording.force,
        predicted,
        known,
        contact_floor=recording.contact_floor,
        position=recording.position,
        score_from=1.5,
    )
    return float(scores.prediction_error_percent), estimator


def memory() -> str:
    """How the error changes, by what is pressed and what is remembered."""
    every = dict(presses())
    alone = {press: error(one, "spring" in press[0], None) for press, one in every.items()}
    groups: dict[tuple[str, str], list[tuple[float, bool]]] = {}
    for pressed, before in product(every, every):
        known = alone[before][1].remembered
        measured = "measured" in pressed[0]
        if known is None or pressed == before or measured != ("measured" in before[0]):
            continue
        same = pressed[0] == before[0]
        if not (same or measured or (pressed[1], before[1]) == OTHERS):
            continue
        with_it, estimator = error(every[pressed], "spring" in pressed[0], known)
        kind = (pressed[0], "the same" if same else "others")
        groups.setdefault(kind, []).append((with_it - alone[pressed][0], estimator.recalls == "dropped"))
    rows = []
    for (pressed_name, remembered), found in groups.items():
        changes = [change for change, _ in found]
        first = float(np.median([value for (name, _), (value, _) in alone.items() if name == pressed_name]))
        middle, best, worst = float(np.median(changes)), min(changes), max(changes)
        dropped = f"{sum(gone for _, gone in found)} of {len(found)}"
        rows.append(
            [pressed_name, remembered, dropped, figure(first), *(f"{change:.2f}" for change in (middle, best, worst))]
        )
    head = ("Pressed", "Remembered", "Dropped", "Error without [%]", "Change, median [points]", "best", "worst")
    return table(head, rows)


if __name__ == "__main__":
    fill(PAGE, {"memory": memory()})
