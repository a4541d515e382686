"""A sweep as one object of numbers and as text: how figures depend on what was varied, and where two of them cross."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.quantities import Array, Brief
from foretouch.sweep.cases import is_clean, is_plain
from foretouch.sweep.outcome import Outcome, of, totals

Figure = Callable[[Outcome], float | None]

LABEL = {"none": "models (ours)", "delayed": "delayed force", "delayed-tdpa": "delayed force, passivity controller"}
"""Names of the rendered forces in figures, by baseline."""

error_of: Figure = attrgetter("error_percent")  # error of the felt force [%]

FEWEST = 3  # Smallest number of sessions of a bin that is drawn


@dataclass(frozen=True)
class Axis:
    """Quantity by which sessions are laid out."""

    name: str  # name for texts, as ``"round trip"``
    unit: str  # unit of the value
    value: Figure  # function from a session to its value
    edges: tuple[float, ...]  # edges of the bins


AXES = (
    Axis("round trip", "s", lambda row: row.round_trip_s, (0.0, 1e-6, 0.03, 0.1, 0.3, 1.0, 2.0, 3.5, 5.01)),
    Axis("model rate", "1/s", lambda row: row.models_per_s, (0.0, 3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 256.0)),
    Axis("model age", "s", lambda row: row.age_s, (0.0, 0.01, 0.04, 0.1, 0.3, 1.0, 2.0, 3.5, 10.0)),
)
"""Quantities over which figures are drawn; for a baseline, which renders no models, the age is that of the force."""


def plain(rows: Sequence[Outcome]) -> list[Outcome]:
    """Sessions of which the curves are made: `is_plain`, and no clutch that is let go inside the material."""
    return [row for row in rows if is_plain(row.network, row.options) and "clutch" not in row.options]


def stiff(rows: Sequence[Outcome]) -> list[Outcome]:
    """The rows on materials that are stiffer than the device carries."""
    clean = [row for row in rows if is_clean(row.network, row.options) and "clutch" not in row.options]
    return [row for row in clean if not is_plain(row.network, row.options)]


@dataclass(frozen=True)
class Curve(Brief):
    """Median and quartiles of a figure in bins, for those bins that have enough sessions.

    Attributes:
        x: Median of what was varied, shape (n,).
        low: Lower quartile of the figure, shape (n,).
        middle: Median, shape (n,).
        high: Upper quartile, shape (n,).
        count: Sessions, shape (n,).
    """

    x: Array
    low: Array
    middle: Array
    high: Array
    count: NDArray[np.int64]


def curve(rows: Sequence[Outcome], varied: Figure, figure: Figure, edges: Sequence[float]) -> Curve:
    """A figure against what was varied, in bins between increasing edges, each with its lower one.

    Sessions without the one or the other are left out.
    """
    both = [(varied(row), figure(row)) for row in rows]
    known = np.array([(x, y) for x, y in both if x is not None and y is not None]).reshape(-1, 2)
    bins = np.digitize(known[:, 0], edges)
    bands = [
        (np.median(part[:, 0]), *np.percentile(part[:, 1], [25.0, 50.0, 75.0]), len(part))
        for part in (known[bins == number] for number in range(1, len(edges)))
        if len(part) >= FEWEST
    ]
    x, low, middle, high, count = (
        (np.array(column) for column in zip(*bands, strict=True)) if bands else np.empty((5, 0))
    )
    return Curve(x, low, middle, high, count.astype(np.int64))


def crossover(ours: Curve, other: Curve) -> float | None:
    """The first x at which the median of ours gets below the other's and stays there; None where there is none.

    Between the bins both medians are straight lines.
    """
    x, apart = _apart(ours, other)
    worse = np.flatnonzero(apart >= 0.0)
    if not worse.size or worse[-1] == x.size - 1:
        return None
    here = int(worse[-1])
    part = apart[here] / (apart[here] - apart[here + 1])
    return float(x[here] + part * (x[here + 1] - x[here]))


def crossovers(rows: Sequence[Outcome]) -> list[dict[str, str | float | None]]:
    """Regions of round trip and age in which ours is nearer to the truth than each baseline, with a sentence.

    The sentence is None where too few sessions are there to compare.
    """
    regions: list[dict[str, str | float | None]] = []
    for axis in (AXES[0], AXES[2]):
        ours = curve(plain(of(rows, "none")), axis.value, error_of, axis.edges)
        for baseline in dict.fromkeys(row.baseline for row in rows if row.baseline != "none"):
            other = curve(plain(of(rows, baseline)), axis.value, error_of, axis.edges)
            at = crossover(ours, other)
            sentence = _sentence(axis, baseline, ours, other, at)
            regions.append({"over": axis.name, "baseline": baseline, "at": at, "sentence": sentence})
    return regions


def crossover_sentences(regions: Sequence[dict[str, Any]]) -> list[str]:
    """All sentences of `crossovers`, and one for all that cannot be compared."""
    missing = dict.fromkeys(one["over"] for one in regions if one["sentence"] is None)
    sentences = [one["sentence"] for one in regions if one["sentence"] is not None]
    few = [f"Too few sessions to compare models with the delayed force over {' and '.join(missing)}."]
    return sentences + few if missing else sentences


def _sentence(axis: Axis, baseline: str, ours: Curve, other: Curve, at: float | None) -> str | None:
    name = LABEL[baseline].replace(", ", " with a ")
    if at is not None:
        return f"From a {axis.name} of {at:.2g} {axis.unit} on, models are nearer to the true force than the {name}."
    x, apart = _apart(ours, other)
    if not x.size:
        return None
    where = f"from {x[0]:.2g} to {x[-1]:.2g} {axis.unit} of {axis.name}"
    if (apart < 0.0).all():
        return f"Everywhere {where}, models are nearer to the true force than the {name}."
    return f"There is no point {where} from which on models are nearer to the true force than the {name}."


def _apart(ours: Curve, other: Curve) -> tuple[Array, Array]:
    """All x of both curves at which both are known, and by how much the median of ours is above the other's."""
    if not ours.x.size or not other.x.size:
        return np.empty(0), np.empty(0)
    x = np.unique(np.concatenate([ours.x, other.x]))
    x = x[(x >= max(ours.x[0], other.x[0])) & (x <= min(ours.x[-1], other.x[-1]))]
    return x, np.interp(x, ours.x, ours.middle) - np.interp(x, other.x, other.middle)


