"""A scene as plain text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from foretouch.report.numbers import figure, number


def scene_sentences(report: Mapping[str, Any]) -> list[str]:
    """What is wrong in a scene, one sentence each; none of a session along a line."""
    if "scene" not in report:
        return []
    scene, said = report["scene"], []
    for bump in scene["pose"]["bumps"]:
        if bump["recovered_s"] is None:
            said.append(f"After the bump at {bump['at_s']:.1f} s the fixture was never again where it is shown.")
    for name, what in (("false", "rendered where the robot touched nothing"), ("missed", "felt by the robot alone")):
        wrong = scene["contacts"][name]
        if wrong["episodes"]:
            many = f"{wrong['episodes']} times" if wrong["episodes"] > 1 else "once"
            said.append(f"A contact was {what}, {many} for more than 20 ms, {wrong['longest_s']:.2f} s at most.")
    return said


def scene_lines(report: Mapping[str, Any]) -> list[str]:
    """The block of the report that says what became of a scene; none of a session along a line.

    Args:
        report: What `session_report` gave.
    """
    if "scene" not in report:
        return []
    scene = report["scene"]
    return [
        f"Scene {scene['name']}, the fixture's pose from {_FUSIONS.get(scene['fusion'], scene['fusion'])}",
        *_pose(scene["pose"]),
        *_contacts(scene["contacts"]),
        *_friction(scene["friction"]),
        _forces(scene["forces"]),
        *_map(scene["map"]),
        "",
    ]


_FUSIONS = {"full": "images and touches", "image": "images", "contact": "touches", "none": "nothing"}


def _pose(pose: Mapping[str, Any]) -> list[str]:
    place, turn = pose["place_mm"], pose["turn_degrees"]
    since = "after the fourth touch" if pose["after_touches"] else "in all, for there were fewer than four touches"
    lines = []
    if place["median"] is not None:
        middle = f"{number(place['median'], 'mm')} and {number(turn['median'], 'degrees')} at the median"
        most = f"{number(place['p95'], 'mm')} and {number(turn['p95'], 'degrees')} in 95 %"
        lines.append(f"  pose       wrong by {middle}, {most}, {since}")
    if place["deviation"] is not None:
        told = f"{number(place['deviation'], 'mm')} and {number(turn['deviation'], 'degrees')}"
        lines.append(f"             its own standard deviation, at the median: {told}")
    for bump in pose["bumps"]:
        again = "never again" if bump["recovered_s"] is None else f"again {number(bump['recovered_s'], 's')} later"
        lines.append(f"  bump       at {bump['at_s']:.1f} s; within 0.5 mm and 0.5 degrees {again}")
    if pose["images_used"] is not None:
        used = f"{pose['images_used']:,} images and {pose['contacts_used']:,} touches used, {pose['refused']:,} refused"
        lines.append(f"  seen       {used}")
    return lines


def _contacts(contacts: Mapping[str, Any]) -> list[str]:
    if contacts["false"]["percent"] is None:
        return []
    said = [
        f"{name} in {number(contacts[key]['percent'], '%')} of the commands ({contacts[key]['episodes']} over 20 ms)"
        for key, name in (("false", "false"), ("missed", "missed"))
    ]
    before = number(contacts["before_model"]["percent"], "%")
    return [f"  contacts   {', '.join(said)};", f"             {before} touched before there was any model"]


def _friction(friction: Mapping[str, Any]) -> list[str]:
    if friction["coefficient"] is None:
        return ["  friction   not learnt"]
    true = "" if friction["true_coefficient"] is None else f"; it is {figure(friction['true_coefficient'])}"
    doubt = figure(friction["deviation"])
    return [f"  friction   coefficient {figure(friction['coefficient'])}, standard deviation {doubt}{true}"]


def _forces(forces: Mapping[str, Any]) -> str:
    sides = (
        f"{number(forces[f'total_{side}_N'], 'N')} at the {side} ({number(forces[f'tangential_{side}_N'], 'N')} of it "
        "along the surface)"
        for side in ("hand", "robot")
    )
    return f"  in space   at most {', '.join(sides)}"


def _map(found: Mapping[str, Any] | None) -> list[str]:
    if found is None or found["learnt_N_per_m"] is None:
        return []
    low, middle, high = (figure(value) for value in found["learnt_N_per_m"])
    area, depth = figure(found["touched_cm2"]), figure(found["depth_mm"])
    lines = [f"  stiffness  {low} to {high} N/m, {middle} at the median, {depth} mm deep, over {area} cm2 touched"]
    if found["median_error_percent"] is not None:
        median, most = number(found["median_error_percent"], "%"), number(found["p95_error_percent"], "%")
        within = number(found["within_two_deviations_percent"], "%")
        lines.append(f"             wrong by {median} at the median, {most} in 95 %; {within} within two deviations")
    inclusion = found["inclusion"]
    if inclusion is not None:
        off, radius = number(inclusion["centre_error_mm"], "mm"), number(inclusion["radius_mm"], "mm")
        true = figure(inclusion["true_radius_mm"])
        lines.append(f"  inclusion  centre found {off} off, radius {radius} (it is {true})")
    return lines
