"""Geometry of the picture."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.console.views import shapes
from foretouch.console.views.line import EDGE, STEPS, Material, height_on_axis
from foretouch.robot import Tip

SCENE = SimpleNamespace(add_mesh_simple=lambda name, *mesh, **looks: SimpleNamespace())


@pytest.mark.parametrize(
    "mesh",
    [
        shapes.probe(),
        shapes.probe(growth=0.1),
        shapes.probe(Tip.of(0.1, shapes.TIP_RADIUS)),
        shapes.probe(Tip.of(4.0, shapes.TIP_RADIUS), growth=0.12),
        shapes.handle(),
        shapes.DOWNWARDS,
        shapes.uncertainty(0.5, 0.7),
        shapes.uncertainty(0.0, 0.0),
        shapes.arrow(2.0),
        shapes.arrow(0.0),
    ],
)
def test_bodies_are_closed(mesh):
    vertices, faces = mesh
    assert np.isfinite(vertices).all()
    assert faces.max() < len(vertices)
    # Every edge inside the body of revolution belongs to two triangles; only the ends, of radius 0, have one.
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    single = {
        tuple(edge) for edge, count in zip(*np.unique(edges, axis=0, return_counts=True), strict=True) if count == 1
    }
    assert all(np.hypot(*vertices[i, :2]) < 1e-6 for edge in single for i in edge)


def test_probe_stands_on_its_tip():
    assert shapes.probe()[0][:, 2].min() == pytest.approx(0.0, abs=1e-6)
    assert shapes.probe()[0][:, 2].max() == pytest.approx(shapes.HANDLE_HEIGHT)


@pytest.mark.parametrize("radius", [0.1, 0.8, 4.0])
def test_a_sphere_is_drawn_about_the_position(radius):
    tip = Tip.of(radius, shapes.TIP_RADIUS)
    for growth in (0.0, 0.12):
        vertices = shapes.probe(tip, growth)[0].astype(float)
        ball = vertices[vertices[:, 2] < 0.5 * radius]
        np.testing.assert_allclose(np.linalg.norm(ball, axis=1), radius + growth, rtol=1e-5)
        assert vertices[:, 2].min() == pytest.approx(-radius - growth, rel=1e-5)
        assert np.hypot(*vertices[:, :2].T).max() == pytest.approx(radius + growth, rel=0.02)
        assert vertices[:, 2].max() == pytest.approx(shapes.rod_end(tip), rel=1e-6)
    assert shapes.rod_end(tip) > radius + 3.0


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.floats(-2.0, 2.9))
def test_material_sinks_under_the_tip_and_nowhere_at_its_edge(depth):
    material = Material(SCENE)
    top, cut = material.top(depth), material.cut(depth)
    assert top[:, 2].min() == pytest.approx(-max(depth, 0.0), abs=1e-5)
    assert (top[:, 2] <= 1e-6).all()
    edge = np.hypot(top[:, 0], top[:, 1]) >= EDGE
    assert edge.any()
    assert top[edge, 2] == pytest.approx(0.0, abs=1e-6)
    # The cut's upper line is the top's edge, and its layers never cross.
    layers = cut.reshape(-1, 7, 3)
    levels = layers[..., 2]
    rim = top[np.isclose(top[:, 1], 0.0, atol=1e-6)]
    assert len(np.unique(rim[:, 0])) == len(layers)
    assert rim[:, 2] == pytest.approx(np.interp(rim[:, 0], layers[:, 0, 0], levels[:, 0]), abs=1e-5)
    assert (np.diff(levels, axis=1) <= 1e-6).all()
    assert levels.min() >= -3.0 - 1e-6


@pytest.mark.parametrize("depth", [0.0, 0.3, 1.4, 2.9])
def test_each_part_of_the_surface_has_the_colour_of_how_far_it_has_sunk(depth):
    material = Material(SCENE)
    parts = material.levels(depth)
    assert sum(map(len, parts)) == len(material.top_faces)
    sunk = -material.top(depth)[:, 2]
    for faces, low, high in zip(parts, (-1.0, *STEPS), (*STEPS, 9.0), strict=True):
        mean = sunk[faces].reshape(-1, 6).mean(axis=1)  # of both triangles of a quad
        assert ((mean >= low) & (mean <= high)).all()
    assert len(parts[-1]) > 0 or depth < 1.6


@settings(derandomize=True, deadline=None, max_examples=60)
@given(
    st.tuples(st.floats(-20, 20), st.floats(-30, -3), st.floats(-10, 20)), st.floats(-5.0, 10.0), st.floats(0.2, 3.0)
)
def test_height_under_the_mouse_is_where_the_line_of_sight_meets_the_axis(eye, height, part):
    eye = np.array(eye)
    seen = eye + part * (np.array([0.0, 0.0, height]) - eye)
    assert height_on_axis(eye, seen) == pytest.approx(height, abs=1e-6)


def test_looking_along_the_axis_gives_no_height():
    assert math.isnan(height_on_axis(np.array([0.0, 0.0, 10.0]), np.array([0.0, 0.0, 1.0])))
