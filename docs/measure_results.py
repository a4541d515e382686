"""Measure every figure of the documentation again and write it where it stands.

`docs/results.md` and `README.md` hold blocks between `<!-- measured: NAME -->` and `<!-- end -->`. Each block names the
command that prints its figures; this script runs those commands and puts what they print into the blocks.
Usage: `.venv/bin/python docs/measure_results.py [NAME ...]`, without names for all blocks. It needs the measured
recordings (a network, or FORETOUCH_DATA_DIR) and takes about ten minutes on two cores.
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGES = (ROOT / "README.md", ROOT / "docs" / "results.md")
BLOCK = re.compile(r"(<!-- measured: (?P<name>[a-z-]+) -->\n).*?(<!-- end -->)", re.DOTALL)
WINDOWS = {"aurora": "--score-from 0.5 --score-to 1.6"}
"""What the measured files of one origin need: outside this window the motor's control chatters off contact."""

SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")

Row = list[str]


def foretouch(arguments: str) -> str:
    """What a command prints."""
    command = [sys.executable, "-m", "foretouch", *shlex.split(arguments)]
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
    if done.returncode:
        raise SystemExit(f"foretouch {arguments}: {done.stderr.strip()}")
    return done.stdout.strip()


def datasets() -> dict[str, str]:
    """Name and kind of every measured file."""
    return {name: entry["kind"] for name, entry in json.loads(foretouch("datasets list --json")).items()}


def predictions() -> str:
    """`foretouch predict` on every measured file."""
    rows = []
    for name, kind in datasets().items():
        path, window = foretouch(f"datasets fetch {name}"), WINDOWS.get(name.split("/")[0], "")
        found = json.loads(foretouch(f"predict {shlex.quote(path)} --delay 0.3 {window} --json"))
        rows.append(
            [
                f"`{name}`",
                kind,
                figure(found["contact_force_rms_N"]),
                figure(found["delayed_force_error_percent"]),
                figure(found["prediction_error_percent"]),
                figure(found["within_jnd_percent"]),
                figure(found["missed_contact_percent"]),
                f"`{found['status']}`",
            ]
        )
    heads = (
        "File",
        "Touched",
        "Force RMS [N]",
        "Delayed error [%]",
        "Prediction error [%]",
        "Within JND [%]",
        "Missed [%]",
        "Status",
    )
    return table(heads, rows)


def identifications() -> str:
    """`foretouch identify` on every measured file."""
    rows = []
    for name, kind in datasets().items():
        if kind == "free":
            continue  # refused: nothing is touched
        found = json.loads(foretouch(f"identify {shlex.quote(foretouch(f'datasets fetch {name}'))} --json"))
        known = ((key, found["parameters"][key]) for key in ("ln_k", "s", "b1", "b2"))
        numbers = ", ".join(f"{key} {value:.3g}" for key, value in known)
        rows.append(
            [
                f"`{name}`",
                kind,
                f"{found['contact_samples']:,}",
                figure(found["residual_rms_N"]),
                figure(found["residual_percent"]),
                numbers,
            ]
        )
    heads = ("File", "Touched", "Contact samples", "Residual [N]", "Residual [%]", "Parameters at the end")
    return table(heads, rows)


def estimators() -> str:
    """`foretouch compare` on every TU/e file."""
    names = [name for name, kind in datasets().items() if name.startswith("tue/") and kind != "free"]
    paths = " ".join(shlex.quote(foretouch(f"datasets fetch {name}")) for name in names)
    return compared(f"compare {paths} --json", "prediction_error_percent")


def claims() -> str:
    """`foretouch reproduce`: what the paper claims, and what became of it."""
    rows = [[row["claim"], row["verdict"]] for row in json.loads(foretouch("reproduce --json"))]
    return table(("Claim of the paper", "Verdict"), [[cell.replace("|", "\\|") for cell in row] for row in rows])


