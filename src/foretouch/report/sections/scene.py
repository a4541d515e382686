"""A session in three dimensions: what became of the scene, in text and drawn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from foretouch.messages import FRICTION_NUMBERS, SessionLog
from foretouch.quantities import Array, new_figure
from foretouch.report.drawing import (
    ERROR,
    NARROW,
    PREDICTED,
    TRUE,
    curve,
    extremes,
    finished,
    joined,
    legend,
    note,
    shade,
)
from foretouch.report.numbers import Finding, figure, filled
from foretouch.report.rows import Pairs
from foretouch.report.scene import SceneFindings, Wrong
from foretouch.report.scene.map import StiffnessMap
from foretouch.report.scene.pose import NEAR_DEGREES, NEAR_MM, PoseError
from foretouch.report.scene.shape import shape_line
from foretouch.report.scene.spots import Spot
from foretouch.report.sections import Drawing, Section, View
from foretouch.session.spatial import Inclusion
from foretouch.session.workspace import SPACE

LEAST_MM, LEAST_DEGREES = 0.01, 0.01  # Begin of the axes of errors: no camera knows less


def pose_figure(error: PoseError) -> Any:
    """Error of the rendered fixture in at least one tick, position and rotation, with the filter's deviations."""
    figure = new_figure(6.4)
    distance, turn = figure.subplots(2, 1, sharex=True)
    for axes, values, deviation, near, least, unit, what in (
        (distance, error.distance, error.distance_deviation, NEAR_MM, LEAST_MM, "mm", "distance of the origins"),
        (turn, error.turn, error.turn_deviation, NEAR_DEGREES, LEAST_DEGREES, "degrees", "angle"),
    ):
        curve(axes, error.time, np.maximum(values, least), PREDICTED, 1.1, label=what)
        shown = np.maximum(deviation, least)
        curve(axes, error.time, shown, ERROR, 1.1, label="the filter's own standard deviation")
        axes.axhline(near, color="0.4", linestyle=":", linewidth=1.0, label=f"{near:g} {unit}")
        _mark_touches(axes, error)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.tick_params(which="minor", labelleft=False)  # their powers of ten would push the title of the axis out
        axes.set_ylabel(f"error [{unit}]")
    distance.set_title("Where the leader shows the fixture, against where it is: position")
    turn.set(title="The same: turn", xlabel="time [s]")
    legend(distance, columns=5)
    legend(turn, columns=5)
    return finished(figure, 2)


def contact_figure(log: SessionLog, pairs: Pairs, wrong: Wrong, true_friction: float | None, start_ns: int) -> Any:
    """False and missed contacts of rows at equal command, at least one, and friction as it is learnt."""
    figure = new_figure(6.4)
    force, friction = figure.subplots(2, 1, sharex=True)
    curve(force, pairs.time, pairs.follower["exact_force"], TRUE, 1.3, label="true")
    wanted = pairs.leader["predicted_force"]
    curve(force, pairs.time, wanted, PREDICTED, 1.0, label="predicted, along the normal")
    shade(force, pairs.time, wrong.false, ERROR, "false: nothing is there")
    shade(force, pairs.time, wrong.missed, "#CC79A7", "missed")
    shade(force, pairs.time, wrong.first, "0.5", "before any model")
    force.set(title="Contacts at equal command", ylabel="force [N]")
    legend(force, columns=5)
    known = [model for model in log.models if len(model.friction) == FRICTION_NUMBERS]
    rows = [(1e-9 * (model.time_ns - start_ns), *model.friction[:4]) for model in known]
    if rows:
        values = np.array(rows)
        time, coefficient, _, deviation, _ = values[extremes(values[:, 1], NARROW)].T
        low, high = np.maximum(coefficient - 2.0 * deviation, 0.0), coefficient + 2.0 * deviation
        friction.fill_between(time, low, high, color=PREDICTED, alpha=0.2, linewidth=0.0, label="two deviations")
        friction.plot(time, coefficient, color=PREDICTED, linewidth=1.2, label="learnt")
    else:
        note(friction, 0.5, 0.5, "not learnt")
    if true_friction is not None:
        friction.axhline(true_friction, color=TRUE, linestyle="--", linewidth=1.0, label="true")
    friction.set_ylim(0.0, 2.0 * (true_friction or 0.5))
    friction.set(title="Coefficient of friction", ylabel="coefficient", xlabel="time [s]")
    if friction.get_legend_handles_labels()[1]:
        legend(friction, columns=4)
    return finished(figure, 2)


