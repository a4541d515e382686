"""A surface that moves in place: it is at last what a fixed one of the same heights is, and never leaps."""

from __future__ import annotations

import numpy as np
import pytest

from foretouch.models import ShapeField
from foretouch.rendering.surfaces import SurfaceProxy
from foretouch.rendering.surfaces.learnt import LARGEST_STEP, NODES, LearntSurface, surface_of

X = 0.075


def bumpy(seed: int) -> LearntSurface:
    surface = LearntSurface()
    surface.field.coefficients[:] = 1.5e-3 * np.random.default_rng(seed).normal(size=surface.field.coefficients.shape)
    surface.aim()
    return surface


@pytest.mark.parametrize("seed", range(3))
def test_it_becomes_the_surface_that_was_learnt(seed: int) -> None:
    surface, random = bumpy(seed), np.random.default_rng(seed)
    fixed = surface_of(surface.field)
    for _ in range(5000):  # beside the probe, in its own rows, a vertex takes a small step in nine ticks
        surface.settle(X, 0.0)
    assert not surface.settle(X, 0.0)
    assert surface.mesh.vertices == pytest.approx(fixed.mesh.vertices, abs=3e-6)
    triangles, others = surface.mesh.shape.triangles, fixed.mesh.shape.triangles
    assert triangles["corners"] == pytest.approx(others["corners"], abs=3e-6)
    assert triangles["normals"] == pytest.approx(others["normals"], abs=0.05)  # of a corner by area, not by angle
    for place in random.uniform((X - 0.05, -0.05, -0.004), (X + 0.05, 0.05, 0.02), (300, 3)):
        here, there = surface.contact(place), fixed.contact(place)
        assert here.depth == pytest.approx(there.depth, abs=1e-5)


def test_no_vertex_near_the_probe_moves_further_than_a_step() -> None:
    surface = bumpy(0)
    vertices = surface.mesh.vertices.reshape(NODES, NODES, 3)
    middle = NODES // 2
    near = slice(middle - 3, middle + 4)
    for _ in range(100):
        before = vertices[near, near, 2].copy()
        surface.settle(X, 0.0)
        assert np.abs(vertices[near, near, 2] - before).max() <= 2.0 * LARGEST_STEP + 1e-12


def test_a_probe_that_it_rises_past_is_in_contact_and_out_again() -> None:
    surface = LearntSurface()
    proxy = SurfaceProxy(surface)
    assert proxy.follow((X, 0.0, 5e-4)).depth == pytest.approx(-5e-4)
    for height, inside in ((2e-3, True), (0.0, False)):
        surface.field.coefficients[:] = height
        surface.aim()
        depths = []
        while surface.settle(X, 0.0):
            depths.append(proxy.follow((X, 0.0, 5e-4)).depth)
        assert depths[-1] == pytest.approx(height - 5e-4, abs=3e-6)
        assert (depths[-1] > 0.0) is inside
        assert np.abs(np.diff(depths)).max() <= 2.0 * LARGEST_STEP + 1e-9


def test_a_probe_that_is_nowhere_moves_it_all_the_same() -> None:
    surface = bumpy(1)
    assert surface.settle(np.nan, np.nan)
    assert np.isfinite(surface.mesh.vertices).all()


def test_nothing_known_is_flat() -> None:
    flat = surface_of(ShapeField())
    assert flat.contact((X, 0.0, 0.01)).depth == pytest.approx(-0.01)
    assert not LearntSurface().settle(X, 0.0)
