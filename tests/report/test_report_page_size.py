"""A page that can be sent: however long the session and wild its curves, it takes some megabytes at most."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_sessions import make_session, repeated

from foretouch.messages import SessionLog, Status
from foretouch.quantities import new_figure
from foretouch.report import compare_replay, embedded, session_report, write_page, write_replay_page
from foretouch.report.writing.html import MOST_BYTES
from foretouch.report.writing.thinning import NARROW, corners, extremes, joined, thinned

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
    models = tuple(replaced(model, valid=model.sequence % 3 > 0) for model in log.models)
    return replace(log, leader=leader, follower=follower, models=models, settings=log.settings | {"grip": "normal"})


def replaced(message: Any, **changes: Any) -> Any:
    values = {name: getattr(message, name) for name in message.__struct_fields__}
    return type(message)(**(values | changes))


def figure_bytes(page: Path) -> list[int]:
    return [len(base64.b64decode(data)) for data in re.findall(r"svg\+xml;base64,([^\"]+)", page.read_text())]


def test_a_long_session_has_a_page_that_can_be_sent(tmp_path: Path) -> None:
    log = wild(repeated(make_session(2.0), 40))
    page = write_page(tmp_path / "long", log, session_report(log))
    assert len(figure_bytes(page)) == 7
    assert page.stat().st_size < MOST


def test_a_page_does_not_grow_with_the_session(tmp_path: Path) -> None:
    sizes = []
    for times in (5, 50):
        log = repeated(make_session(2.0, noise=0.02), times)
        page = write_page(tmp_path / str(times), log, session_report(log))
        sizes.append(page.stat().st_size)
    assert sizes[1] < 1.5 * sizes[0]


def test_the_page_of_a_long_replay_can_be_sent_too(tmp_path: Path) -> None:
    log = wild(repeated(make_session(2.0), 10))
    content = compare_replay(log, log, ("nobody moved", "again"))
    assert write_replay_page(tmp_path, "s.mcap", log, log, content).stat().st_size < MOST


@pytest.mark.parametrize("sort", ["dots", "words"])
def test_whatever_a_figure_is_made_of_its_image_is_bounded(sort: str) -> None:
    figure = new_figure(4.0)
    axes = figure.subplots()
    axes.set_title("the title stays sharp")
    places = np.random.default_rng(0).uniform(size=(20_000, 2))
    if sort == "dots":
        axes.plot(places[:, 0], places[:, 1], "o")
    else:
        for x, y in places[:1500].tolist():
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
