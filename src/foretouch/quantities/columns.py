"""The table of quantities, one name, unit and sign each; and columns over time, as NumPy, as pandas and as a plot.

The glossary of the docs is made from the table.
"""

from __future__ import annotations

import importlib
from abc import abstractmethod
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import MissingExtraError, UnknownNameError
from foretouch.quantities.brief import ByValue
from foretouch.quantities.colours import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, VERMILLION, css

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Quantity(NamedTuple):
    """One quantity of the project.

    Attributes:
        name: The name that code, messages and columns use.
        symbol: The symbol of the paper, or "".
        unit: SI unit; "1" where there is none.
        meaning: What it is, and which sign is positive.
    """

    name: str
    symbol: str
    unit: str
    meaning: str


QUANTITIES: tuple[Quantity, ...] = (
    Quantity("time", "t", "s", "time since the first sample; from a monotonic clock"),
    Quantity("position", "", "m", "probe or handle position along the approach, growing into the material"),
    Quantity("surface", "", "m", "position at which the undeformed surface is first touched"),
    Quantity("depth", "x", "m", "position less surface; positive inside the material"),
    Quantity("velocity", "ẋ", "m/s", "rate of depth; positive while deepening"),
    Quantity("force", "F", "N", "on the probe along the outward normal; negative where it pulls"),
    Quantity("force_offset", "", "N", "what the sensor shows in free air"),
    Quantity("stiffness", "k", "N/m^s", "of the power law; comparable only at equal exponent s = n + alpha"),
    Quantity("damping", "λ", "N s/m^(n+1)", "of the contact law; N s/m for Kelvin-Voigt"),
    Quantity("stiffening", "", "N/m^2", "of the quadratic law: how its stiffness grows with depth"),
    Quantity("threshold", "", "N/m", "stiffness from which on threshold switching takes Kelvin-Voigt"),
    Quantity("exponent", "n", "1", "of depth in the damping term"),
    Quantity("switching", "α", "1", "0 is Hunt-Crossley, 1 with n = 0 is Kelvin-Voigt"),
    Quantity("s", "s", "1", "exponent of depth in the elastic term, n + alpha"),
    Quantity("ln_k", "ln k", "ln(N/m^s)", "logarithm of the stiffness with depth in metres"),
    Quantity("b1", "b₁", "s/m", "coefficient of velocity in the linearised law (18)"),
    Quantity("b2", "b₂", "s", "coefficient of velocity / depth in the linearised law (18)"),
    Quantity("forgetting_factor", "μ", "1", "weight of the past in recursive least squares, in (0, 1]"),
    Quantity("unscaled_covariance", "P", "of the parameters", "covariance divided by the noise variance"),
    Quantity("innovation", "ê", "of the measurement", "measured less predicted, before the update"),
    Quantity("one_way_delay", "", "s", "from sending to arrival, one direction"),
    Quantity("sample_period", "", "s", "between two ticks of a loop"),
)
"""The table."""


def parameter_unit(name: str, names: Iterable[str]) -> str:
    """Unit of one of a law's numbers, "" where it has none or is not known here.

    Args:
        name: Name of the number; one of two laws begins with its law's name, as ``kelvin_voigt_stiffness``.
        names: Names of all numbers of the law: without an exponent among them its strengths have plain units.
    """
    law, _, short = name.rpartition("voigt_" if "voigt_" in name else "crossley_")
    names = set(names)
    if law.startswith("kelvin") or not names & {"exponent", "s", "hunt_crossley_exponent"}:
        plain = {"stiffness": "N/m", "damping": "N s/m^2" if "stiffening" in names else "N s/m"}
        if short in plain:
            return plain[short]
    unit = next((quantity.unit for quantity in QUANTITIES if quantity.name == short), "")
    if not names & {"switching", "s"}:
        unit = unit.replace("^s", "^n")  # one exponent is all there is
    return "" if unit == "1" else unit


def in_words(name: str) -> tuple[str, str]:
    """Name of a figure as people read it, and its unit: ``contact_force_rms_N`` is "contact force RMS" and "N".

    Args:
        name: In lower case with underlines, ending in its unit where it has one.
    """
    words = (word.upper() if word in ("rms", "rmse", "jnd") else word for word in _quantity(name).split("_"))
    unit = _unit(name)
    return ("rate of " if unit == "N/s" else "") + " ".join(words), unit


Array = NDArray[np.float64]
"""Numbers, of the shape that is stated where they are used."""
Flags = NDArray[np.bool_]
"""Truths, one for each row or point."""

Rows = Any
"""A structured array, shape (n,): ``rows["force"]`` is a column. To NumPy's types a column is an array of anything, for
which every operator tries all of its overloads: more than half of all the time that the type checker took."""

COLOURS = tuple(css(colour) for colour in (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, INK))
"""Okabe and Ito's colours, which the colour-blind tell apart, for curves that stand in a row."""

LINES = ("-", "--", ":", "-.")

UNITS = {
    **{unit: unit for unit in ("s", "m", "N", "us")},
    **{"m_s": "m/s", "m_s2": "m/s²", "N_per_s": "N/s", "percent": "%"},
}
"""Units by the end of a column's name, by its longest ending that stands here."""