def simulated() -> str:
    """`foretouch compare --simulated`, without what nothing before t - delay could tell."""
    return compared("compare --simulated --json", "foreseeable_prediction_error_percent")


def compared(arguments: str, key: str) -> str:
    """One row for each law and estimator, one column for each recording."""
    errors: dict[str, dict[str, str]] = {}
    for result in json.loads(foretouch(arguments))["results"]:
        row = errors.setdefault(f"`{result['model']}` `{result['estimator']}`", {})
        place = Path(result["recording"]).stem.removeprefix("m2_question1")
        row[place] = figure(result["predictions"][0][key]) if result["predictions"] else "–"
    places = list(next(iter(errors.values())))
    return table(
        ("Law and estimator", *places), [[name, *(row[place] for place in places)] for name, row in errors.items()]
    )


def sessions() -> str:
    """`foretouch simulate` for every material and operator, and with the jitter that real time has."""
    rows = []
    for material in json.loads(foretouch("materials list --json")):
        for operator, jitter in (("scripted", "0"), ("recorded", "0"), ("scripted", "0.0005")):
            options = f"--material {material} --operator {operator} --jitter {jitter}"
            found = json.loads(foretouch(f"simulate --duration 20 {options} --json"))
            rows.append(
                [
                    f"`{material}`",
                    operator,
                    f"{1e3 * float(jitter):g}",
                    figure(found["contact_force_rms_N"]),
                    figure(found["delayed_force_error_percent"]),
                    figure(found["prediction_error_percent"]),
                    figure(found["rendered_error_percent"]),
                    figure(found["within_jnd_percent"]),
                    f"{found['clipped_ticks']:,}",
                ]
            )
    heads = (
        "Material",
        "Operator",
        "Jitter [ms]",
        "Force RMS [N]",
        "Delayed error [%]",
        "Prediction error [%]",
        "Rendered error [%]",
        "Within JND [%]",
        "Clipped ticks",
    )
    return table(heads, rows)


def foam() -> str:
    """`foretouch materials fit` of the measured foam."""
    return console("materials fit foam-measured")


def session() -> str:
    """One session as it is printed."""
    return console("simulate --operator recorded")


def console(arguments: str) -> str:
    """A command and what it prints, as a terminal shows them."""
    return f"```console\n$ foretouch {arguments}\n{foretouch(arguments)}\n```\n"


def figure(value: float | None) -> str:
    """Three figures; a dash where there is nothing to measure."""
    if value is None:
        return "–"
    if abs(value) >= 1e5:
        mantissa, exponent = f"{value:.1e}".split("e")
        return f"{mantissa}·10" + str(int(exponent)).translate(SUPERSCRIPTS)
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def table(heads: tuple[str, ...], rows: list[Row]) -> str:
    """A Markdown table, numbers to the right."""
    numeric = [all(row[i][0].isdigit() or row[i] == "–" for row in rows) for i in range(len(heads))]
    lines = [list(heads), ["--:" if right else "---" for right in numeric], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


MEASURE: dict[str, Callable[[], str]] = {
    "predictions": predictions,
    "identifications": identifications,
    "estimators": estimators,
    "simulated": simulated,
    "claims": claims,
    "sessions": sessions,
    "foam": foam,
    "session": session,
}


def main(names: list[str]) -> None:
    """Measure these blocks, or all, and write them into the pages."""
    unknown = set(names) - MEASURE.keys()
    if unknown:
        raise SystemExit(f"no such block: {', '.join(unknown)}; there are {', '.join(MEASURE)}")
    measured: dict[str, str] = {}

    def fill(block: re.Match[str]) -> Any:
        name = block["name"]
        if names and name not in names:
            return block[0]
        if name not in measured:
            print(f"measuring {name}")
            measured[name] = MEASURE[name]()
        return block[1] + measured[name] + block[3]

    for page in PAGES:
        page.write_text(BLOCK.sub(fill, page.read_text()))


if __name__ == "__main__":
    main(sys.argv[1:])
