"""Sessions over a surface whose shape nobody knew, in simulated time."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from commanded import MS

from foretouch.errors import SettingError, UnknownNameError
from foretouch.messages import VERSION, FieldUpdate, FollowerSpace, ModelUpdate, SessionLog, Telemetry
from foretouch.models.shape_field import SIDE, packed_shape
from foretouch.report import map_file, pair, read_map, touched_map
from foretouch.report.scene import look_at_scene, scene_figures
from foretouch.session import SessionSettings, simulate
from foretouch.session.runners.simulated import run_session
from foretouch.session.spatial import make_scene, make_spatial_operator, make_spatial_robot, make_specimen
from foretouch.session.spatial.unknown import HandOverUnknown
from foretouch.session.steps import leader

HERE = (0.0,) * 6
NOT_KNOWN = (math.nan,) * 3
ROWS, COLUMNS = np.divmod(np.arange(SIDE * SIDE), SIDE)


@pytest.mark.parametrize(
    ("changes", "error", "why"),
    [
        ({"scene": "hill", "specimen": "phantom"}, SettingError, "no shape is given"),
        ({"specimen": "phantom"}, SettingError, "is of a scene, and there is none: add --scene unknown"),
        ({"scene": "unknown", "specimen": "unknown"}, UnknownNameError, "specimen"),
        ({"scene": "unknown", "specimen": "cube"}, UnknownNameError, "specimen"),
        ({"scene": "unknown", "fusion": "contact"}, SettingError, "show the shape"),
    ],
)
def test_what_cannot_be_is_one_line(changes: dict, error: type[Exception], why: str) -> None:
    with pytest.raises(error, match=why) as told:
        SessionSettings(**changes)
    assert "\n" not in str(told.value)


def test_only_the_simulated_world_knows_what_stands_there() -> None:
    settings = SessionSettings(scene="unknown", specimen="hill", probe_radius=0.004)
    there = make_specimen(settings)
    assert there.name == "hill"
    assert there.surface.radius == make_scene("unknown", 0.004).surface.radius == 0.004
    assert make_specimen(SessionSettings(scene="unknown")).inclusion is not None
    assert make_scene("unknown").surface.contact((0.075, 0.0, 0.0)).depth == 0.0


def test_news_of_the_shape_do_not_jerk_the_hand_that_is_in_it() -> None:
    settings = SessionSettings(scene="unknown", grip="normal", force_delay=0.0)
    leading = leader.start(settings, hand=HandOverUnknown(make_scene("unknown").surface, HERE, 1.0))
    numbers = (math.nan,) * len(FollowerSpace.__struct_fields__)
    space = msgspec.structs.replace(FollowerSpace(*numbers), desired_x=0.075, desired_y=0.0, desired_z=2e-3)
    forces = []
    for tick in range(1, 3500):
        model = ModelUpdate(VERSION, tick, 0, 0, "kelvin-voigt", (300.0, 0.0), (), 0.0, True, "", "x", b"", 0, 0, HERE)
        news: list[Any] = [Telemetry(VERSION, tick, 0, *(0,) * 7, False, False, 0, 1, 1, space=space)]
        news += [model] if tick >= 3 else []
        if tick == 2500:  # a hill turns up under the hand
            height = 0.003 + 0.1 * 8e-3 * (ROWS - 9)
            news.append(FieldUpdate(VERSION, 1, 0, b"", 0, packed_shape(ROWS, COLUMNS, height, 0.0 * height)))
        place = (0.075, 0.0, 2e-3 - 2e-6 * min(tick, 2000))
        inputs = leader.Inputs(place, news, MS, 0, exact_position=NOT_KNOWN, intended_position=NOT_KNOWN)
        space_told = leader.step(leading, inputs, tick * MS)[1].record.space
        forces.append((space_told.force_x, space_told.force_y, space_told.force_z))
    steps = np.linalg.norm(np.diff(forces[2400:], axis=0), axis=1)
    assert forces[2400][2] > 0.3
    assert forces[-1][0] < -0.03  # its normal has turned; the force along it waits for the hand's work
    assert steps.max() < 0.1
    assert leading.hand.material.refused == 1  # the message holds no scales


@functools.cache
def pressed(**changes: Any) -> SessionLog:
    """Some presses on a hill that stands where it is believed, which nobody sees."""
    chosen = {"scene": "unknown", "specimen": "hill", "fusion": "none", "displacement": 0.0, "turn": 0.0}
    settings = SessionSettings(**(chosen | changes))
    there = make_specimen(settings)
    robot, operator = (make(settings, there) for make in (make_spatial_robot, _operator))
    try:
        return run_session(settings, operator, robot, duration=14.0).log
    finally:
        robot.close()


def _operator(settings: SessionSettings, scene: Any) -> Any:
    return make_spatial_operator(settings, scene, scene.nominal)


@pytest.mark.long
def test_touches_show_the_surface_where_they_were() -> None:
    log = pressed()
    pairs = pair(log)
    shape = scene_figures(log, pairs, look_at_scene(log, pairs))["shape"]
    assert shape["touched_cm2"] > 0.5
    assert shape["rms_mm"] < 0.5
    assert shape["within_two_deviations_percent"] > 60.0
    assert log.follower["exact_force"].max() < 15.0
    assert log.counts["models_refused"] == 0


@pytest.mark.long
def test_it_is_saved_as_a_mesh_and_opened_again(tmp_path: Path) -> None:
    known, path = touched_map(pressed()), tmp_path / "learnt.ply"
    path.write_bytes(map_file(known))
    again, hill = read_map(path), make_scene("hill").surface
    assert again.points == pytest.approx(known.points, abs=1e-7)
    nearest = known.deviation.argmin()
    assert abs(hill.contact(known.points[nearest]).depth) < 1e-3


@pytest.mark.long
@pytest.mark.parametrize("specimen", ["hill", "phantom"])
@pytest.mark.parametrize("seed", range(2))
def test_two_passes_find_the_shape(specimen: str, seed: int) -> None:
    log = simulate(SessionSettings(scene="unknown", specimen=specimen, seed=seed), duration=72.0).log
    pairs = pair(log)
    shape = scene_figures(log, pairs, look_at_scene(log, pairs))["shape"]
    assert shape["touched_cm2"] > 15.0
    assert shape["rms_mm"] < 0.3