def map_figure(stiffness: StiffnessMap, inclusion: Inclusion | None = None, *, spots: Sequence[Spot] = ()) -> Any:
    """The map of local stiffness as it was learnt, its standard deviation, and the truth where it is known.

    What was not touched is grey. The broken circle is the true inclusion; lines with numbers go around the spots that
    were found.
    """
    panels = [("learnt", stiffness.learnt, "stiffness"), ("standard deviation", stiffness.uncertainty, "uncertainty")]
    if stiffness.true is not None:
        panels.insert(0, ("true", stiffness.true, "stiffness"))
    figure = new_figure(0.9 + 7.6 / len(panels))
    seen = stiffness.learnt[stiffness.touched]
    scales = {
        "stiffness": _scale(seen if stiffness.true is None else np.append(seen, stiffness.true[stiffness.touched])),
        "uncertainty": _scale(stiffness.uncertainty[stiffness.touched]),
    }
    grid = figure.subplots(1, len(panels), sharey=True)
    x, y = stiffness.x, stiffness.y
    edges = 1e3 * np.array([x[0], x[-1], y[0], y[-1]]) + 0.5 * np.array([-1, 1, -1, 1])
    for axes, (title, values, kind) in zip(np.ravel(grid), panels, strict=True):
        shown = values if title == "true" else np.where(stiffness.touched, values, np.nan)
        low, high = scales[kind]
        image = axes.imshow(shown, origin="lower", extent=edges, vmin=low, vmax=high, cmap="cividis")
        axes.set_facecolor("0.85")
        _outlines(axes, stiffness, inclusion, spots)
        axes.set(title=f"{title} [N/m]", xlabel="x in the fixture's frame [mm]")
        figure.colorbar(image, ax=axes, fraction=0.046, pad=0.03)
    first = np.ravel(grid)[0]
    first.set_ylabel("y [mm]")
    if first.get_legend_handles_labels()[1]:
        first.legend(loc="lower left", fontsize="x-small", framealpha=0.9)
    figure.suptitle(f"Local stiffness {1e3 * stiffness.depth:g} mm deep; grey: not touched", y=0.97, fontsize="medium")
    figure.subplots_adjust(left=0.07, right=0.95, bottom=0.14, top=0.84, wspace=0.25)
    return figure


def _mark_touches(axes: Any, error: PoseError) -> None:
    shown = float(np.ptp(error.time))
    touches = joined(np.column_stack((error.touches, error.touches)), shown)
    for number, touch in enumerate(touches[:, 0].tolist()):
        axes.axvline(touch, color="0.75", linewidth=0.7, zorder=0.5, label="touch" if number == 0 else None)
    for number, (begin, end) in enumerate(joined(np.array(error.bumps).reshape(-1, 2), shown).tolist()):
        label = "bump" if number == 0 else None
        axes.axvspan(begin, max(end, begin + 0.1), color=ERROR, alpha=0.35, linewidth=0.0, label=label)