TOTALS = {
    "sessions": ("", "sessions"),
    "failed": ("", "failed"),
    "unstable": ("", "unstable"),
    "oscillating": ("", "of these the hand oscillates"),
    "bound_broken": ("", "of these give out more energy than the bound"),
    "largest_energy_surplus_J": ("J", "largest energy surplus over the bound"),
    "largest_jump_N": ("N", "largest change of force by a model in one tick"),
    "median_error_percent": ("%", "error of the felt force, median"),
    "median_prediction_error_percent": ("%", "error of the predicted force, median"),
    "median_felt_stiffness_percent": ("%", "felt stiffness, median"),
    "median_device_bound_percent": ("%", "of contact bounded by the device, median"),
    "largest_phantom_N": ("N", "largest force felt where there is nothing"),
    "median_phantom_N": ("N", "the same, median of the sessions"),
    "largest_hand_force_N": ("N", "largest force at the hand"),
    "largest_robot_force_N": ("N", "largest force at the robot"),
    "held_s": ("s", "in which the robot was held, or on its way back"),
    "false_alarms": ("", "sessions in which sensors were not believed"),
    "guarded_contacts": ("", "guarded contacts"),
    "median_depth_lost_mm": ("mm", "depth lost by guarding, median"),
    "median_time_lost_s": ("s", "time lost by guarding, median"),
    "simulated_s": ("s", "simulated"),
    "elapsed_s": ("s", "computed"),
}
"""Unit and words of each of `totals`."""


def summary(rows: Sequence[Outcome]) -> dict[str, Any]:
    """The results of a sweep, ready for JSON.

    ``ours`` are all sessions that rendered models, ``compared`` those of them that were run with the baselines too,
    which are beside them; ``objections`` are those to ours, with the command that runs each again.
    """
    numbers = {row.number for row in rows if row.baseline != "none"}
    content: dict[str, Any] = {"ours": totals(of(rows, "none"))}
    if numbers:
        content["compared"] = totals([row for row in of(rows, "none") if row.number in numbers])
        content |= {name: totals(of(rows, name)) for name in LABEL if name != "none"}
        content["crossovers"] = crossovers(rows)
    content["objections"] = [
        {"number": row.number, "objection": text, "command": row.command}
        for row in of(rows, "none")
        for text in row.objections
    ]
    return content


def render_table(content: dict[str, Any]) -> str:
    """A summary for a terminal, without a last line break."""
    columns = {name: content[name] for name in ("ours", "compared", *list(LABEL)[1:]) if name in content}
    width = max(len(words) for _, words in TOTALS.values())
    lines = [" " * width + "".join(f"{name:>14}" for name in columns)]
    for name, (unit, words) in TOTALS.items():
        cells = (figure_text(column[name], unit) for column in columns.values())
        lines.append(f"{words:{width}}" + "".join(f"{cell:>14}" for cell in cells))
    lines += crossover_sentences(content.get("crossovers", ()))
    return "\n".join([*lines, *objection_lines(content["objections"])])


def objection_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Each objection, and below it the command that runs its session again."""
    return [f"session {one['number']}: {one['objection']}\n  {one['command']}" for one in rows]


def figure_text(value: float | None, unit: str) -> str:
    """A figure with its unit, a dash for None."""
    return "-" if value is None else f"{value:.3g} {unit}" if unit else str(value)
