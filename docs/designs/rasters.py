"""Rasters that designs of a material over a surface are compared on, and the scores that all of them get.

A hand palpates a simulated scene as `--operator scripted` does: presses at the corners, then rows that slide. The probe
is where the hand was, 15 ms late, and the fixture where it is believed: what is compared is the material alone.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from foretouch.devices.device import minimum_jerk
from foretouch.quantities.pose import RigidMotion
from foretouch.rendering import SurfaceProxy
from foretouch.robot import make_material
from foretouch.session.spatial.making import PRESS_DEPTH, SpatialWorld
from foretouch.session.spatial.scenes import Scene, make_scene, palpation

Array = NDArray[np.float64]

PERIOD, LAG, NOISE = 1e-3, 0.015, 0.02
"""Of the samples [s]; time constant of the arm [s]; of the sensor [N]."""

DELAY = 300  # Of what is predicted [ticks]
TOLD_WITHIN = 3e-3
"""The past could tell a force that is felt no deeper than one so near to it was, a delay before [m]."""

SCORED_FROM = 2.0  # [s]


class Raster(NamedTuple):
    """What is felt on a way over a surface; columns of shape (n,), points of shape (n, 3)."""

    time: Array  # [s]
    point: Array  # closest point of the surface, in the fixture's frame [m]
    depth: Array  # [m], negative outside
    velocity: Array  # of the depth [m/s]
    force: Array  # along the normal, with noise [N]
    true: Array  # without [N]
    factor: Array  # by which the material is stronger than elsewhere

    def error(self, predicted: Array, among: NDArray[np.bool_] | None = None) -> float:
        """RMS of the error, in percent of that of the force, in contact or where contact is predicted."""
        scored = (self.time > SCORED_FROM) & ((self.depth > 0.0) | (predicted > 0.0))
        scored &= np.ones(scored.size, np.bool_) if among is None else among
        difference = predicted[scored] - self.true[scored]
        return 100.0 * float(np.sqrt(np.mean(difference**2) / np.mean(self.true[scored] ** 2)))

    def told(self) -> NDArray[np.bool_]:
        """Where the past could tell: see `told`."""
        return told(self.point, self.depth, DELAY)


def told(point: Array, depth: Array, delay: int) -> NDArray[np.bool_]:
    """Where what was felt so many rows before could tell the force: see `TOLD_WITHIN`; by cells of a millimetre."""
    cell = 1e-3
    reach = round(TOLD_WITHIN / cell)
    low = point[:, :2].min(axis=0) - 2.0 * TOLD_WITHIN
    at = np.rint((point[:, :2] - low) / cell).astype(int)
    deepest = np.full(at.max(axis=0) + 2 * reach + 1, -1.0)
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    near = np.hypot(rows, columns) <= reach
    rows, columns = rows[near], columns[near]
    found = np.zeros(depth.size, np.bool_)
    for tick in range(depth.size):
        if tick >= delay and depth[tick - delay] > 0.0:
            about = at[tick - delay, 0] + rows, at[tick - delay, 1] + columns
            deepest[about] = np.maximum(deepest[about], depth[tick - delay])
        found[tick] = 0.0 < depth[tick] <= deepest[tuple(at[tick])]
    return found


@lru_cache(maxsize=4)
def raster(scene: str, material: str, seed: int, seconds: float = 72.0) -> Raster:
    """A hand goes over a scene by name, again and again for so long; the seed varies depths and noise."""
    return raster_over(make_scene(scene), material, seed, seconds)


def raster_over(made: Scene, material: str, seed: int, seconds: float) -> Raster:
    """The same over any scene."""
    path, time = palpation(made, PRESS_DEPTH, seed), np.arange(0.0, seconds, PERIOD)
    moments, places = np.array([moment for moment, _ in path]), np.array([place for _, place in path])
    cycle = time % moments[-1]
    part = np.clip(np.searchsorted(moments, cycle, side="right") - 1, 0, len(moments) - 2)
    share = (cycle - moments[part]) / (moments[part + 1] - moments[part])
    smooth = np.array([minimum_jerk(value) for value in share.tolist()])
    wanted = places[part] + smooth[:, None] * (places[part + 1] - places[part])
    weight = -math.expm1(-PERIOD / LAG)
    probe, _ = lfilter([weight], [1.0, weight - 1.0], wanted, axis=0, zi=(1.0 - weight) * wanted[:1])
    speed = np.gradient(probe, PERIOD, axis=0)
    world = SpatialWorld(made, make_material(material), displacement=0.0, turn=0.0, bump=0.0, seed=seed)
    motion, proxy = RigidMotion.from_numbers(world.fixture()), SurfaceProxy(made.surface)
    rows = []
    for place, velocity in zip(map(tuple, probe.tolist()), map(tuple, speed.tolist()), strict=True):
        force = world.touch(motion.apply(place), motion.rotate(velocity), PERIOD)
        contact = proxy.follow(place)
        along = sum(a * b for a, b in zip(force, motion.rotate(contact.normal), strict=True))
        factor = 1.0 if made.inclusion is None else made.inclusion.factor(place)
        rows.append((*contact.point, contact.depth, along, factor))
    table = np.array(rows)
    depth, true = table[:, 3], table[:, 4]
    noise = np.random.default_rng([seed, 3]).normal(0.0, NOISE, time.size)
    return Raster(time, table[:, :3], depth, np.gradient(depth, PERIOD), true + noise, true, table[:, 5])