class Columns(ByValue):
    """A result with columns of equal length, the time among them: one row a sample.

    Names end in their unit: ``time_s``, ``position_m``, ``velocity_m_s``, ``force_N``; other numbers have none.
    """

    __slots__ = ()

    @abstractmethod
    def columns(self) -> dict[str, NDArray[Any]]:
        """Every column by name, shape (n,) each, the time first."""

    def to_numpy(self) -> NDArray[np.void]:
        """All columns as one structured array, shape (n,): ``to_numpy()["force_N"]`` is a column."""
        columns = self.columns()
        size = next(iter(columns.values())).size
        table = np.empty(size, np.dtype([(name, column.dtype) for name, column in columns.items()]))
        for name, column in columns.items():
            table[name] = column
        return table

    def to_pandas(self) -> pd.DataFrame:
        """All columns as a data frame with the row's number as index.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        return as_frame(self.columns())

    def plot(self, *names: str) -> Figure:
        """Columns over time, those of one unit in one panel.

        Args:
            *names: Of columns, without or with their unit; all where none are given.

        Returns:
            A figure of Matplotlib, of no window: ``figure.savefig("forces.png")``; notebooks show it.

        Raises:
            UnknownNameError: No such column.
            MissingExtraError: Matplotlib is not installed.
        """
        columns = self.columns()
        first, *others = columns
        time = columns[first]
        short = {_quantity(name): name for name in others}
        chosen = []
        for name in names or tuple(others):
            if name not in columns and name not in short:
                raise UnknownNameError("column", name, others)
            chosen.append(name if name in columns else short[name])
        flags = [name for name in chosen if columns[name].dtype == bool]
        panels: dict[str, list[str]] = {}
        for name in chosen:
            if name not in flags:
                # Numbers without a unit in their name get no common axis.
                panels.setdefault(_unit(name) if _suffix(name) else name, []).append(name)
        figure: Figure = new_figure(1.0 + 2.2 * max(len(panels), 1))
        axes = figure.subplots(max(len(panels), 1), sharex=True, squeeze=False)[:, 0]
        for panel, names_in_it in zip(axes, panels.values(), strict=False):
            _draw(panel, time, {name: columns[name] for name in names_in_it})
        for panel in axes:
            for name in flags:  # the times at which a flag is set, over the whole height
                label = _quantity(name).replace("_", " ") if panel is axes[0] else None
                shade = {"step": "post", "transform": panel.get_xaxis_transform(), "color": "0.88", "zorder": 0}
                panel.fill_between(time, 0.0, 1.0, where=columns[name], label=label, **shade)
            if panel.get_legend_handles_labels()[1]:
                panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize="small")
        axes[-1].set_xlabel(f"{_quantity(first)} [{_unit(first)}]")
        figure.subplots_adjust(left=0.09, right=0.8, top=0.96, bottom=0.6 / figure.get_figheight(), hspace=0.2)
        return figure


def _draw(axes: Any, time: NDArray[Any], curves: dict[str, NDArray[Any]]) -> None:
    """Curves of one unit in one panel, named by a legend, or by the axis where there is one alone."""
    for number, (name, values) in enumerate(curves.items()):
        colour, line = COLOURS[number % len(COLOURS)], LINES[number // len(COLOURS) % len(LINES)]
        label = _quantity(name).replace("_", " ") if len(curves) > 1 else None
        axes.plot(time, values, line, color=colour, label=label, linewidth=1.2)
    name = next(iter(curves))
    unit = f"[{_unit(name)}]" if _unit(name) else ""
    axes.set_ylabel(unit if len(curves) > 1 else f"{_quantity(name).replace('_', ' ')} {unit}".strip())
    axes.grid(alpha=0.3, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def _unit(name: str) -> str:
    """Unit of a column by the end of its name, else by the table of quantities; "" where there is none."""
    unit = UNITS.get(_suffix(name)) or next((quantity.unit for quantity in QUANTITIES if quantity.name == name), "")
    return "" if unit == "1" else unit


def _quantity(name: str) -> str:
    suffix = _suffix(name)
    return name.removesuffix(f"_{suffix}") if suffix else name


def _suffix(name: str) -> str:
    results = [suffix for suffix in UNITS if name.endswith(f"_{suffix}")]
    return max(results, key=len, default="")


def new_figure(height: float) -> Any:
    """An empty figure, 10 inches wide.

    Args:
        height: [inches].

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    try:
        figure = importlib.import_module("matplotlib.figure")
    except ModuleNotFoundError:
        raise MissingExtraError("matplotlib", "report") from None
    return figure.Figure(figsize=(10.0, height))


def as_frame(columns: dict[str, NDArray[Any]] | list[dict[str, Any]]) -> pd.DataFrame:
    """A data frame of columns by name, or of rows.

    Raises:
        MissingExtraError: pandas is not installed.
    """
    try:
        pandas = importlib.import_module("pandas")
    except ModuleNotFoundError:
        raise MissingExtraError("pandas", "pandas") from None
    frame: pd.DataFrame = pandas.DataFrame(columns)
    return frame
