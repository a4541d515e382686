"""The map of a scene's local stiffness as it was learnt, beside what a simulated scene is made of."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from foretouch.errors import DecodeError
from foretouch.messages import SessionLog
from foretouch.models import FIELD_DEPTH, ContactModel, ScaleField, stiffness_at_rest
from foretouch.quantities import Array, ByValue, Flags
from foretouch.quantities.pose import RigidMotion
from foretouch.report.scene.pose import AXES, SceneRows, vectors
from foretouch.robot import make_material
from foretouch.session.spatial import Scene

CELL = 1e-3  # Side of a cell of the map [m]
NEAR = 3e-3  # Largest distance of the probe from a point that counts as touched [m]
PRESSED = 0.05  # Force of a touch [N]

MIDDLE, REACH = (0.075, 0.0), 0.03  # Middle of the map in the fixture's frame, and half its side [m]

HIGH, CLOSE, STEPS = 0.2, 1e-6, 30
"""Height above the surface at which rays begin, distance at which they end [m], and their largest number of steps."""

STIFFEST = 98.0  # Percentile of the local stiffness taken as the largest: a single point may overshoot


@dataclass(frozen=True, eq=False)
class StiffnessMap(ByValue):
    """Local stiffness at rest over a scene's surface, seen from above; fields of shape (rows, columns)."""

    x: Array  # coordinates of the columns, in the fixture's frame [m]
    y: Array  # coordinates of the rows [m]
    learnt: Array  # local stiffness at `depth` [N/m]
    uncertainty: Array  # its standard deviation [N/m]
    true: Array | None  # stiffness of the simulated material; None where it is unknown
    touched: Flags  # whether the probe was within 3 mm of the point
    depth: float = FIELD_DEPTH  # depth at which it is taken [m]


def learnt_field(log: SessionLog) -> ScaleField | None:
    """The field that the last process of the follower has told in a log; None where it told none that can be read."""
    field = ScaleField()
    for update in log.fields:
        if update.run == log.fields[-1].run:
            with suppress(DecodeError):
                field.take(update.content)
    return field if field.count else None


def stiffness_map(
    places: Array,
    field: ScaleField,
    law: ContactModel,
    scene: Scene,
    material: str | None,
    felt_deeper: float = 0.0,
) -> StiffnessMap:
    r"""Learnt and true local stiffness over the surface.

    .. math:: K(p) = s(p)\, \frac{\partial f}{\partial d}(d, 0)

    with the law f of the whole material at rest and its scale s; the truth has the material's law and the inclusion's
    factor. Depths count from the shape of the scene. A soft material is detected late, and the law begins where contact
    was detected: that is taken off. The places are those that were touched, of shape (n, 2), in the fixture's frame
    [m].
    """
    x, y = _axes()
    points = np.array([(column, row, height_of(scene, column, row)) for row in y.tolist() for column in x.tolist()])
    scales, deviations = field.scales_at(points)
    learnt = scales * stiffness_at_rest(law, max(FIELD_DEPTH - felt_deeper, 0.0))
    shape = (y.size, x.size)
    touched = _touched(points, places)
    true = None if material is None else _true_stiffness(scene, material, points).reshape(shape)
    return StiffnessMap(x, y, learnt.reshape(shape), (learnt * deviations).reshape(shape), true, touched.reshape(shape))


def map_figures(stiffness: StiffnessMap, field: ScaleField, scene: Scene) -> dict[str, Any]:
    """The map in numbers.

    Returns:
        ``depth_mm``; ``touched_cm2``; ``nodes``; ``median_error_percent`` and ``p95_error_percent`` of the local
        stiffness where it was touched; ``within_two_deviations_percent`` of these points; ``learnt_N_per_m``: the
        least, median and largest local stiffness there. ``inclusion``: ``centre_mm`` and ``radius_mm`` of the region
        stiffer than half way between the median and the stiffest (98 %), among points touched on all sides, ``ratio``
        of the stiffest to the median, the same with ``true_``, and ``centre_error_mm``; None where the scene has none,
        or where all that was touched is alike. Figures that need the truth are None where it is unknown.
    """
    inside, learnt = stiffness.touched, stiffness.learnt[stiffness.touched]
    figures: dict[str, Any] = {
        "depth_mm": 1e3 * stiffness.depth,
        "touched_cm2": float(inside.sum()) * (1e2 * CELL) ** 2,
        "nodes": field.count,
        **dict.fromkeys(("median_error_percent", "p95_error_percent", "within_two_deviations_percent")),
        **dict.fromkeys(("learnt_N_per_m", "inclusion")),
    }
    if not inside.any():
        return figures
    figures["learnt_N_per_m"] = [float(value) for value in (learnt.min(), np.median(learnt), learnt.max())]
    if stiffness.true is None:
        return figures
    true = stiffness.true[inside]
    error = 100.0 * np.abs(learnt - true) / true
    figures["median_error_percent"] = float(np.median(error))
    figures["p95_error_percent"] = float(np.percentile(error, 95.0))
    within = np.abs(learnt - true) <= 2.0 * stiffness.uncertainty[inside]
    figures["within_two_deviations_percent"] = 100.0 * float(within.mean())
    if scene.inclusion is not None:
        figures["inclusion"] = _inclusion(stiffness, scene)
    return figures