def _outlines(axes: Any, stiffness: StiffnessMap, inclusion: Inclusion | None, spots: Sequence[Spot]) -> None:
    if inclusion is not None:
        angle = np.linspace(0.0, 2.0 * np.pi, 100)
        x = 1e3 * (inclusion.middle[0] + inclusion.radius * np.cos(angle))
        y = 1e3 * (inclusion.middle[1] + inclusion.radius * np.sin(angle))
        axes.plot(x, y, color="white", linestyle="--", linewidth=1.2)
        axes.plot(x, y, color=TRUE, linestyle=(3, (3, 3)), linewidth=1.2, label="inclusion")
    for number, spot in enumerate(spots, 1):
        # Two lines, of which one is seen on the dark end of the map and the other on the light one.
        for colour, width in (("white", 3.2), (ERROR, 1.6)):
            places = spot.places.astype(float)
            axes.contour(1e3 * stiffness.x, 1e3 * stiffness.y, places, levels=[0.5], colors=colour, linewidths=width)
        label = f"found, {spot.ratio:.2g} times"
        style = {"textcoords": "offset points", "xytext": (0, 0), "ha": "center", "va": "center", "fontsize": "small"}
        box = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": ERROR, "alpha": 0.9}
        axes.annotate(str(number), 1e3 * np.array(spot.middle), **style, bbox=box)
        axes.plot([], [], color=ERROR, linewidth=1.6, label=f"{number}: {label}")
    axes.set_xlim(1e3 * stiffness.x[0], 1e3 * stiffness.x[-1])
    axes.set_ylim(1e3 * stiffness.y[0], 1e3 * stiffness.y[-1])


def _scale(values: Array) -> tuple[float, float]:
    """Least and largest that are shown: the outermost fiftieths go beyond."""
    if not values.size:
        return 0.0, 1.0
    low, high = np.percentile(values, [2.0, 98.0])
    return float(low), float(max(high, low + 1.0))


def _findings(report: Mapping[str, Any]) -> Iterator[Finding]:
    for bump in report["scene"]["pose"]["bumps"]:
        if bump["recovered_s"] is None:
            yield Finding(filled("After the bump at {at_s:.1f} s the fixture was never again where it is shown.", bump))
    for name, what in (("false", "rendered where the robot touched nothing"), ("missed", "felt by the robot alone")):
        wrong = report["scene"]["contacts"][name]
        if wrong["episodes"]:
            many = f"{wrong['episodes']} times" if wrong["episodes"] > 1 else "once"
            yield Finding(f"A contact was {what}, {many} for more than 20 ms, {wrong['longest_s']:.2f} s at most.")


def _lines(report: Mapping[str, Any]) -> Iterator[str]:
    scene = report["scene"]
    yield f"Scene {scene['name']}, the fixture's pose from {_FUSIONS.get(scene['fusion'], scene['fusion'])}"
    yield from _pose(scene["pose"])
    if scene["contacts"]["false"]["percent"] is not None:
        yield from (filled(line, scene["contacts"]) for line in _CONTACTS)
    yield _friction(scene["friction"])
    yield filled(_FORCES, scene["forces"])
    if line := shape_line(scene.get("shape")):
        yield line
    yield from _map(scene["map"])
    yield ""


_FUSIONS = {"full": "images and touches", "image": "images", "contact": "touches", "none": "nothing"}
_CONTACTS = (
    "  contacts   false in {false.percent:%} of the commands ({false.episodes} over 20 ms), "
    "missed in {missed.percent:%} of the commands ({missed.episodes} over 20 ms);",
    "             {before_model.percent:%} touched before there was any model; of the false, {behind.percent:%} of the "
    "commands while the robot was not there yet",
)
_FORCES = (
    "  in space   at most {total_hand_N:N} at the hand ({tangential_hand_N:N} of it along the surface), "
    "{total_robot_N:N} at the robot ({tangential_robot_N:N} of it along the surface)"
)


def _pose(pose: Mapping[str, Any]) -> Iterator[str]:
    since = "after the fourth touch" if pose["after_touches"] else "in all, for there were fewer than four touches"
    if pose["place_mm"]["median"] is not None:
        wrong = (
            "  pose       wrong by {place_mm.median:mm} and {turn_degrees.median:degrees} at the median, "
            "{place_mm.p95:mm} and {turn_degrees.p95:degrees} in 95 %"
        )
        yield f"{filled(wrong, pose)}, {since}"
    if pose["place_mm"]["deviation"] is not None:
        own = "{place_mm.deviation:mm} and {turn_degrees.deviation:degrees}"
        yield f"             its own standard deviation, at the median: {filled(own, pose)}"
    for bump in pose["bumps"]:
        again = "never again" if bump["recovered_s"] is None else "again {recovered_s:s} later"
        yield filled(f"  bump       at {{at_s:.1f}} s; within 0.5 mm and 0.5 degrees {again}", bump)
    if pose["images_used"] is not None:
        used = "{images_used:,} images and {contacts_used:,} touches used, {refused:,} refused"
        yield f"  seen       {filled(used, pose)}"


