"""What is predicted ahead of a hand that slides, against the field that it comes from; and the ribbon that shows it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from foretouch.console.models_seen import ModelFigures, figures_of
from foretouch.console.playback import Playback
from foretouch.console.plots import Row
from foretouch.console.views.probes import AHEAD, UNITS, Ahead, Outlook, Ribbon
from foretouch.console.views.shapes import COLOURS, levels_of
from foretouch.messages import fixture_of
from foretouch.models import FIELD_DEPTH, ScaleField
from foretouch.models.scale_field import packed
from foretouch.models.scale_field_kernel import SIDE, SPACING, SPREAD
from foretouch.quantities.pose import RigidMotion
from foretouch.rendering import Surface
from foretouch.session import SessionSettings, simulate
from foretouch.session.spatial import make_scene

LAW = ModelFigures((), (), (), 400.0, 40.0)
"""A law with a local stiffness of 400 N/m, known to a tenth."""


def touched_at(*places: tuple[float, float], scale: float = 3.0, deviation: float = 0.1) -> ScaleField:
    """A field that was touched at the nodes next to places of the fixture's frame [m]."""
    i, j = (np.rint(np.array(axis) / SPACING).astype(int) + SIDE // 2 for axis in zip(*places, strict=True))
    field = ScaleField()
    field.take(packed(i, j, np.full(i.size, math.log(scale)), np.full(i.size, deviation**2)))
    return field


def seen_from(
    surface: Surface, field: ScaleField | None, *here: tuple[float, float], law: ModelFigures | None = LAW
) -> Ahead | None:
    """What is ahead at the last of the places through which a hand slides."""
    outlook = Outlook(surface)
    for x, y in here:
        outlook.follow(surface.bare.contact((x, y, 0.004)).point)
    return outlook.look(field, law)


@pytest.mark.parametrize("radius", [0.0, 0.004])
@pytest.mark.parametrize("name", ["plane", "hill"])
def test_what_is_ahead_is_what_the_field_says_there(name: str, radius: float) -> None:
    surface = make_scene(name, radius).surface
    field = touched_at((0.069, 0.0), (0.072, 0.003), scale=3.0)
    ahead = seen_from(surface, field, (0.060, -0.002), (0.063, -0.001), (0.066, 0.0))
    assert ahead is not None
    assert len(ahead.points) == 16
    assert np.linalg.norm(np.diff(ahead.points, axis=0), axis=1) == pytest.approx(2e-3, rel=0.02)
    for point, normal, stiffness, deviation in zip(*ahead[:4], strict=True):
        scale, own = field.scale_at(point)
        assert stiffness == pytest.approx(400.0 * scale, rel=1e-9)
        assert deviation == pytest.approx(math.hypot(0.1, own), rel=1e-9)
        contact = surface.bare.contact(point)
        assert contact.depth == pytest.approx(0.0, abs=1e-6)
        np.testing.assert_allclose(contact.normal, normal, atol=0.05)
    straight = (ahead.points - ahead.points[0])[:, :2]
    np.testing.assert_allclose(straight[1:, 1] / straight[1:, 0], 1.0 / 3.0, atol=0.03)  # as it slid
    row = ahead.row()
    assert row.value == f"{ahead.stiffness[5]:,.0f} N/m"
    assert row.more == f"± {100.0 * ahead.deviation[5]:.0f} %"
    assert np.linalg.norm(ahead.points[5] - ahead.points[0]) == pytest.approx(0.01, rel=0.02)


def test_it_is_less_sure_the_further_it_is_from_what_was_touched() -> None:
    surface = make_scene("plane").surface
    ahead = seen_from(surface, touched_at((0.06, 0.0), deviation=0.05), (0.054, 0.0), (0.06, 0.0))
    assert ahead is not None
    away = ahead.points[:, 0] - 0.06
    assert ahead.deviation[0] == pytest.approx(math.hypot(0.1, 0.05), rel=1e-2)
    assert (np.diff(ahead.deviation[ahead.known]) > 0.0).all()
    assert (np.diff(ahead.stiffness[ahead.known]) < 0.0).all()  # it goes back to the law's
    known = ahead.known
    field = 1.0 - (1.0 - 0.05**2) * np.exp(-2.0 * away / 0.02)  # the variance of the process that has forgotten
    np.testing.assert_allclose(ahead.deviation[known], np.sqrt(field + 0.1**2)[known], atol=0.06)
    np.testing.assert_array_equal(known, away < 0.0265)
    nowhere = math.hypot(0.1, SPREAD)
    assert ahead.deviation[~known] == pytest.approx(nowhere)
    assert ahead.stiffness[~known] == pytest.approx(400.0)


def test_nothing_is_ahead_before_it_moves_or_was_learnt_and_the_surface_ends() -> None:
    surface, field, line = make_scene("plane").surface, touched_at((0.06, 0.0)), ((0.05, 0.0), (0.06, 0.0))
    assert seen_from(surface, field, (0.06, 0.0), (0.061, 0.0)) is None  # noise
    assert seen_from(surface, field, (0.02, 0.0), (0.06, 0.0)) is None  # a leap
    assert seen_from(surface, field, *line, (math.nan, 0.0)) is None
    assert seen_from(surface, None, *line) is None
    assert seen_from(surface, field, *line, law=None) is None
    assert seen_from(surface, field, *line, law=LAW._replace(stiffness=math.nan)) is None
    for name in ("plane", "hill"):
        ended = seen_from(make_scene(name).surface, field, (0.10, 0.0), (0.11, 0.0))
        assert ended is not None
        assert ended.points[-1, 0] == pytest.approx(0.115, abs=2.1e-3)
        assert ended.row() == Row(AHEAD, "surface ends")
    far = seen_from(surface, field, (0.09, 0.02), (0.095, 0.02))
    assert far is not None
    assert far.row() == Row(AHEAD, "not known")


def test_a_hand_that_rests_or_presses_keeps_its_way_and_one_that_turns_back_has_another() -> None:
    surface = make_scene("plane").surface
    outlook = Outlook(surface)
    for x in (0.05, 0.055, 0.0545, 0.0551):
        outlook.follow((x, 0.0, 0.0))
    assert outlook.way == pytest.approx((1.0, 0.0, 0.0))
    outlook.follow((0.0505, 0.0, 0.0))
    assert outlook.way == pytest.approx((-1.0, 0.0, 0.0))


def test_the_ribbon_is_as_wide_as_it_is_unsure_and_has_the_colours_of_the_map() -> None:
    node = {"add_mesh_simple": lambda name, *mesh, **looks: SimpleNamespace(vertices=None, faces=None, visible=True)}
    lines = {"add_line_segments": lambda name, *points, **looks: SimpleNamespace(points=None, visible=True)}
    ribbon = Ribbon(SimpleNamespace(**node, **lines), "/space/fixture")
    ahead = seen_from(make_scene("hill").surface, touched_at((0.06, 0.0), scale=4.0), (0.054, 0.0), (0.06, 0.0))
    assert ahead is not None
    edges = np.linspace(400.0, 1800.0, len(COLOURS) + 1)
    ribbon.draw(ahead, edges, lambda vertices: vertices)
    shown = [(step, part) for step, part in enumerate(ribbon._steps, 1) if part.visible]
    drawn = {
        int(face): step for step, part in shown for face in np.unique(np.sort(part.faces.reshape(-1, 6))[:, 0] // 2)
    }
    count = int(ahead.known.sum())
    middle = 0.5 * (ahead.stiffness[:-1] + ahead.stiffness[1:])[: count - 1]
    expected = levels_of(edges, middle, np.ones(count - 1, bool))
    assert drawn == dict(enumerate(expected.tolist()))
    assert len(set(drawn.values())) > 3
    sides = shown[0][1].vertices.reshape(-1, 2, 3)[:count] / UNITS
    width = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1)
    np.testing.assert_allclose(width, 2.0 * (0.6e-3 + 6e-3 * np.minimum(ahead.deviation[:count], 1.0)), rtol=1e-4)
    assert (np.diff(width) >= 0.0).all()
    assert sides.mean(axis=1) == pytest.approx(ahead.points[:count] + 5e-4 * ahead.normals[:count], abs=1e-6)
    assert all(rim.visible for rim in ribbon._rims)
    ribbon.draw(None, edges, lambda vertices: vertices)
    assert not any(part.visible for part in (*ribbon._steps, *ribbon._rims))


@pytest.mark.long
def test_at_the_hand_it_is_the_scale_that_the_leader_renders() -> None:
    still = {"fusion": "none", "displacement": 0.0, "turn": 0.0}
    chosen = SessionSettings(scene="phantom", probe_radius=0.004, **still)
    shown, outlook = Playback(simulate(chosen, duration=22.0).log), Outlook(make_scene("phantom", 0.004).surface)
    ratios = []
    for moment in np.arange(8.0, 22.0, 0.05).tolist():
        shown.go_to(moment)
        leader = shown.leader_space
        point = leader.point_x, leader.point_y, leader.point_z
        outlook.follow(RigidMotion.from_numbers(fixture_of(leader)).apply_back(point))
        law = None if shown.model is None else figures_of(shown.model, FIELD_DEPTH)
        ahead = outlook.look(shown.space.field(shown.telemetry_sequence), law)
        if ahead is not None and law is not None and leader.depth > 0.0:
            ratios.append(ahead.stiffness[0] / law.stiffness / leader.scale)
    assert len(ratios) > 50
    np.testing.assert_allclose(ratios, 1.0, atol=1e-9)
