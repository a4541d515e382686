"""Measure every figure of the documentation again and write it where it stands.

`docs/results.md`, `docs/contact-map.md`, `docs/stability.md`, `docs/replay.md` and `README.md` hold blocks between
`<!-- measured: NAME of DIGEST -->` and `<!-- end -->` (`docs/measured_blocks.py`). Each block names the command that
prints its figures; this script runs those commands, two at a time, and puts what they print into the blocks.

Usage: `.venv/bin/python docs/measure_results.py [NAME ...]`, without names for all blocks. On two cores that do nothing
else `reach` takes some two minutes, and so does `reach-simulated`, the table of `docs/beyond_files.py`.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple, get_args

import numpy as np
from beyond_files import beyond
from measured_blocks import chosen, fill
from measuring import Row, console, figure, foretouch, middle, table, two_at_a_time
from numpy.typing import NDArray

from foretouch.identification import Learner
from foretouch.quantities import Recording
from foretouch.recordings import excerpt, read_recording
from foretouch.report import score_prediction
from foretouch.reproduction import Verdict
from foretouch.session import mediate

ROOT = Path(__file__).resolve().parents[1]
PAGES = (
    ROOT / "README.md",
    *(ROOT / "docs" / f"{page}.md" for page in ("results", "contact-map", "stability", "replay")),
)


class File(NamedTuple):
    """A measured recording: what was touched, and whether anything was chosen with it in view."""

    kind: str
    seen: bool


@cache
def datasets() -> dict[str, File]:
    """Every measured recording by its name."""
    listed = json.loads(foretouch("datasets list --json"))
    return {name: File(entry["kind"], entry["seen"]) for name, entry in listed.items()}


def foams() -> list[str]:
    """Those measured foams that something was chosen on."""
    return [name for name, file in datasets().items() if file.kind == "foam" and file.seen]


@cache
def predicted(name: str, *, zero_given: bool = False) -> dict[str, Any]:
    """What `foretouch predict` says of a measured recording, where asked with the zero that scoring takes."""
    options = CONDITIONS.get(name.split("/")[0], "--delay 0.3")
    given = f" --force-offset {zero(name):.4f}" if zero_given else ""
    found: dict[str, Any] = json.loads(foretouch(f"predict --dataset {name} {options}{given} --json"))
    return found


def reach() -> str:
    """`foretouch predict` on every measured file, beside what others make of it, and whether a hand would feel it."""
    rows = []
    for name, file in datasets().items():
        known = None if file.kind == "free" else measured_comparison(name.split("/")[0])
        others = [None] * len(RIVALS) if known is None else rivals(name, known)[1:]
        first = f"`{name}`", "yes" if file.seen else "no", file.kind
        rows.append([*first, *measured_row(predicted(name)), *map(figure, others)])
        if file.kind == "spring":
            given = measured_row(predicted(name, zero_given=True))
            rows.append([f"`{name}`, zero given", *first[1:], *given, *["–"] * len(RIVALS)])
    return table(REACH_HEADS, rows)


def measured_row(found: dict[str, Any]) -> Row:
    """What `foretouch predict` gives."""
    error = found["prediction_error_percent"]
    phantom = found["phantom_force_rms_N"], found["largest_phantom_force_N"]
    within = found["within_one_deviation_percent"], found["within_two_deviations_percent"]
    return [
        figure(error),
        figure(found["error_up_to_constant_percent"]),
        felt(error),
        figure(found["within_jnd_percent"]),
        *(" / ".join(map(figure, pair)) if pair[0] is not None else "–" for pair in (within, phantom)),
        figure(found["contact_force_rms_N"]),
        figure(found["delayed_force_error_percent"]),
    ]


def reach_by_kind() -> str:
    """Median and worst of the same, of the files that something was chosen on and of the others."""
    rows = []
    for kind, what in KINDS.items():
        of_kind = {name: file for name, file in datasets().items() if file.kind == kind}
        for seen in (True, False):
            names = [name for name, file in of_kind.items() if file.seen is seen]
            if names:
                found = [predicted(name, zero_given=kind == "spring") for name in names]
                pairs = ([one[key] for one in found] for key in ("prediction_error_percent", "within_jnd_percent"))
                errors, within = pairs
                row = [what, "yes" if seen else "no", str(len(names)), middle(errors), max(errors)]
                rows.append([*row[:3], *map(figure, (*row[3:], middle(within), min(within)))])
    heads = ("Touched", "Chosen on", "Files", "Error, median [%]", "Worst [%]", "Within JND, median [%]", "Worst [%]")
    return table(heads, rows)


KINDS = {"foam": "foam", "rigid": "rigid", "spring": "spring, zero given", "skin": "skin, 20 ms"}


FELT = {"no": 7.0, "perhaps": 10.0, "yes": math.inf}
"""Whether a hand tells an error from none, up to which error [%]: the studies are named on the page."""

CONDITIONS = {"aurora": "--delay 0.02 --score-from 0.5 --score-to 1.6"}
"""How the files of one origin are predicted, if not under 0.3 s: a press of the skin lasts 0.25 s."""

RIVALS = (
    ("continuous-switching", "fprls"),
    ("continuous-switching", "rls"),
    ("continuous-switching", "offline"),
    ("contact-map", "offline"),
)
"""What the contact map is shown beside; of fits of the whole file the floor."""

CHOSEN = "--models contact-map --models continuous-switching --estimators bank " + " ".join(
    f"--estimators {name}" for name in dict.fromkeys(name for _, name in RIVALS)
)
"""What `foretouch compare` is asked for these."""

FORCE = "Force RMS [N]"

REACH_HEADS = (
    "File",
    "Chosen on",
    "Touched",
    "Error [%]",
    "Up to a constant [%]",
    "Felt",
    "Within JND [%]",
    "Within σ / 2σ [%]",
    "In the air, RMS / largest [N]",
    FORCE,
    "Delayed [%]",
    *(f"`{name}` [%]" for _, name in RIVALS[:2]),
    "Floor, law [%]",
    "Floor, map [%]",
)

Results = dict[str, dict[tuple[str, str], dict[str, Any]]]


def rivals(recording: str, results: Results, prefix: str = "") -> list[float | None]:
    """Errors of the delayed force and of `RIVALS` on a recording."""
    found = results[recording]
    first = found["contact-map", "bank"]["predictions"]
    errors = [first[0][f"{prefix}delayed_force_error_percent"] if first else None]
    for pair in RIVALS:
        kind = "whole_file_error_percent" if pair[1] == "offline" else "prediction_error_percent"
        predictions = found[pair]["predictions"]
        errors.append(predictions[0][f"{prefix}{kind}"] if predictions else None)
    return errors


def felt(error: float | None) -> str:
    """Whether a hand would tell so large an error [%] from none; what failed has no error."""
    return "–" if error is None else next(word for word, most in FELT.items() if error <= most)


def zero(name: str) -> float:
    """The zero that scoring takes, which no causal learner can know of what never leaves contact [N]."""
    from foretouch.report import lowest_mean

    recording = read_recording(excerpt(name))
    return lowest_mean(recording.time, recording.force)


@cache
def measured_comparison(origin: str) -> Results:
    """`foretouch compare` of `CHOSEN` on all files of one origin."""
    names = [name for name, file in datasets().items() if name.startswith(origin) and file.kind != "free"]
    chosen_files = " ".join(f"--dataset {name}" for name in names)
    return comparison(f"compare {chosen_files} {CONDITIONS.get(origin, '--delay 0.3')} {CHOSEN} --json")


def comparison(arguments: str) -> Results:
    """What `foretouch compare` prints, by recording, law and estimator."""
    found: Results = {}
    for result in json.loads(foretouch(arguments))["results"]:
        found.setdefault(result["recording"], {})[result["model"], result["estimator"]] = result
    return found


def floors() -> str:
    """What a fit of the paper's law to the whole file leaves of each measured foam."""
    names = foams()
    command = "identify --dataset {} --model continuous-switching --estimator offline --json"
    found = (json.loads(foretouch(command.format(name))) for name in names)
    rows = [[f"`{name}`", figure(one["residual_percent"])] for name, one in zip(names, found, strict=True)]
    return table(("Foam", "Left by the best fit of the whole file [% of the force RMS]"), rows)


