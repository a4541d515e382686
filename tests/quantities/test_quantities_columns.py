"""Results as NumPy, as pandas and as plots."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import MissingExtraError, UnknownNameError
from foretouch.quantities import Columns, Recording


class Shown(Columns):
    """Some columns of every kind."""

    def __init__(self, **columns: np.ndarray) -> None:
        self._columns = columns

    def columns(self) -> dict[str, np.ndarray]:
        return self._columns


def shown(size: int = 50) -> Shown:
    time = np.arange(size) * 0.1
    return Shown(
        time_s=time,
        position_m=0.01 * np.sin(time),
        velocity_m_s=0.01 * np.cos(time),
        force_N=np.where(time > 2.0, np.nan, time),
        late_force_N=time + 1.0,
        stiffness=1e5 * time,
        switching=0.1 * time,
        in_contact=np.sin(time) > 0.0,
    )


@given(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=20), st.booleans())
def test_numpy_and_pandas_hold_the_columns_as_they_are(positions: list[float], measured: bool) -> None:
    size = len(positions)
    velocity = np.arange(size) * 1e-3 if measured else None
    recording = Recording(np.arange(size) * 0.5, np.array(positions), np.ones(size), velocity)
    table, frame = recording.to_numpy(), recording.to_pandas()
    names = ("time_s", "position_m", "force_N", *(("velocity_m_s",) if measured else ()))
    assert table.dtype.names == names == tuple(frame.columns)
    np.testing.assert_array_equal(table["position_m"], recording.position)
    np.testing.assert_array_equal(frame["position_m"], recording.position)
    assert len(frame) == table.size == size


def test_kinds_are_kept() -> None:
    table = shown().to_numpy()
    assert table["in_contact"].dtype == bool
    assert shown().to_pandas()["in_contact"].dtype == bool
    assert np.isnan(table["force_N"]).any()


def test_a_plot_has_a_panel_for_each_unit_and_one_for_each_number_without() -> None:
    figure = shown().plot()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["position [m]", "velocity [m/s]", "[N]", "stiffness [N/m^s]", "switching"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert [text.get_text() for text in figure.axes[2].get_legend().get_texts()] == ["force", "late force"]
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["in contact"]


def test_columns_are_chosen_with_or_without_their_unit() -> None:
    figure = shown().plot("force", "late_force_N")
    assert [axes.get_ylabel() for axes in figure.axes] == ["[N]"]
    assert len(figure.axes[0].lines) == 2
    np.testing.assert_array_equal(figure.axes[0].lines[1].get_ydata(), shown().columns()["late_force_N"])
    with pytest.raises(UnknownNameError, match="column 'torque'"):
        shown().plot("torque")


@pytest.mark.parametrize(("package", "call"), [("pandas", "to_pandas"), ("matplotlib.figure", "plot")])
def test_what_is_missing_is_said(package: str, call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, package, None)
    extra = {"pandas": "pandas", "matplotlib.figure": "report"}[package]
    with pytest.raises(MissingExtraError, match=rf"not installed: pip install .*\[{extra}\]'"):
        getattr(shown(), call)()
