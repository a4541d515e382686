"""Measure sessions in three dimensions: the tables and images of `docs/scenes.md`.

Usage: `.venv/bin/python docs/measure_scenes.py [fusion] [images] [palpation] [hand]`; all without arguments, in about
half an hour on 2 cores.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from joblib import Parallel, delayed
from measured_blocks import chosen, fill

from foretouch.messages import SessionLog
from foretouch.report import look_at_scene, map_figure, pair, pose_figure, session_figures
from foretouch.session import SessionSettings
from foretouch.session.runners.simulated import run_session
from foretouch.session.spatial import Scene, make_camera, make_scene, make_spatial_operator, make_spatial_robot

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


MEASURED = {"fusion": fusion, "images": images, "palpation": palpation, "hand": hand}
JOBS = 2


def main() -> None:
    for name in chosen(sys.argv[1:], MEASURED):
        text = MEASURED[name]()
        print(f"{name}\n\n{text}", flush=True)
        fill(PAGE, {name: text})


if __name__ == "__main__":
    main()
