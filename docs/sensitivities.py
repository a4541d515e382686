"""Halve and double every tuned number of the learner, and write what that does to the errors into the page.

Usage: `.venv/bin/python docs/sensitivities.py [MODULE ...]`, such as `scores`, without names for all. What was measured
of these sources is kept, so that it goes on where it stopped; the page is written where all is there. All of it takes
some 20 minutes on two cores.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from statistics import median
from time import monotonic
from typing import NamedTuple

from beyond_files import CASES, MATERIALS, harder
from designs import tuned
from designs.tuned import COMPILED, MODULES, SOURCES, keys
from measured_blocks import chosen, fill
from measuring import figure, table

from foretouch.comparison import SIMULATED, simulate, unforeseeable
from foretouch.comparison.combination import score_outside
from foretouch.identification.force_calibration import zero_in_hindsight
from foretouch.quantities import Array, Recording
from foretouch.recordings import excerpt, list_datasets, read_recording
from foretouch.report import Forces, delayed_force

PAGE, MAP = (Path(__file__).parent / name for name in ("sensitivities.md", "contact-map.md"))
KEPT = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "foretouch" / "tuned"
SEEDS = (100, 101)
"""Of the simulated recordings; nothing was chosen on them."""

ASKED = (
    "layer 66 times as hard, in it from the second touch",
    "wall 3 mm further in",
    "zero that drifts by 0.05 N/s",
    "sensor that says 0 for its first 0.1 s",
    "noise of 0.1 N",
    "friction of the mechanism, 0.3 N",
    "`adhesive`, against the true force",
)
"""Of the cases beyond the files, one of each kind."""

FACTORS = {0.5: "halved", 2.0: "doubled"}

Errors = dict[str, float]


@cache
def digest() -> str:
    """Of all sources that a variant can depend on."""
    found = hashlib.sha256()
    for path in (*sorted((SOURCES / "foretouch").rglob("*.py")), Path(tuned.__file__), Path(__file__)):
        found.update(path.read_bytes())
    return found.hexdigest()[:10]


class Scored(NamedTuple):
    """A recording, its delay, the zero that its learner is told, and the error [%] of what is predicted for it."""

    kind: str
    recording: Recording
    delay: float  # [s]
    zero: float | None  # [N]
    error: Callable[[Array], float | None]


@cache
def recordings() -> dict[str, Scored]:
    """All measured files in contact, the simulated recordings, and the presses that are asked for beyond them."""
    found = {
        dataset.name: measured(dataset.name, dataset.kind) for dataset in list_datasets() if dataset.kind != "free"
    }
    found |= {f"{name}, seed {seed}": simulated(name, seed) for seed in SEEDS for name in SIMULATED}
    cases = {what: CASES[what][1] for what in ASKED}
    cases |= {
        f"{name} times {factor:g}": harder(name, factor, 9.3)
        for name, factor in zip(MATERIALS, (0.5, 2.0), strict=True)
    }
    for what, made in cases.items():
        recording, error = made(SEEDS[0])
        found[what] = Scored("asked", recording, 0.3, None, error)
    return found


def measured(name: str, kind: str) -> Scored:
    """As `foretouch predict` scores it; the springs, which never leave contact, with their zero given."""
    recording = read_recording(excerpt(name))
    time, force, floor = recording.time, recording.force, recording.contact_floor
    zero, _ = zero_in_hindsight(time, force, recording.position, floor)
    delay, window = (0.02, (0.5, 1.6)) if kind == "skin" else (0.3, (1.5, None))
    known = delayed_force(time, force - zero, delay)

    def error(predicted: Array) -> float | None:
        forces = Forces(time, recording.position, force, predicted, known, floor)
        return score_outside(forces, None, score_from=window[0], score_to=window[1]).prediction_error_percent

    return Scored(kind, recording, delay, zero if kind == "spring" else None, error)


def simulated(name: str, seed: int) -> Scored:
    """As `foretouch compare --simulated` scores it, without what nothing before t - delay could tell."""
    recording, truth = (one := simulate(name, seed=seed)).recording, one.truth
    hidden = unforeseeable(recording.time, truth.depth, 0.3, truth.changes)
    known = delayed_force(recording.time, recording.force, 0.3)

    def error(predicted: Array) -> float | None:
        columns = recording.time, recording.position, recording.force, predicted, known, recording.contact_floor
        return score_outside(Forces(*columns), hidden, score_from=3.0).prediction_error_percent

    return Scored("simulated", recording, 0.3, None, error)


class Server:
    """A process that has everything compiled, and predicts all recordings in a copy of itself for each variant.

    Args:
        key: Of a number that is multiplied before anything is compiled, if there is one.
        factor: By what.
    """

    def __init__(self, key: str = "", factor: float = 1.0) -> None:
        self._folder = tempfile.TemporaryDirectory()
        given, here = Path(self._folder.name, "given"), Path(self._folder.name)
        told = {name: (one.recording, one.delay, one.zero) for name, one in recordings().items()}
        given.write_bytes(pickle.dumps(told))
        compiled = here if key in COMPILED else KEPT / digest() / "compiled"
        environment = os.environ | {"NUMBA_CACHE_DIR": str(compiled), "NUMBA_OPT": "1"}
        command = [sys.executable, tuned.__file__, str(given), *([key, str(factor)] if key else [])]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._process = subprocess.Popen(command, env=environment, **pipes)

    def errors(self, key: str, factor: float) -> Errors:
        """With one number times a factor [%]."""
        forces = Path(self._folder.name, "forces")
        print(key, factor, forces, file=self._process.stdin, flush=True)
        if self._process.stdout.readline().strip() != "0":
            raise SystemExit(f"{key} times {factor:g} cannot be predicted")
        predicted = pickle.loads(forces.read_bytes())
        return {name: one.error(predicted[name]) or math.inf for name, one in recordings().items()}

    def close(self) -> None:
        """End the process."""
        self._process.stdin.close()
        self._process.wait()
        self._folder.cleanup()


IDLE: SimpleQueue[Server] = SimpleQueue()
"""Servers of the numbers as they are."""


def variant(key: str, factor: float) -> Errors:
    """Errors with one number times a factor; kept until a source changes."""
    path = KEPT / digest() / f"{key}-{factor:g}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file():
        if key in COMPILED and factor != 1.0:
            server = Server(key, factor)
            errors = server.errors("none", 1.0)
            server.close()
        else:
            server = Server() if IDLE.empty() else IDLE.get()
            errors = server.errors(key, factor)
            IDLE.put(server)
        path.write_text(json.dumps(errors))
    found: Errors = json.loads(path.read_text())
    return found


Cells = dict[str, float]
"""Errors [%] by the heads of their columns."""


def cells(errors: Errors) -> Cells:
    """Of one variant: by what is touched."""
    by_kind: dict[str, list[float]] = {}
    for name, one in recordings().items():
        by_kind.setdefault(one.kind, []).append(errors[name])
    return {head: summed(by_kind[kind]) for head, (kind, summed) in COLUMNS.items()}


COLUMNS: dict[str, tuple[str, Callable[[list[float]], float]]] = {
    "Foam, median": ("foam", median),
    "Foam, worst": ("foam", max),
    "Rigid, median": ("rigid", median),
    "Rigid, worst": ("rigid", max),
    "Spring, worst": ("spring", max),
    "Skin, worst": ("skin", max),
    "Simulated, median": ("simulated", median),
    "Asked, median": ("asked", median),
}

LEAST = 0.02
"""Least change of an error, as a fraction of itself, that counts."""


def moves(error: float, shipped: float) -> bool:
    """Whether an error is another one."""
    return abs(error - shipped) > LEAST * shipped


def pair(halved: float, doubled: float, shipped: float) -> str:
    """Both of a column, in bold what has moved."""
    return " / ".join(f"**{figure(one)}**" if moves(one, shipped) else figure(one) for one in (halved, doubled))


def loser(found: tuple[Errors, ...], shipped: Errors) -> str:
    """The recording that loses most, and what its error is multiplied by."""
    ratio, name = max((errors[name] / shipped[name], name) for errors in found for name in shipped)
    return f"{named(name)}, times {figure(ratio)}" if ratio > 1.0 + LEAST else "none"


def named(recording: str) -> str:
    """A measured file as code, for its name is typed."""
    return f"`{recording}`" if recording.startswith(("tue/", "aurora/")) else recording


def title(key: str) -> str:
    """How the page calls a number."""
    module, name, *place = key.split(":")
    folder, _, file = module.rpartition(".")
    where = f"conditioning.{file}" if folder.endswith("conditioning") else file
    return f"`{where}.{name}{''.join(f'[{index}]' for index in place)}`"


def sensitivities() -> str:
    """One line for each number, halved and doubled; and which of them move nothing."""
    base, found = shipped(), {key: pairs(key) for key in keys()}
    columns, rows = cells(base), [["shipped", *map(figure, cells(base).values()), "–"]]
    quiet, silent = [], []
    for key, both in found.items():
        one, two = (cells(errors) for errors in both)
        values = [pair(one[head], two[head], columns[head]) for head in COLUMNS]
        rows.append([title(key), *values, loser(both, base)])
        if not any("*" in value for value in values):
            quiet.append(key)
            if not any(moves(errors[name], base[name]) for errors in both for name in base):
                silent.append(key)
    said = f"Of {len(found)} tuned numbers {len(quiet)} move no column by more than 2 % of itself, halved or doubled. "
    said += f"{len(silent)} of these move no recording by that much either:\n\n"
    listed = [f"- no recording: {listing(silent)}", f"- single ones: {listing(set(quiet) - set(silent))}"]
    return said + "\n".join(listed) + "\n\n" + table(("Number", *COLUMNS, "Loses most"), rows)


def listing(some: Collection[str]) -> str:
    """Numbers in their order."""
    return ", ".join(title(key) for key in keys() if key in some) or "none"


def shipped() -> Errors:
    """With all numbers as they are."""
    return variant(keys()[0], 1.0)


def pairs(key: str) -> tuple[Errors, ...]:
    """Of one number halved and doubled."""
    return tuple(variant(key, factor) for factor in FACTORS)


CHOSEN_ON = ("tue/a-", "tue/b-")
SCORED_ON = {"`d` and `e`": ("tue/d-", "tue/e-"), "`m1-d`": ("tue/m1-d-",)}
"""Recordings by the beginning of their names."""


def middle_of(errors: Errors, begins: tuple[str, ...]) -> float:
    """The median error of these files [%]."""
    return median(error for name, error in errors.items() if name.startswith(begins))


def leave_rig_out() -> str:
    """Each number chosen by some files alone, and what that does to the others: only those that would be others."""
    base, rows, ratios = shipped(), [], {head: [] for head in SCORED_ON}
    for key in keys():
        tried = {"shipped": base} | dict(zip(FACTORS.values(), pairs(key), strict=True))
        word = min(tried, key=lambda one: (middle_of(tried[one], CHOSEN_ON), one != "shipped"))
        there = {head: middle_of(tried[word], some) / middle_of(base, some) for head, some in SCORED_ON.items()}
        for head, ratio in there.items():
            ratios[head].append(ratio)
        if word != "shipped":
            won = middle_of(tried[word], CHOSEN_ON) / middle_of(base, CHOSEN_ON)
            rows.append([title(key), word, *(f"{ratio:.3f}" for ratio in (won, *there.values()))])
    rows.sort(key=lambda row: row[2])
    summed = [f"{head} {median(some):.3f} ({min(some):.3f} to {max(some):.3f})" for head, some in ratios.items()]
    said = f"{len(rows)} of {len(keys())} numbers would be others. Ratio over all numbers, median (least to largest): "
    heads = ("Number", "Chosen", "There, `a` and `b`", *SCORED_ON)
    return said + "; ".join(summed) + ".\n\n" + table(heads, rows)


def main(names: list[str]) -> None:
    """Measure the numbers of these modules, or all, and write the page where all are there."""
    files = list(dict.fromkeys(module.rpartition(".")[2] for module in MODULES))
    asked = [key for key in keys() if key.split(":")[0].rpartition(".")[2] in chosen(names, files)]
    begin = monotonic()
    shipped()
    with ThreadPoolExecutor(2) as pool:
        for number, key in enumerate(pool.map(lambda key: (pairs(key), key)[1], asked), 1):
            print(f"{number} of {len(asked)}: {key} after {monotonic() - begin:.0f} s", flush=True)
    if len(asked) == len(keys()):
        fill(PAGE, {"sensitivities": sensitivities()})
        fill(MAP, {"leave-rig-out": leave_rig_out()})


if __name__ == "__main__":
    main(sys.argv[1:])
