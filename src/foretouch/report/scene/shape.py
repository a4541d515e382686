"""The shape of a surface that was learnt, and how far it is from what stands there."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from foretouch.errors import DecodeError, ForetouchError
from foretouch.messages import SessionLog
from foretouch.models import ShapeField
from foretouch.quantities import Array, Pose
from foretouch.rendering.surfaces.learnt import surface_of
from foretouch.report.numbers import number_of, setting
from foretouch.report.scene.map import CELL, height_of, touched_among
from foretouch.report.scene.pose import AXES, SceneRows
from foretouch.session.spatial import Scene, make_scene
from foretouch.session.spatial.scenes import SPECIMEN
from foretouch.settings import UNKNOWN


def learnt_shape(log: SessionLog) -> ShapeField | None:
    """The shape that the last process of the follower has told in a log; None where it told none that can be read."""
    shape = ShapeField()
    for update in log.fields:
        if update.run == log.fields[-1].run and update.shape:
            with suppress(DecodeError):
                shape.take(update.shape)
    return shape if shape.count else None


def scene_of(log: SessionLog) -> Scene | None:
    """The scene of a session, with the surface as it was known at the end; None where it is not here, or not known.

    Of a surface that was learnt, inclusion and friction are those of what a simulation pressed.
    """
    name = setting(log.settings, "scene", "")
    if name != UNKNOWN:
        return _made(log, name)
    shape, there = learnt_shape(log), specimen_of(log)
    if shape is None:
        return None
    surface = surface_of(shape)
    return Scene(name, surface) if there is None else replace(there, name=name, surface=surface)


def specimen_of(log: SessionLog) -> Scene | None:
    """What a simulation pressed where no shape was given; None where it is not here."""
    return _made(log, setting(log.settings, "specimen", "") or SPECIMEN)


def _made(log: SessionLog, name: str) -> Scene | None:
    radius, rubs = number_of(log.settings, "probe_radius", 0.0), setting(log.settings, "friction", "dry")
    try:
        return make_scene(name, radius, rubs)
    except ForetouchError:
        return None


def shape_figures(shape: ShapeField, rows: SceneRows, places: Array, true: Scene | None) -> dict[str, Any]:
    """The learnt shape in numbers, where the probe was within 3 mm.

    Args:
        shape: As learnt.
        rows: Rows of the session.
        places: Points that were touched, seen from above in the fixture's frame [m], shape (n, 2).
        true: What stands there; None where it is unknown.

    Returns:
        ``nodes``; ``touched_cm2``; and of the height where it was touched ``deviation_mm``, its median standard
        deviation. ``rms_mm``, ``p95_mm`` and ``mean_mm`` of its error where the follower had the surface at the end,
        against where it was: with the error of the fixture's pose. ``alone_rms_mm`` without it, after the best shift
        and tilt. ``within_two_deviations_percent`` of the points. None where the truth is unknown or nothing was
        touched.
    """
    names = ("deviation_mm", "rms_mm", "p95_mm", "mean_mm", "alone_rms_mm", "within_two_deviations_percent")
    points = touched_among(places)
    figures: dict[str, Any] = {"nodes": shape.count, "touched_cm2": len(points) * (1e2 * CELL) ** 2}
    figures |= dict.fromkeys(names)
    if not len(points):
        return figures
    heights, deviations = shape.heights_at(points)
    figures["deviation_mm"] = 1e3 * float(np.median(deviations))
    if true is None:
        return figures
    believed, there = (_last_pose(rows, name) for name in ("fixture", "exact"))
    shown = (there.inverse() @ believed).apply(np.column_stack([points, heights]))
    error = shown[:, 2] - np.array([height_of(true, x, y) for x, y in shown[:, :2].tolist()])
    level = np.column_stack([np.ones(len(points)), points])
    alone = error - level @ np.linalg.lstsq(level, error, rcond=None)[0]
    figures["rms_mm"] = 1e3 * float(np.sqrt(np.mean(error**2)))
    figures["p95_mm"] = 1e3 * float(np.percentile(np.abs(error), 95.0))
    figures["mean_mm"] = 1e3 * float(error.mean())
    figures["alone_rms_mm"] = 1e3 * float(np.sqrt(np.mean(alone**2)))
    figures["within_two_deviations_percent"] = 100.0 * float(np.mean(np.abs(error) <= 2.0 * deviations))
    return figures


def _last_pose(rows: SceneRows, name: str) -> Pose:
    numbers = [float(rows.probe[f"{name}_{axis}"][-1]) for axis in AXES]
    return Pose.from_rotation_vector(numbers[3:], numbers[:3])


def shape_line(shape: Mapping[str, Any] | None) -> str:
    """The same as a line of text; "" where no shape was learnt."""
    if shape is None or shape["deviation_mm"] is None:
        return ""
    told = f"learnt to {shape['deviation_mm']:.2g} mm over {shape['touched_cm2']:.3g} cm2 touched"
    if shape["rms_mm"] is None:
        return f"  shape      {told}"
    wrong = f"wrong by {shape['rms_mm']:.2g} mm RMS, {shape['p95_mm']:.2g} mm in 95 %"
    alone = f"{shape['alone_rms_mm']:.2g} mm RMS without shift and tilt"
    return f"  shape      {told}; {wrong}; {alone}"