def claims() -> str:
    """`foretouch reproduce`: how many claims of the paper hold, and which do not."""
    found = json.loads(foretouch("reproduce --json"))
    counts = Counter(row["verdict"] for row in found)
    counted = table(("Verdict", "Claims"), [[verdict, str(counts[verdict])] for verdict in get_args(Verdict)])
    failed = [f"- {row['claim']}\n" for row in found if row["verdict"] == "does not hold"]
    return f"{counted}\nThose that do not hold:\n\n{''.join(failed)}"


def sessions() -> str:
    """`foretouch simulate` for every material and operator, beside the paper's estimator."""
    materials = json.loads(foretouch("materials list --json"))
    cases = [(material, operator) for material in materials for operator in ("scripted", "recorded")]
    commands = [
        f"simulate --duration 20 --material {material} --operator {operator} --jitter 0 {model} --json"
        for material, operator in cases
        for model in ("", "--model continuous-switching")
    ]
    reports = map(json.loads, two_at_a_time(commands))
    rows = []
    for (material, operator), found, paper in zip(cases, reports, reports, strict=True):
        rows.append(
            [
                f"`{material}`",
                operator,
                figure(found["delayed_force_error_percent"]),
                figure(paper["prediction_error_percent"]),
                figure(found["prediction_error_percent"]),
                figure(found["within_jnd_percent"]),
                figure(found["time_to_ten_percent_s"]),
            ]
        )
    heads = (
        "Material",
        "Operator",
        "Delayed error [%]",
        "Paper's error [%]",
        "Prediction error [%]",
        "Within JND [%]",
        "Within 10 % after [s]",
    )
    return table(heads, rows)