def _inclusion(stiffness: StiffnessMap, scene: Scene) -> dict[str, Any] | None:
    assert scene.inclusion is not None
    learnt = stiffness.learnt[stiffness.touched]
    median, most = (float(value) for value in np.percentile(learnt, [50.0, STIFFEST]))
    stiff = among_touched(stiffness) & (stiffness.learnt > 0.5 * (median + most))
    if not stiff.any():  # all that was touched is alike
        return None
    row, column = np.nonzero(stiff)
    centre = np.array([stiffness.x[column].mean(), stiffness.y[row].mean()])
    true = np.array(scene.inclusion.middle[:2])
    return {
        "centre_mm": (1e3 * centre).tolist(),
        "radius_mm": 1e3 * float(np.sqrt(stiff.sum() / np.pi)) * CELL,
        "ratio": most / median,
        "true_centre_mm": (1e3 * true).tolist(),
        "true_radius_mm": 1e3 * scene.inclusion.radius,
        "true_ratio": scene.inclusion.ratio,
        "centre_error_mm": 1e3 * float(np.linalg.norm(centre - true)),
    }


def among_touched(stiffness: StiffnessMap) -> Flags:
    """Places that have touched ones on all sides: between two rows of presses the field joins them."""
    x, y = np.meshgrid(stiffness.x, stiffness.y)
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    touched = points[stiffness.touched.ravel()]
    if len(touched) < 3 or min(np.ptp(touched, axis=0)) < CELL:
        return stiffness.touched
    return np.asarray(Delaunay(touched).find_simplex(points) >= 0).reshape(x.shape)


def height_of(scene: Scene, x: float, y: float) -> float:
    """Height of the surface at a point: from above down by the free distance, again and again [m]."""
    height = HIGH
    for _ in range(STEPS):
        free = -scene.surface.bare.contact((x, y, height)).depth
        if not free > CLOSE:
            break
        height -= free
    return height


def _axes() -> tuple[Array, Array]:
    """Coordinates of the map's columns and rows [m]."""
    along = np.arange(-REACH, REACH + 0.5 * CELL, CELL)
    return MIDDLE[0] + along, MIDDLE[1] + along


def touched_among(places: Array) -> Array:
    """Those points of the map that are near a place that was touched, shape (n, 2) [m]."""
    x, y = (grid.ravel() for grid in np.meshgrid(*_axes()))
    points = np.column_stack([x, y])
    return points[_touched(points, places)]


def _touched(points: Array, touched: Array) -> Flags:
    if not len(touched):
        return np.zeros(len(points), dtype=np.bool_)
    return np.asarray(cKDTree(touched).query(points[:, :2])[0] < NEAR)


def touched_places(rows: SceneRows, radius: float = 0.0) -> Array:
    """Points pressed by the probe, seen from above in the fixture's frame [m], every 10 ms, shape (n, 2).

    A sphere of a radius [m] presses with its deepest point. The probe's position is taken from the true pose of the
    fixture, else from the follower's estimate.
    """
    probe = rows.probe
    deepest = vectors(probe, "place") - (radius * vectors(probe, "normal") if radius else 0.0)
    known = np.isfinite(probe["exact_x"])
    pressed = np.flatnonzero(rows.follower["in_contact"] & (rows.follower["force"] > PRESSED))[::10]
    points = []
    for row in pressed:
        frame = "exact" if known[row] else "fixture"
        pose = [float(probe[f"{frame}_{axis}"][row]) for axis in AXES]
        x, y, z = deepest[row].tolist()
        points.append(RigidMotion.from_numbers(pose).apply_back((x, y, z))[:2])
    return np.reshape(np.array(points), (-1, 2))


def _true_stiffness(scene: Scene, material: str, points: Array) -> Array:
    """Slope of the material's force at rest over depth, times the inclusion's factor [N/m]."""
    slope = stiffness_at_rest(make_material(material).model)
    if scene.inclusion is None:
        return np.full(len(points), slope)
    return np.array([slope * scene.inclusion.factor((x, y, z)) for x, y, z in points.tolist()])