def _friction(friction: Mapping[str, Any]) -> str:
    if friction["coefficient"] is None:
        return "  friction   not learnt"
    true = "" if friction["true_coefficient"] is None else "; it is {true_coefficient:=}"
    text = f"  friction   coefficient {{coefficient:=}}, standard deviation {{deviation:=}}{true}"
    if friction["stiffness_N_per_m"] is not None:
        is_known = friction["true_stiffness_N_per_m"] is not None
        text += "; yields by {stiffness_N_per_m:=} N/m before it slides"
        text += ", and by {true_stiffness_N_per_m:=} N/m in truth" if is_known else ""
    if friction["excess_at_rest"] is not None:
        text += "; {excess_at_rest:=} more at rest"
        text += ", and {true_excess_at_rest:=} in truth" if friction["true_excess_at_rest"] is not None else ""
    return filled(text, friction)


def _map(stiffness: Mapping[str, Any] | None) -> Iterator[str]:
    if stiffness is None or stiffness["learnt_N_per_m"] is None:
        return
    low, middle, high = (figure(value) for value in stiffness["learnt_N_per_m"])
    area = filled("{depth_mm:mm} deep, over {touched_cm2:cm2} touched", stiffness)
    yield f"  stiffness  {low} to {high} N/m, {middle} at the median, {area}"
    if stiffness["median_error_percent"] is not None:
        wrong = "wrong by {median_error_percent:%} at the median, {p95_error_percent:%} in 95 %"
        within = "{within_two_deviations_percent:%} within two deviations"
        yield f"             {filled(f'{wrong}; {within}', stiffness)}"
    if stiffness["inclusion"] is not None:
        text = "centre found {centre_error_mm:mm} off, radius {radius_mm:mm} (it is {true_radius_mm:=})"
        yield f"  inclusion  {filled(text, stiffness['inclusion'])}"
    yield from _spots(stiffness["spots"])


def _spots(spots: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """A line for each, the surest first; their middles are in the fixture's frame."""
    if not spots:
        yield "  spots      none: nothing that was touched is surely stiffer or softer than what surrounds it"
    for number, spot in enumerate(spots, 1):
        x, y = spot["centre_mm"]
        found = "radius {radius_mm:mm}, {ratio:=} times what surrounds it, by {deviations:.1f} standard deviations"
        head = "spots" if number == 1 else ""
        yield f"  {head:<9}  {number}: {spot['kind']}, at ({x:.1f}, {y:.1f}) mm, {filled(found, spot)}"


def _drawings(view: View) -> Iterator[Drawing]:
    scene: SceneFindings = view.found
    if np.isfinite(scene.pose.distance).any():
        yield Drawing(pose_figure(scene.pose), "Error of the fixture's pose as the leader shows it, position and turn")
    if scene.wrong is not None and view.pairs.time.size:
        friction = None if scene.scene is None else scene.scene.friction.coefficient
        contacts = contact_figure(view.log, view.pairs, scene.wrong, friction, view.start_ns)
        yield Drawing(contacts, "False and missed contacts at equal command, and the friction that was learnt")
    if scene.map is not None and scene.map.touched.any() and scene.field is not None and scene.scene is not None:
        inclusion = scene.scene.inclusion if scene.map.true is not None else None
        drawn = map_figure(scene.map, inclusion, spots=scene.spots)
        yield Drawing(
            drawn, "Local stiffness over the surface: true, learnt, and its standard deviation, and the spots found"
        )


SCENE = Section("scene", _findings, _lines, _drawings, of=(SPACE,))