def foam() -> str:
    """`foretouch materials fit` of the measured foam."""
    return console("materials fit foam-measured")


def session() -> str:
    """One session as it is printed."""
    return console("simulate")


def mediation() -> str:
    """Error of the predicted and of the mediated force on measured foam, and the largest step of a tick."""
    rows = []
    for name in foams():
        recording = read_recording(excerpt(name))
        learner = Learner(contact_floor=recording.contact_floor)
        found = mediate(recording, learner, delay=0.3)

        def error(force: NDArray[np.float64], recording: Recording = recording) -> float | None:
            floor = recording.contact_floor
            scores = score_prediction(
                recording.time, recording.force, force, force, contact_floor=floor, score_from=1.5
            )
            return scores.prediction_error_percent

        step = np.abs(found.step).max()
        rows.append([f"`{name}`", *map(figure, (error(found.predicted), error(found.mediated), step))])
    heads = ("Recording", "Predicted [%]", "Mediated [%]")
    said = "`docs/measure_results.py mediation`, 50 models a second, 0.3 s late; the largest step is that of one tick:"
    return f"{said}\n\n" + table((*heads, "Largest step [N]"), rows)


def first_touch() -> str:
    """Peak forces, depth lost and time lost by the guarded first touch, over the round trip, beside following."""
    cases = [(material, trip) for material in ("foam-measured", "bone") for trip in (0.0, 0.5, 2.0)]
    commands = [
        f"simulate --grip normal --material {material} --duration 10 --position-delay {0.5 * round_trip} "
        f"--force-delay {0.5 * round_trip} --first-touch {way} --json"
        for material, round_trip in cases
        for way in ("guarded", "follow")
    ]
    hands = (json.loads(said)["hand"] for said in two_at_a_time(commands))
    rows = []
    for (material, round_trip), guarded, follow in zip(cases, hands, hands, strict=True):
        costs = [guarded[key] for key in ("peak_force_robot_N", "depth_lost_mm", "time_lost_s")]
        rows.append([material, figure(round_trip), *map(figure, (*costs, follow["peak_force_robot_N"]))])
    heads = (
        "Material",
        "Round trip [s]",
        "Robot, guarded [N]",
        "Depth lost [mm]",
        "Time lost [s]",
        "Robot, follow [N]",
    )
    said = "`foretouch simulate --grip normal --duration 10`, peak forces of the whole session:"
    return f"{said}\n\n" + table(heads, rows)


