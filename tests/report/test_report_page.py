"""The page: one file, whole or not there, with nothing to fetch, and small however long the session."""

from __future__ import annotations

import base64
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest
from report_sessions import make_session, repeated

from foretouch.errors import ForetouchError, InputError, MissingExtraError
from foretouch.messages import FOLLOWER_DTYPE, LEADER_DTYPE, SessionLog, Status
from foretouch.quantities import new_figure
from foretouch.report import (
    compare_replay,
    delayed_force,
    embedded,
    session_figures,
    tiles,
    write_page,
    write_prediction_page,
    write_replay_page,
)
from foretouch.report.drawing import NARROW, corners, extremes, joined, thinned
from foretouch.report.sections.forces import force_figure, prediction_figure
from foretouch.report.sections.robot import timing_figure
from foretouch.report.writing.pages import MOST_BYTES

EMPTY = SessionLog(np.zeros(0, LEADER_DTYPE), np.zeros(0, FOLLOWER_DTYPE), ())


def images(page: Path) -> list[ElementTree.Element]:
    data = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', page.read_text())
    return [ElementTree.fromstring(base64.b64decode(image)) for image in data]


@pytest.mark.parametrize(
    ("chosen", "figures"),
    [
        ({"duration": 3.0, "noise": 0.02}, 6),
        ({"duration": 2.5, "stiffness": 30.0, "limit": 10.0}, 6),
        pytest.param({"duration": 2.5, "touching": False}, 5, marks=pytest.mark.long),
        pytest.param({"duration": 2.5, "models": False}, 5, marks=pytest.mark.long),
        pytest.param({"duration": 2.5, "valid": False}, 6, marks=pytest.mark.long),
        pytest.param({"duration": 0.2}, 5, marks=pytest.mark.long),
        ({"duration": 0.05}, 2),
        (None, 0),
    ],
    ids=["good", "diverged", "no contact", "no models", "no valid model", "short", "nothing applied", "empty"],
)
@pytest.mark.first
def test_every_session_has_a_page_that_asks_nobody_for_anything_and_escapes_its_texts(
    tmp_path: Path, chosen: dict[str, Any] | None, figures: int
) -> None:
    log = EMPTY if chosen is None else make_session(**chosen)
    log = replace(log, settings=log.settings | {"material": "<script>alert(1)</script>"})
    report = session_figures(log, recording="session.mcap")
    page = write_page(tmp_path / "new" / "folder", log, report)
    assert page == tmp_path / "new" / "folder" / "index.html"
    assert [path.name for path in page.parent.iterdir()] == ["index.html"]
    text = page.read_text()
    assert report["status"] in text
    assert len(images(page)) == figures
    assert text.startswith("<!doctype html>")
    assert text.rstrip().endswith("</html>")
    sources = re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?([^"\')\s>]+)', text)
    assert len(sources) >= figures
    assert all(source.startswith("data:") for source in sources)
    assert "<script" not in text


def test_a_page_is_replaced_and_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    log = EMPTY
    report = session_figures(log)
    write_page(tmp_path, log, report)
    write_page(tmp_path, log, report)
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(InputError, match="taken"):
        write_page(tmp_path / "taken", log, report)
    assert (tmp_path / "taken").read_text() == "mine"
    (tmp_path / "folder" / "index.html").mkdir(parents=True)
    with pytest.raises(ForetouchError, match=r"index\.html"):
        write_page(tmp_path / "folder", log, report)


def test_a_missing_matplotlib_is_named_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = make_session(0.2)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"\[report\]"):
        write_page(tmp_path / "out", log, session_figures(log))
    assert not (tmp_path / "out").exists()


def test_a_prediction_has_a_page(tmp_path: Path) -> None:
    time = np.arange(4000) * 1e-3
    force = np.maximum(0.0, 4.0 * np.sin(6.0 * time))
    forces = {
        "time_s": time,
        "measured_force_N": force,
        "predicted_force_N": 3.0 * force,
        "delayed_force_N": delayed_force(time, force, 0.3),
        "in_contact": force > 0.2,
    }
    figures = {
        "delay_s": 0.3,
        "prediction_error_percent": 200.0,
        "delayed_force_error_percent": 100.0,
        "within_jnd_percent": 0.0,
        "phantom_force_rms_N": None,
        "contact_force_rms_N": 2.0,
        "missed_contact_percent": 0.0,
        "status": "ok",
    }
    page = write_prediction_page(tmp_path, "press & hold.csv", forces, figures)
    text = page.read_text()
    assert len(images(page)) == 1
    assert "press &amp; hold.csv" in text
    assert "worse than the delayed force (error x 2.00)" in text


def test_a_diverged_prediction_does_not_flatten_the_figure_and_is_told() -> None:
    time = np.arange(3000) * 1e-3
    force = np.maximum(0.0, 4.0 * np.sin(6.0 * time))
    predicted = force.copy()
    predicted[::100] = 1e6
    figure = force_figure(time, force, predicted, force, force)
    for axes in figure.axes[:2]:
        assert axes.get_ylim()[1] < 10.0
        assert any("beyond the axis in 1 % of samples" in text.get_text() for text in axes.texts)
    assert [line.get_label() for line in figure.axes[0].lines][-1] == "predicted"


def test_what_is_not_scored_is_not_marked_as_scored() -> None:
    time = np.arange(3000) * 1e-3
    force = np.maximum(0.0, 4.0 * np.sin(6.0 * time))
    scored = (time >= 0.5) & ~((time >= 1.0) & (time < 2.0))
    band = next(
        collection
        for collection in force_figure(time, force, force, force, force, scored=scored).axes[0].collections
        if collection.get_label() == "scored"
    )
    sides = [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in band.get_paths()]
    np.testing.assert_allclose(sides, [(0.5, 1.0), (2.0, 3.0)], atol=2e-3)


def test_thinning_keeps_every_peak() -> None:
    time = np.arange(100_000) * 1e-3
    values = np.zeros(100_000)
    values[[777, 50_001, 99_999]] = [5.0, -3.0, 2.0]
    thin_time, thin = thinned(time, values)
    assert thin.size <= 3002
    assert thin.max() == 5.0
    assert thin.min() == -3.0
    assert thin[-1] == 2.0
    assert (np.diff(thin_time) >= 0.0).all()


def test_the_panel_of_errors_is_scaled_to_the_prediction_and_says_what_it_leaves_out() -> None:
    time = np.arange(8000) * 1e-3
    force = 15.0 * np.maximum(np.sin(2.0 * np.pi * time), 0.0)
    predicted = force + 0.2 * np.sin(50.0 * time)
    error = force_figure(time, force, predicted, delayed_force(time, force, 0.3)).axes[2]
    assert 0.2 <= error.get_ylim()[1] < 0.4
    assert any("error of the delayed force beyond the axis" in text.get_text() for text in error.texts)


def test_every_panel_has_titles_of_its_axes() -> None:
    time = np.arange(3000) * 1e-3
    force = np.maximum(np.sin(5.0 * time), 0.0)
    figures = [
        prediction_figure(time, force, force, delayed_force(time, force, 0.3), force > 0.1),
        force_figure(time, force, force, delayed_force(time, force, 0.3), force),
        timing_figure(make_session(2.0)),
    ]
    for axes in (axes for figure in figures for axes in figure.axes):
        assert axes.get_xlabel(), axes.get_title()
        assert axes.get_ylabel(), axes.get_title()


@pytest.mark.parametrize(("count", "columns"), [(5, 5), (6, 6), (7, 4), (9, 5), (13, 5)])
def test_no_card_is_alone_in_its_row(count: int, columns: int) -> None:
    text = tiles([("1 N", "force")] * count)
    assert f"--columns: {columns}" in text
    assert count % columns != 1


MOST = 5_000_000
"""What a page may take [bytes]."""


def wild(log: SessionLog) -> SessionLog:
    """Every curve noise, every flag flickering: nothing of it can be drawn with fewer points by chance."""
    noise, ticks = np.random.default_rng(1), np.arange(log.leader.size)
    leader, follower = log.leader.copy(), log.follower.copy()
    for name in ("predicted_force", "delayed_force", "rendered_force", "mediated_force"):
        leader[name] = noise.normal(3.0, 2.0, ticks.size)
    for name in ("hand_position", "intended_position"):
        leader[name] = noise.normal(0.0, 0.01, ticks.size)
    leader["energy"] = noise.normal(0.0, 2e-3, ticks.size)
    leader["energy_bound"] = noise.uniform(1e-3, 2e-3, ticks.size)
    leader["engaged"] = ticks % 300 > 100
    follower["sensor_force"] += noise.normal(0.0, 1.0, follower.size)
    follower["guarded"] = ticks % 500 > 250
    follower["status"][ticks % 700 > 350] = Status.HOLDING
    models = tuple(msgspec.structs.replace(model, valid=model.sequence % 3 > 0) for model in log.models)
    return replace(log, leader=leader, follower=follower, models=models, settings=log.settings | {"grip": "normal"})


def figure_bytes(page: Path) -> list[int]:
    return [len(base64.b64decode(data)) for data in re.findall(r"svg\+xml;base64,([^\"]+)", page.read_text())]


@pytest.mark.long  # a page does not grow with the session
def test_a_long_session_has_a_page_that_can_be_sent(tmp_path: Path) -> None:
    log = wild(repeated(make_session(2.0), 40))
    page = write_page(tmp_path / "long", log, session_figures(log))
    assert len(figure_bytes(page)) == 7
    assert page.stat().st_size < MOST


@pytest.mark.long
def test_a_page_does_not_grow_with_the_session(tmp_path: Path) -> None:
    sizes = []
    for times in (5, 50):
        log = repeated(make_session(2.0, noise=0.02), times)
        page = write_page(tmp_path / str(times), log, session_figures(log))
        sizes.append(page.stat().st_size)
    assert sizes[1] < 1.5 * sizes[0]


@pytest.mark.long  # a long session below
def test_the_page_of_a_long_replay_can_be_sent_too(tmp_path: Path) -> None:
    log = wild(repeated(make_session(2.0), 10))
    content = compare_replay(log, log, ("nobody moved", "again"))
    assert write_replay_page(tmp_path, "s.mcap", log, log, content).stat().st_size < MOST


@pytest.mark.parametrize("sort", ["dots", pytest.param("words", marks=pytest.mark.long)])
def test_whatever_a_figure_is_made_of_its_image_is_bounded(sort: str) -> None:
    figure = new_figure(4.0)
    axes = figure.subplots()
    axes.set_title("the title stays sharp")
    points = np.random.default_rng(0).uniform(size=(20_000, 2))
    if sort == "dots":
        axes.plot(points[:, 0], points[:, 1], "o")
    else:
        for x, y in points[:1500].tolist():
            axes.text(x, y, "12.3")
    assert len(embedded(figure, "many")) < 2 * MOST_BYTES
    assert axes.title.get_rasterized() is not True


def test_a_figure_of_few_curves_is_made_of_lines() -> None:
    figure = new_figure(4.0)
    figure.subplots().plot([0.0, 1.0], [0.0, 1.0])
    data = re.findall(r"base64,([^\"]+)", embedded(figure, "one line"))[0]
    assert b"image/png" not in base64.b64decode(data)


def test_extremes_leave_holes_and_keep_peaks_beside_them() -> None:
    values = np.full(100_000, np.nan)
    values[20_000:60_000:2] = -1.0  # every other one is missing
    values[40_000] = -7.0
    kept = extremes(values, 100)
    assert kept.size <= 200
    assert np.nanmin(values[kept]) == -7.0
    inside = kept[(kept >= 20_000) & (kept < 60_000)]
    assert np.isfinite(values[inside]).all()
    assert np.isnan(values[kept[kept < 19_000]]).all()
    assert extremes(np.arange(5.0)).tolist() == [0, 1, 2, 3, 4]


def test_a_thousand_gaps_are_no_thousand_points() -> None:
    time = np.cumsum(np.where(np.arange(100_000) % 20 == 19, 0.1 + np.arange(100_000) * 1e-6, 1e-3))
    kept, values = thinned(time, np.ones(time.size), 100)
    assert kept.size <= 300
    assert np.isnan(values).sum() == 100
    assert (np.diff(kept) >= 0.0).all()


def test_marks_that_cannot_be_told_apart_are_one() -> None:
    spans = np.array([[0.0, 1.0], [1.01, 2.0], [5.0, 6.0], [5.5, 5.6], [6.05, 7.0]])
    assert joined(spans, 50.0).tolist() == [[0.0, 2.0], [5.0, 7.0]]
    time = np.arange(100_000) * 1e-3
    when, inside = corners(time, np.arange(100_000) % 4 < 2)
    assert when.size <= 3 * NARROW
    assert (when[0], when[-1]) == (0.0, pytest.approx(99.997))
    assert inside[:2].all()
    assert corners(time, np.zeros(time.size, dtype=np.bool_))[0].size == 0
