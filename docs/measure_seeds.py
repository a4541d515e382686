"""Measure whole sessions in scenes by seeds that nothing was chosen on: blocks of `docs/scenes.md`.

Usage: `.venv/bin/python docs/measure_seeds.py [FOLDER]`, in an hour on two cores. What is done is kept in FOLDER, each
code's for itself: after an end it goes on from there.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from designs.rasters import told  # noqa: E402
from measure_scenes import PALPATED, run  # noqa: E402
from measured_blocks import fill, loaded  # noqa: E402
from measuring import figure, table  # noqa: E402

from foretouch.messages import SessionLog  # noqa: E402
from foretouch.report import look_at_scene, pair, session_figures  # noqa: E402
from foretouch.report.rows import force_at_follower  # noqa: E402
from foretouch.report.scene.map import StiffnessMap  # noqa: E402
from foretouch.report.scene.pose import vectors  # noqa: E402
from foretouch.session import SessionSettings  # noqa: E402
from foretouch.session.runners.simulated import simulate  # noqa: E402
from foretouch.session.spatial import Inclusion  # noqa: E402

Array = NDArray[np.float64]

PAGE = HERE / "scenes.md"
SEEDS = range(210, 218)
"""Nothing was chosen on these."""

DELAY = 380  # Of a command and what is felt of it, in rows of a millisecond

SCENES = (
    ("plane", "hunt-crossley", 40.0),
    ("hill", "hunt-crossley", 40.0),
    ("phantom", "hunt-crossley", PALPATED),
    ("hill", "foam-measured", 40.0),
    ("phantom", "foam-measured", PALPATED),
    ("line", "hunt-crossley", 40.0),
    ("line", "foam-measured", 40.0),
)
"""Scenes, materials and how long the hand goes over each [s]; on the phantom twice over everything."""

SPREAD = 4e-3
"""Half of a ring of the surface over which the edge of an inclusion is looked at, beside it [m]."""


class Found(NamedTuple):
    """What is measured of a session."""

    prediction: dict[str, float | None]
    map: dict[str, float | None]


def errors_where_told(log: SessionLog) -> tuple[float, float]:
    """Error of the prediction where the past could tell (`told`), and at the robot's place, in percent of the force.

    The second is of the same model at the place and speed of the robot, which comes later than the hand to where the
    surface is uncertain.
    """
    pairs = pair(log)
    rows = log.follower_space[np.searchsorted(log.follower_space["sequence"], pairs.follower["sequence"])]
    turned = Rotation.from_rotvec(vectors(rows, "exact", turn=True))
    points = turned.inv().apply(vectors(rows, "place") - vectors(rows, "exact"))
    true = pairs.follower["exact_force"]
    known = told(points, np.nan_to_num(rows["depth"], nan=-1.0), DELAY) & (true > 0.0)
    size = float(np.sqrt(np.mean(true[known] ** 2)))
    wanted, there = pairs.leader["predicted_force"], force_at_follower(log, pairs)
    return tuple(100.0 * float(np.sqrt(np.nanmean((one[known] - true[known]) ** 2))) / size for one in (wanted, there))


def edge(found: StiffnessMap, inclusion: Inclusion, stiffness: Array) -> tuple[float, float]:
    """Way in which stiffness goes from 10 to 90 % at the edge of a disc [m], and by how much it overshoots [-]."""
    x, y = np.meshgrid(found.x - inclusion.middle[0], found.y - inclusion.middle[1])
    away = np.hypot(x, y)
    rings = 1e-3 * np.arange(1, round(1e3 * (inclusion.radius + 2.0 * SPREAD)))
    within = [found.touched & (np.abs(away - ring) < 1e-3) for ring in rings]
    height = np.array([np.median(stiffness[ring]) for ring in within])
    inside, outside = height[rings < inclusion.radius - SPREAD], height[rings > inclusion.radius + SPREAD]
    share = (height - np.median(outside)) / (np.median(inside) - np.median(outside))
    falling = np.minimum.accumulate(share)
    ten, ninety = (float(np.interp(-level, -falling, rings)) for level in (0.1, 0.9))
    return ten - ninety, float(share.max() - 1.0)


def kept(folder: Path | None, scene: str, material: str, seconds: float, seed: int) -> Found:
    """What was measured of a session, if need be now."""
    if folder is None:
        return measured(scene, material, seconds, seed)
    file = folder / f"{scene}-{material}-{seed}.json"
    if not file.is_file():
        file.write_text(json.dumps(measured(scene, material, seconds, seed)._asdict()))
    return Found(**json.loads(file.read_text()))


def measured(scene: str, material: str, seconds: float, seed: int) -> Found:
    """One session: errors of prediction and contact [%], and what its map says."""
    if scene == "line":
        log = simulate(SessionSettings(material=material, seed=seed), duration=seconds).log
    else:
        log = run(seconds, scene=scene, material=material, seed=seed)
    figures = session_figures(log)
    prediction = {
        "told": None,
        "told there": None,
        "all": figures["prediction_error_percent"],
        "second": session_figures(log, score_from=0.5 * seconds)["prediction_error_percent"],
        "there": figures["equal_position"]["prediction_error_percent"],
        "delayed": figures["delayed_force_error_percent"],
        "false": None,
        "missed": None,
    }
    if scene != "line":
        prediction["told"], prediction["told there"] = errors_where_told(log)
        prediction |= {name: figures["scene"]["contacts"][name]["percent"] for name in ("false", "missed")}
    return Found(prediction, map_figures(log, figures["scene"]["map"], seconds) if scene == "phantom" else {})


def map_figures(log: SessionLog, found: dict[str, Any], seconds: float) -> dict[str, float | None]:
    """How well the inclusion is found, and what its map costs to send."""
    seen, inclusion = look_at_scene(log, pair(log)), found["inclusion"]
    if seen.map is None or seen.map.true is None or seen.scene is None or seen.scene.inclusion is None:
        raise SystemExit("no map was learnt")
    width, over = edge(seen.map, seen.scene.inclusion, seen.map.learnt)
    return {
        "Local stiffness, error at the median [%]": found["median_error_percent"],
        "in 95 % [%]": found["p95_error_percent"],
        "of it within two deviations [%]": found["within_two_deviations_percent"],
        "Centre of the inclusion, off by [mm]": inclusion["centre_error_mm"],
        "radius, off by [mm]": abs(inclusion["radius_mm"] - inclusion["true_radius_mm"]),
        "Edge, from 10 to 90 % [mm]": 1e3 * width,
        "the true one [mm]": 1e3 * edge(seen.map, seen.scene.inclusion, seen.map.true)[0],
        "overshoot [%]": 100.0 * over,
        "Field messages [bytes/s]": sum(len(update.content) for update in log.fields) / seconds,
    }


def middle_and_worst(values: list[float | None], best: float = 0.0) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return "–"
    return f"{figure(float(np.median(known)))} / {figure(max(known, key=lambda value: abs(value - best)))}"


def main() -> None:
    """Measure all, and fill both blocks."""
    folder = Path(sys.argv[1]) / str(loaded(PAGE, "seeds")) if len(sys.argv) > 1 else None
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    cases = [(*scene, seed) for seed in SEEDS for scene in SCENES]
    found = Parallel(n_jobs=2)(delayed(kept)(folder, *case) for case in cases)
    rows, maps = [], []
    for number, (scene, material, _) in enumerate(SCENES):
        some = found[number :: len(SCENES)]
        cells = [middle_and_worst([one.prediction[name] for one in some]) for name in some[0].prediction]
        rows.append([f"{scene}, {material}", *cells])
        maps += [{name: [one.map[name] for one in some] for name in some[0].map}] if some[0].map else []
    heads = ("Scene", "Where told [%]", "Told, at the robot's place [%]", "In all [%]", "Second half [%]")
    heads += ("At the robot's place [%]",)
    heads += ("Delayed force [%]", "False contact [%]", "Missed [%]")
    whole = table(heads, rows)
    bests = {"of it within two deviations [%]": 100.0}
    lines = [[name, *(middle_and_worst(one[name], bests.get(name, 0.0)) for one in maps)] for name in maps[0]]
    phantoms = table(("On the phantom", "hunt-crossley", "foam-measured"), lines)
    print(f"{whole}\n\n{phantoms}")
    fill(PAGE, {"seeds": whole, "maps": phantoms})


if __name__ == "__main__":
    main()
