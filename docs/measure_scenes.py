"""Measure sessions in three dimensions: the tables and images of `docs/scenes.md`.

Usage: `.venv/bin/python docs/measure_scenes.py [fusion] [images] [blind] [palpation] [hand]`; all without arguments, in
about half an hour on 2 cores.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import matplotlib as mpl
import numpy as np
from joblib import Parallel, delayed
from measured_blocks import chosen, fill
from scipy.spatial.transform import Rotation

from foretouch.messages import SessionLog
from foretouch.report import look_at_scene, map_figure, pair, pose_figure, session_figures
from foretouch.report.scene.pose import vectors
from foretouch.session import SessionSettings
from foretouch.session.runners.simulated import run_session
from foretouch.session.spatial import Scene, make_camera, make_scene, make_spatial_operator, make_spatial_robot, tracker

mpl.use("Agg")

PAGE = Path(__file__).parent / "scenes.md"
IMAGES = Path(__file__).parent / "images"

SEEDS = range(8)
BUMP, LENGTH = 13.0, 20.0
"""Behind the four presses at the corners; while the hand slides along the first rows [s]."""

FAULT, UNSEEN = (8.0, 11.0), 9.0
"""From here to there images fail, and when the fixture is bumped meanwhile [s]."""

PALPATED = 72.0
"""Twice over the whole specimen [s]."""

SECOND = 36.0
"""From here on the hand is where it has been before [s]."""


def run(duration: float, **changes: Any) -> SessionLog:
    """One session in simulated time, in the scene of its settings."""
    return simulated(make_scene(SessionSettings(**changes).scene), duration, **changes)


def simulated(scene: Scene, duration: float, /, **changes: Any) -> SessionLog:
    """One session in simulated time, in a scene that may be another than that of its settings."""
    settings = SessionSettings(**changes)
    camera = make_camera(settings, scene, say=print) if settings.fusion in ("full", "image") else None
    if camera is None and settings.fusion in ("full", "image"):
        raise SystemExit("without a camera there is nothing to measure")
    session = run_session(
        settings,
        make_spatial_operator(settings, scene, scene.nominal),
        make_spatial_robot(settings, scene),
        camera,
        duration=duration,
    )
    if camera is not None:
        camera.close()
    return dataclasses.replace(session.log, images=())  # what was seen is in the poses


def median(values: Iterable[float | None]) -> float:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else float("nan")


def most(values: Iterable[float | None]) -> float:
    return max((value for value in values if value is not None), default=float("nan"))


def shown(value: float | None) -> str:
    """A percentage; a dash where there is nothing to measure it on."""
    return "-" if value is None else f"{value:.0f}"


def both(poses: Sequence[dict[str, Any]], name: str) -> str:
    """An error of poses: the median, and the worst of what 95 % of the ticks stay below."""
    return f"{median(pose[name]['median'] for pose in poses):.2f} / {most(pose[name]['p95'] for pose in poses):.2f}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown; what is not the first column is a number."""
    lines = [head, ["---", *["--:"] * (len(head) - 1)], *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


# --- what the pose is made of -----------------------------------------------------------------------------------------


def fused(fusion: str, seed: int) -> dict[str, Any]:
    return session_figures(run(LENGTH, scene="hill", fusion=fusion, seed=seed, bump=BUMP))


def fusion() -> str:
    """Eight fixtures, each displaced and bumped otherwise, by four ways to know where they are."""
    ways = ("full", "image", "contact", "none")
    found = Parallel(n_jobs=JOBS)(delayed(fused)(way, seed) for way in ways for seed in SEEDS)
    rows = []
    for number, way in enumerate(ways):
        reports = found[number * len(SEEDS) : (number + 1) * len(SEEDS)]
        scenes = [report["scene"] for report in reports]
        poses = [scene["pose"] for scene in scenes]
        back = [bump["recovered_s"] for pose in poses for bump in pose["bumps"]]
        rows.append(
            (
                f"`{way}`",
                *(both(poses, name) for name in ("place_mm", "turn_degrees")),
                "never" if None in back else f"{most(back):.2f}",
                *(
                    f"{median(scene['contacts'][name]['percent'] for scene in scenes):.2f} "
                    f"({sum(scene['contacts'][name]['episodes'] for scene in scenes)})"
                    for name in ("false", "missed")
                ),
                f"{median(report['prediction_error_percent'] for report in reports):.0f}",
                f"{median(report['delayed_force_error_percent'] for report in reports):.0f}",
            )
        )
    head = (
        "`--fusion`",
        "Pose [mm], median / worst 95 %",
        "[degrees]",
        "Right again after the bump, at worst [s]",
        "False contact [%] (over 20 ms)",
        "Missed [%] (over 20 ms)",
        "Prediction error [%]",
        "Delayed force [%]",
    )
    return table(head, rows)


# --- images that fail -------------------------------------------------------------------------------------------------


IMAGE_FAULTS = ("hand", "glare", "frozen", "dropped")
"""The images that are hidden, blinded, stuck or gone."""


def spoilt(fault: str, bump: float) -> dict[str, Any]:
    settings = {"scene": "hill", "seed": 2, "bump": bump}
    if fault != "none":
        settings["image_fault"] = f"{fault}:{FAULT[0]:g}:{FAULT[1]:g}"
    log = run(16.0, **settings)
    pose = look_at_scene(log, pair(log)).pose
    inside = (pose.time >= FAULT[0]) & (pose.time < FAULT[1])
    after = pose.time >= FAULT[1] + 0.5
    return {
        "during": (pose.distance[inside].max(), pose.turn[inside].max()),
        "after": (pose.distance[after].max(), pose.turn[after].max()),
        "report": session_figures(log)["scene"],
    }


def images() -> str:
    """The same session with good images and with four faults of them, with and without a bump meanwhile."""
    cases = [(fault, bump) for bump in (0.0, UNSEEN) for fault in ("none", *IMAGE_FAULTS)]
    found = dict(zip(cases, Parallel(n_jobs=JOBS)(delayed(spoilt)(*case) for case in cases), strict=True))
    rows = []
    for bump in (0.0, UNSEEN):
        for name, faults in (("none fails", ("none",)), ("worst of the four faults", IMAGE_FAULTS)):
            of_them = [found[fault, bump] for fault in faults]
            errors = [np.max([one[when] for one in of_them], axis=0) for when in ("during", "after")]
            back = [bumped["recovered_s"] for one in of_them for bumped in one["report"]["pose"]["bumps"]]
            rows.append(
                (
                    name + (", bumped meanwhile" if bump else ""),
                    *(f"{place:.2f} / {turn:.2f}" for place, turn in errors),
                    "-" if not back else "never" if None in back else f"{most(back):.2f}",
                )
            )
    head = (
        "Images",
        "Largest error meanwhile [mm / degrees]",
        "From 0.5 s after [mm / degrees]",
        "After the bump, right again in [s]",
    )
    return table(head, rows)


# --- a bump that only the probe can tell of ---------------------------------------------------------------------------

BLIND = {"displacement": 0.0125, "turn": 0.131, "image_fault": "dropped:12.5:40"}
"""Images end half a second before a bump of up to 5 mm and 3 degrees, which is 40 % of the first displacement."""

AFTER = ((0.15, 1.0), (1.0, 3.0), (3.0, 6.0), (6.0, 12.0), (12.0, 17.0))
"""Time after the beginning of the bump [s]."""


def felt(seed: int, period: float) -> tuple[list[float], float | None]:
    """How the believed surface is turned against the true one where it is felt, and when the pose was right again.

    A slide is taken once in so many seconds.

    Returns:
        For each time of `AFTER` the root mean square of the angle between the normals [degrees]; and seconds.
    """
    with mock.patch.object(tracker, "SLIDE_PERIOD", period):
        log = run(BUMP + AFTER[-1][1], scene="hill", seed=seed, bump=BUMP, **BLIND)
    surface, pairs = make_scene("hill").surface, pair(log)
    (bump,) = session_figures(log)["scene"]["pose"]["bumps"]
    keep = log.follower["in_contact"] & (log.follower["time_ns"] % 10_000_000 == 0)
    rows, time = log.follower_space[keep], 1e-9 * (log.follower["time_ns"][keep] - pairs.follower["time_ns"][0])
    normals = []
    for pose in ("fixture", "exact"):
        turned = Rotation.from_rotvec(vectors(rows, pose, turn=True))
        inner = turned.inv().apply(vectors(rows, "place") - vectors(rows, pose))
        normals.append(turned.apply([surface.contact(tuple(place)).normal for place in inner.tolist()]))
    angle = np.degrees(np.arccos(np.minimum(np.sum(normals[0] * normals[1], axis=1), 1.0)))
    after = time - bump["at_s"]
    parts = [angle[(after >= begin) & (after < end)] for begin, end in AFTER]
    return [float(np.sqrt(np.mean(part**2))) if part.size else float("nan") for part in parts], bump["recovered_s"]


def blind() -> str:
    """Eight bumps that no image shows: what a probe that slides tells of them, and what touches tell alone."""
    columns = [[*(f"{begin:g} to {end:g} s" for begin, end in AFTER), "the whole pose is right again"]]
    for period in (tracker.SLIDE_PERIOD, math.inf):
        found = Parallel(n_jobs=JOBS)(delayed(felt)(seed, period) for seed in SEEDS)
        back = [seconds for _, seconds in found if seconds is not None]
        angles = np.array([angle for angle, _ in found])
        column = [f"{np.nanmedian(part):.2f} / {np.nanmax(part):.2f}" for part in angles.T]
        columns.append([*column, f"{len(back)} of {len(found)}" + (f", after {median(back):.1f} s" if back else "")])
    heads = ("After the bump", "Normal, off by [degrees]", "by touches alone")
    return table(heads, list(zip(*columns, strict=True)))


# --- palpation --------------------------------------------------------------------------------------------------------


def palpation() -> str:
    """Twice over a phantom with an inclusion; draws the map and the pose."""
    log = run(PALPATED, scene="phantom", seed=3, bump=BUMP)
    pairs = pair(log)
    found = look_at_scene(log, pairs)
    whole = session_figures(log)
    again = session_figures(log, score_from=SECOND)
    figures = whole["scene"]["map"]
    inclusion = figures["inclusion"]
    if found.map is None or found.scene is None:
        raise SystemExit("no map was learnt")
    map_figure(found.map, found.scene.inclusion, spots=found.spots).savefig(IMAGES / "scene-map.png", dpi=110)
    pose_figure(found.pose).savefig(IMAGES / "scene-pose.png", dpi=110)
    friction, sent = whole["scene"]["friction"], sum(len(update.content) for update in log.fields)
    rows = [
        ("touched", f"{figures['touched_cm2']:.1f} cm2"),
        (
            "local stiffness, error at the median / in 95 %",
            f"{figures['median_error_percent']:.1f} / {figures['p95_error_percent']:.1f} %",
        ),
        ("of it within two deviations", f"{figures['within_two_deviations_percent']:.0f} %"),
        ("centre of the inclusion, off by", f"{inclusion['centre_error_mm']:.1f} mm"),
        ("its radius, which is 12 mm", f"{inclusion['radius_mm']:.1f} mm"),
        ("coefficient of friction, which is 0.3", f"{friction['coefficient']:.3f} ± {friction['deviation']:.3f}"),
        ("nodes of the field / sent [bytes/s]", f"{figures['nodes']} / {sent / PALPATED:,.0f}"),
        (
            "prediction error, delayed force: in all",
            f"{whole['prediction_error_percent']:.0f} %, {whole['delayed_force_error_percent']:.0f} %",
        ),
        (
            "where the hand has been before",
            f"{again['prediction_error_percent']:.0f} %, {again['delayed_force_error_percent']:.0f} %",
        ),
    ]
    return table(("What", "Measured"), rows)


# --- a hand in the loop -----------------------------------------------------------------------------------------------


def held(scene: str, grip: str, force_delay: float) -> dict[str, Any]:
    return session_figures(run(LENGTH, scene=scene, grip=grip, force_delay=force_delay, seed=1, bump=BUMP))


def hand() -> str:
    """Hands that the force moves: is the account of energy kept, and does anything oscillate."""
    cases = [
        (scene, grip, delay)
        for scene, grip in (("plane", "soft"), ("hill", "normal"), ("phantom", "stiff"))
        for delay in (0.3, 1.0)
    ]
    found = Parallel(n_jobs=JOBS)(delayed(held)(*case) for case in cases)
    rows = []
    for (scene, grip, delay), report in zip(cases, found, strict=True):
        energy, swings = report["scene"]["energy"], report["hand"]["oscillation"]
        rows.append(
            (
                f"{scene}, {grip}, {delay:g} s",
                f"{1e6 * energy['net_energy_J']:.1f}",
                f"{-1e6 * energy['energy_bound_J']:.1f}",
                "yes" if energy["certificate_holds"] else "NO",
                "YES" if swings["oscillates"] else "no",
                f"{report['scene']['forces']['total_hand_N']:.1f} / {report['scene']['forces']['total_robot_N']:.1f}",
                shown(report["prediction_error_percent"]),
            )
        )
    head = (
        "Scene, grip, force delay",
        "Energy, least [uJ]",
        "Allowed [uJ]",
        "Kept in every tick",
        "Oscillates",
        "Largest force, hand / robot [N]",
        "Prediction error [%]",
    )
    return table(head, rows)


MEASURED = {"fusion": fusion, "images": images, "blind": blind, "palpation": palpation, "hand": hand}
JOBS = 2


def main() -> None:
    for name in chosen(sys.argv[1:], MEASURED):
        text = MEASURED[name]()
        print(f"{name}\n\n{text}", flush=True)
        fill(PAGE, {name: text})


if __name__ == "__main__":
    main()