def device_delay() -> str:
    """What the device's delay of half a tick costs a hand: the same sessions with none."""
    cases = [(material, grip) for material in ("foam-measured", "bone", "kelvin-voigt") for grip in ("soft", "normal")]
    commands = [
        f"simulate --grip {grip} --material {material} --duration 12 {delay} --json"
        for material, grip in cases
        for delay in ("", "--device-delay 0")
    ]
    reports = map(json.loads, two_at_a_time(commands))
    rows = []
    for (material, grip), late, prompt in zip(cases, reports, reports, strict=True):
        both = [(one["rendered_error_percent"], one["hand"]) for one in (late, prompt)]
        pairs = zip(*[(error, 100 * hand["smallest_rendered_share"]) for error, hand in both], strict=True)
        rows.append([material, grip, *(" / ".join(map(figure, pair)) for pair in pairs)])
    said = "`foretouch simulate --grip GRIP --material MATERIAL --duration 12`, with 0.5 ms / with `--device-delay 0`:"
    return f"{said}\n\n" + table(("Material", "Grip", "Rendered error [%]", "Least ratio [%]"), rows)


def guarded_peaks() -> str:
    """How hard a guarded first touch presses at its peak, at the approach speed and at a quarter of it."""
    cases = [(material, speed) for material in ("bone", "kelvin-voigt") for speed in (0.02, 0.005)]
    commands = [
        f"simulate --grip normal --material {material} --duration 7 --approach-speed {speed} --json"
        for material, speed in cases
    ]
    hands = (json.loads(said)["hand"] for said in two_at_a_time(commands))
    rows = [
        [material, figure(1e3 * speed), figure(hand["peak_force_guarded_N"])]
        for (material, speed), hand in zip(cases, hands, strict=True)
    ]
    said = "`foretouch simulate --grip normal --material MATERIAL --duration 7 --approach-speed SPEED`:"
    return f"{said}\n\n" + table(("Material", "Approach speed [mm/s]", "Peak while guarded [N]"), rows)


def replays() -> str:
    """One session of a hand under several force delays: its motion fixed, and answering."""
    names = (
        "prediction_error_percent",
        "rendered_error_percent",
        "delayed_force_error_percent",
    )
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        foretouch("simulate --duration 20 --grip normal --recording hand.mcap", folder)
        for delay in (0.05, 0.3, 0.6, 1.0, 2.0):
            row = [figure(delay)]
            for loop in ("", "--closed-loop"):
                found = json.loads(foretouch(f"replay hand.mcap --force-delay {delay} {loop} --json", folder))
                row += [figure(found["replayed"][name]) for name in names]
            rows.append(row)
    heads = ["Force delay [s]"]
    for loop in ("open", "closed"):
        heads += [f"{loop}: predicted [%]", "felt [%]", "delayed [%]"]
    return table(tuple(heads), rows)


MEASURE: dict[str, Callable[[], str]] = {
    "reach": reach,
    "reach-by-kind": reach_by_kind,
    "reach-simulated": beyond,
    "floors": floors,
    "claims": claims,
    "sessions": sessions,
    "foam": foam,
    "session": session,
    "mediation": mediation,
    "first-touch": first_touch,
    "device-delay": device_delay,
    "guarded-peaks": guarded_peaks,
    "replays": replays,
}


def main(names: list[str]) -> None:
    """Measure these blocks, or all, and write them into the pages."""
    measured: dict[str, str] = {}
    for name in chosen(names, MEASURE):
        begin = monotonic()
        measured[name] = MEASURE[name]()
        print(f"measured {name} in {monotonic() - begin:.0f} s", flush=True)
    for page in PAGES:
        fill(page, measured)


if __name__ == "__main__":
    main(sys.argv[1:])
