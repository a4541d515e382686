import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foretouch.sweep import Outcome, crossover, crossovers, curve, draw_case, render_table, summary, write_sweep_page
from foretouch.sweep.curves import AXES, Curve, crossover_sentences, error_of
from foretouch.sweep.page import error_figure

GOOD: dict[str, Any] = {
    "stable": True,
    "oscillating": False,
    "forces_finite": True,
    "energy_margin_J": 0.0,
    "energy_used_percent": 80.0,
    "largest_jump_N": 0.05,
}


def row(number: int, **figures: Any) -> Outcome:
    """A row with the facts of a session as it is drawn, and these figures."""
    case = draw_case(number)
    facts = {
        "number": number,
        "baseline": "none",
        "command": case.command,
        "duration_s": case.duration,
        "network": case.network,
        "round_trip_s": case.round_trip,
        "options": case.options,
    }
    return Outcome(**facts | GOOD | figures)


def swept(count: int = 300) -> list[Outcome]:
    """Models err by 5 % at any round trip, the delayed force by 50 % a second: they cross at 0.1 s."""
    rows = []
    for number in range(count):
        trip = draw_case(number).round_trip
        rows.append(row(number, error_percent=5.0, age_s=trip, models_per_s=20.0))
        for baseline in ("delayed", "delayed-tdpa"):
            late = 50.0 * trip if baseline == "delayed" else 1.0
            rows.append(row(number, baseline=baseline, stable=trip < 0.1, oscillating=trip >= 0.1, error_percent=late))
    return rows


def test_a_curve_has_medians_and_quartiles_where_there_are_enough() -> None:
    rows = [row(n, round_trip_s=0.5, error_percent=float(n)) for n in range(1, 6)]
    rows += [row(9, round_trip_s=1.5, error_percent=1.0), row(10, round_trip_s=0.5)]
    drawn = curve(rows, lambda one: one.round_trip_s, error_of, (0.0, 1.0, 2.0))
    assert (drawn.x.tolist(), drawn.low.tolist(), drawn.middle.tolist(), drawn.high.tolist()) == ([0.5], [2], [3], [4])
    assert drawn.count.tolist() == [5]


def test_curves_cross_where_the_first_gets_below_and_stays() -> None:
    x = np.array([0.0, 1.0, 2.0, 3.0])

    def of(*middle: float) -> Curve:
        values = np.array(middle)
        return Curve(x[: values.size], values, values, values, np.full(values.size, 5))

    assert crossover(of(2, 2, 2, 2), of(0, 1, 3, 3)) == pytest.approx(1.5)
    assert crossover(of(2, 2, 2, 2), of(3, 1, 3, 3)) == pytest.approx(1.5)
    assert crossover(of(2, 2, 2, 2), of(3, 3, 3, 3)) is None
    assert crossover(of(2, 2, 2, 2), of(3, 3, 3, 1)) is None
    assert crossover(of(2), of()) is None


@pytest.mark.long
def test_the_crossover_is_said_in_a_sentence() -> None:
    regions = {(one["over"], one["baseline"]): one for one in crossovers(swept())}
    at = regions["round trip", "delayed"]["at"]
    assert isinstance(at, float)
    assert 0.05 < at < 0.2
    assert f"From a round trip of {at:.2g} s on, models are nearer" in str(regions["round trip", "delayed"]["sentence"])
    never = regions["round trip", "delayed-tdpa"]
    assert never["at"] is None
    assert "There is no point" in str(never["sentence"])
    assert regions["model age", "delayed"]["sentence"] is None  # their age was not measured
    sentences = crossover_sentences(crossovers(swept()))
    assert sentences[-1] == "Too few sessions to compare models with the delayed force over model age."
    assert len(sentences) == 3


def test_totals_count_what_is_wrong() -> None:
    rows = [
        row(0),
        row(1, oscillating=True, stable=False),
        row(2, stable=False, energy_margin_J=-0.002, largest_jump_N=0.3),
        row(3, error="RuntimeError: no", stable=None),
    ]
    content = summary(rows)
    ours = content["ours"]
    assert (ours["sessions"], ours["failed"], ours["unstable"], ours["oscillating"]) == (4, 1, 2, 1)
    assert (ours["bound_broken"], ours["largest_energy_surplus_J"], ours["largest_jump_N"]) == (1, 0.002, 0.3)
    wrong = [(one["number"], one["objection"]) for one in content["objections"]]
    assert wrong == [
        (1, "the hand oscillates"),
        (2, "gives out 0.002 J more than its bound"),
        (2, "a model changes the force by 0.3 N in one tick"),
        (3, "failed: RuntimeError: no"),
    ]
    text = render_table(content)
    assert all(row(number).command in text for number in (1, 2, 3))
    assert "delayed" not in content


def test_the_page_says_what_came_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = swept(60)
    text = write_sweep_page(tmp_path, rows).read_text()
    assert "No session of ours is unstable" in text
    assert text.count("<img") == 7
    assert len(re.findall(r"https?://", text)) == 0
    assert "60 sessions" in text
    rows[0] = row(0, oscillating=True, stable=False)
    monkeypatch.setattr("foretouch.sweep.page.embedded", lambda figure, caption: caption)  # drawn once is enough
    text = write_sweep_page(tmp_path, rows).read_text()
    assert "1 of our sessions are not as they should be" in text
    assert draw_case(0).command in text


@pytest.mark.long
def test_a_page_of_one_session_that_failed(tmp_path: Path) -> None:
    figures = dict.fromkeys(GOOD)
    page = write_sweep_page(tmp_path, [row(0, **figures, error="RuntimeError: <no>")])
    assert "failed: RuntimeError: &lt;no&gt;" in page.read_text()


@pytest.mark.parametrize("count", [1, 3, 60])
def test_the_legend_names_what_is_drawn_and_nothing_else(count: int) -> None:
    for axis in AXES:
        axes = error_figure(swept(count), axis).axes[0]
        handles, labels = axes.get_legend_handles_labels()
        assert all(len(handle.get_xdata()) for handle in handles)
        assert len(set(labels)) == len(labels)
        drawn = {line.get_marker() for line in axes.get_lines() if line.get_marker() != "None"}
        assert {handle.get_marker() for handle in handles} - {"None"} == drawn


def test_every_axis_has_room_for_every_session() -> None:
    for axis in AXES:
        assert all(low < high for low, high in zip(axis.edges, axis.edges[1:], strict=False))
    trip = AXES[0]
    assert max(draw_case(number).round_trip for number in range(500)) < trip.edges[-1]
