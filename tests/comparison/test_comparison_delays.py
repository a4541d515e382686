"""Error against delay: curves are those of `predict`, floors are fits of the whole file, and the plot shows them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from foretouch import comparison
from foretouch.cli.app import app
from foretouch.comparison.combination import whole_file_force
from foretouch.comparison.page import MOST_MATRICES
from foretouch.identification import ESTIMATORS, Learner, make_estimator
from foretouch.models import HuntCrossley
from foretouch.quantities import Recording
from foretouch.recordings import read_recording, write_columns
from foretouch.report import forces_under_delay, score_prediction

DELAYS = (0.0, 0.1, 0.5)
CHOSEN = {"models": ("hunt-crossley",), "estimators": ("exact", "log-rls", "offline")}


def write_presses(path: Path, seed: int) -> Path:
    """Presses of a Hunt-Crossley material that stay in contact up to 1 s and come back to free air later."""
    time = np.arange(0.0, 4.0, 4e-3)
    t = np.maximum(time - 0.6, 0.0)
    depth = 0.01 * (np.sin(2 * np.pi * (0.8 + 0.1 * seed) * t) - 0.05)
    force = HuntCrossley(3000.0, 300.0, 1.4).force(depth, np.gradient(depth, time))
    noise = np.random.default_rng(seed).normal(0.0, 5e-3, time.size)
    write_columns(path, {"time_s": time, "position_m": depth + 0.01, "force_N": force + 0.3 + noise})
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("presses")
    return [write_presses(folder / f"press-{seed}.csv", seed) for seed in (0, 1)]


@pytest.fixture(scope="module")
def results(files: list[Path]) -> list[comparison.Result]:
    results = comparison.compare(
        [comparison.file_case(file) for file in files], **CHOSEN, scoring=comparison.Scoring(DELAYS), processes=1
    )
    assert all(result.status == "ok" for result in results)
    return results


def scored(recording: Recording, estimator: str, delay: float) -> tuple[float | None, float | None]:
    learner = Learner(make_estimator("hunt-crossley", estimator), contact_floor=recording.contact_floor)
    forces = forces_under_delay(recording, learner, delay)
    scores = score_prediction(
        forces.time,
        forces.measured,
        forces.predicted,
        forces.delayed,
        contact_floor=forces.contact_floor,
        position=forces.position,
        delayed_offset=0.0,
    )
    return scores.prediction_error_percent, scores.delayed_force_error_percent


@pytest.mark.long
def test_a_curve_at_a_delay_is_predict_at_that_delay(files: list[Path], results: list[comparison.Result]) -> None:
    recording = read_recording(files[0])
    own = [result for result in results if result.recording == str(files[0])]
    curves = comparison.delay_curves(own)
    assert list(curves) == [("hunt-crossley", name) for name in ESTIMATORS["hunt-crossley"] if name in curve_names()]
    for (_, estimator), curve in curves.items():
        assert curve.delay.tolist() == list(DELAYS)
        for delay, error in zip(curve.delay, curve.error, strict=True):
            assert error == pytest.approx(scored(recording, estimator, float(delay))[0])


def curve_names() -> tuple[str, ...]:
    return CHOSEN["estimators"]


@pytest.mark.long
def test_at_no_delay_the_delayed_force_is_right_and_what_was_learnt_is_near(results: list[comparison.Result]) -> None:
    ceiling = comparison.delayed_force_curve(results)
    assert ceiling.delay[0] == 0.0
    assert ceiling.error[0] == pytest.approx(0.0, abs=1e-9)
    assert (ceiling.error[1:] > 30.0).all()
    assert all(0.0 < curve.error[0] < 20.0 for curve in comparison.delay_curves(results).values())


@pytest.mark.long
def test_several_recordings_give_their_median(results: list[comparison.Result]) -> None:
    pair = ("hunt-crossley", "exact")
    single = [comparison.delay_curves([result])[pair].error for result in results if result.estimator == "exact"]
    assert comparison.delay_curves(results)[pair].error == pytest.approx(np.mean(single, axis=0))  # two: their middle


@pytest.mark.long
def test_fits_of_the_whole_file_alone_are_floors(results: list[comparison.Result]) -> None:
    floors = comparison.floors(results)
    assert list(floors) == [("hunt-crossley", "offline")]
    (floor,) = floors.values()
    assert np.ptp(floor.error) == 0.0  # it knows no delay
    assert 0.0 < floor.error[0] < 5.0
    for result in results:
        fitted = [prediction.whole_file_error_percent is not None for prediction in result.predictions]
        assert fitted == [result.estimator == "offline"] * len(DELAYS)


def test_any_estimator_that_says_it_is_offline_is_a_floor(files: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ESTIMATORS["kelvin-voigt"]["rls"], "offline", True)
    (result,) = comparison.compare(
        [comparison.file_case(files[0])], models=("kelvin-voigt",), estimators=("rls",), processes=1
    )
    assert list(comparison.floors([result])) == [("kelvin-voigt", "rls")]


def test_the_whole_file_tells_from_the_first_sample_on(files: list[Path]) -> None:
    recording = read_recording(files[0])
    known = Learner(make_estimator("hunt-crossley", "offline"), contact_floor=recording.contact_floor)
    for time, position, force in zip(recording.time, recording.position, recording.force, strict=True):
        known.update(float(time), float(position), float(force))
    fit = whole_file_force(recording, make_estimator("hunt-crossley", "offline"), known)
    true = recording.force - 0.3
    first = slice(0, int(np.searchsorted(recording.time, 1.0)))
    assert true[first].max() > 2.0
    assert np.abs(fit - true)[first].max() < 0.25 * true.max()
    causal = forces_under_delay(recording, Learner(make_estimator("hunt-crossley", "offline")), 0.5).predicted
    assert not causal[first].any()


def test_a_file_without_contact_has_no_floor_and_no_fault() -> None:
    time = np.arange(0.0, 1.0, 1e-3)
    recording = Recording(time, np.zeros(time.size), np.zeros(time.size))
    estimator = make_estimator("hunt-crossley", "offline")
    assert not whole_file_force(recording, estimator, Learner(estimator)).any()


# --- the plot ---------------------------------------------------------------------------------------------------------


def test_one_file_is_one_panel_with_its_curves(results: list[comparison.Result]) -> None:
    own = results[:3]
    (panel,) = comparison.delay_figure(own).axes
    drawn = {tuple(line.get_ydata()) for line in panel.lines if len(line.get_xdata()) == len(DELAYS)}
    for curve in comparison.delay_curves(own).values():
        assert tuple(curve.error) in drawn
    assert panel.get_xlim() == (0.0, 500.0)
    assert panel.get_title() == "press-0"


def test_a_group_has_its_median_first(results: list[comparison.Result]) -> None:
    figure = comparison.delay_figure(results, "Two presses")
    assert [panel.get_title() for panel in figure.axes] == ["median of 2 recordings", "press-0", "press-1"]
    assert figure.get_suptitle() == "Two presses"
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert "hunt-crossley, 3 others" in words
    assert "fit of the whole file: floor" in words


def test_the_papers_estimator_is_named_and_marked_where_it_is_beyond_the_panel(results: list[Any]) -> None:
    absurd = [replace(p, prediction_error_percent=1e6) for p in results[0].predictions]
    paper = replace(results[0], model="continuous-switching", estimator="fprls", predictions=tuple(absurd))
    (panel,) = comparison.delay_figure([*results[:3], paper]).axes
    assert "paper" in [text.get_text() for text in panel.texts]
    (marks,) = [line for line in panel.lines if line.get_marker() == "^" and len(line.get_xdata())]
    assert marks.get_xdata().tolist() == [0.0, 100.0, 500.0]
    assert set(marks.get_ydata()) == {panel.get_ylim()[1]}


def test_long_names_that_end_alike_stay_apart(results: list[comparison.Result]) -> None:
    names = [f"{first}-of-the-presses-on-the-softest-foam" for first in ("one", "two")]
    long = [replace(result, recording=name) for name in names for result in results[:3]]
    assert [panel.get_title() for panel in comparison.delay_figure(long).axes[1:]] == names


@pytest.mark.long
def test_the_page_of_many_recordings_can_be_sent(results: list[comparison.Result], tmp_path: Path) -> None:
    many = [replace(result, recording=f"press-{number}") for number in range(100) for result in results[:3]]
    page = comparison.write_comparison_page(tmp_path, many)
    assert page.stat().st_size < 5_000_000
    text = page.read_text()
    assert "the first 16 of 100 recordings have a panel" in text
    assert "press-99" in text
    assert [len(comparison.delay_figure(many[:count]).axes) for count in (30, 300)] == [11, 17]


def test_where_nothing_can_be_scored_the_panel_is_empty(files: list[Path], tmp_path: Path) -> None:
    scoring = comparison.Scoring((0.0, 0.3), score_from=100.0)
    results = comparison.compare(
        [comparison.file_case(files[0])], models=("hunt-crossley",), estimators=("exact",), scoring=scoring, processes=1
    )
    assert {p.status for result in results for p in result.predictions} == {"nothing_to_score"}
    (panel,) = comparison.delay_figure(results).axes
    assert not panel.texts
    assert comparison.write_comparison_page(tmp_path, results).is_file()


def test_what_failed_is_not_drawn(results: list[comparison.Result]) -> None:
    failed = comparison.Result("gone.csv", "hunt-crossley", "exact", "failed", "no such file")
    assert len(comparison.delay_figure([*results[:3], failed]).axes) == 1


@pytest.mark.long
def test_simulated_recordings_are_drawn_without_what_cannot_be_told() -> None:
    scoring = comparison.Scoring((0.0, 0.3))
    case = comparison.simulated_case("kelvin-voigt")
    (result,) = comparison.compare([case], models=("kelvin-voigt",), estimators=("offline",), scoring=scoring)
    curve = comparison.delay_curves([result])["kelvin-voigt", "offline"]
    assert curve.error.tolist() == [p.foreseeable_prediction_error_percent for p in result.predictions]
    (floor,) = comparison.floors([result]).values()
    assert floor.error.tolist() == [p.foreseeable_whole_file_error_percent for p in result.predictions]
    assert floor.error.max() < 3.0


# --- the command ------------------------------------------------------------------------------------------------------


def test_the_sweep_goes_over_all_delays_and_stands_on_the_page(files: list[Path], tmp_path: Path) -> None:
    options = ("--models", "hunt-crossley", "--estimators", "exact", "--sweep", "--delay", "0.02", "--json")
    result = CliRunner().invoke(app, ["compare", str(files[0]), *options, "--report", str(tmp_path / "page")])
    assert result.exit_code == 0, result.exception
    (row,) = json.loads(result.stdout)["results"]
    assert [p["delay_s"] for p in row["predictions"]] == [0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0]
    assert len(row["predictions"]) > MOST_MATRICES
    page = (tmp_path / "page" / "index.html").read_text()
    assert page.count("<figcaption>Prediction error against delay") == 1
    assert page.count("<figcaption>Prediction error at") == 1
    assert "<figcaption>Prediction error at 0.3 s" in page
