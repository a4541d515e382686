"""What the pages say is there: make targets, files, fields, tables, pictures."""

from __future__ import annotations

import dataclasses
import inspect
import json
import os
import re
import struct
import subprocess
from pathlib import Path

import pytest
from docs_pages import PAGES, ROOT, code_spans
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.recordings import DATASETS
from foretouch.report import STATUSES, Scores, session_figures

ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
TARGETS = sorted({name for _, span in code_spans() for name in re.findall(r"^make ([a-z][a-z-]*)\b", span)})


def fields(page: str) -> set[str]:
    """All code words of a page."""
    return set(re.findall(r"`([A-Za-z_0-9]+)`", (ROOT / page).read_text()))


def keys(report: dict[str, object]) -> set[str]:
    return set(report) | {key for value in report.values() if isinstance(value, dict) for key in keys(value)}


def test_make_targets_exist() -> None:
    there = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert {"teleop", "test", "check", "docs"} <= set(TARGETS)
    assert set(TARGETS) <= there
    done = subprocess.run(["make", "-n", *TARGETS], cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.long
@pytest.mark.live
@pytest.mark.parametrize(
    "arguments",
    [
        ("setup",),
        ("docs",),
        ("check",),
        ("teleop", 'ARGS=--headless --duration 20 --operator recorded --report "{folder}"'),
        ("teleop", 'ARGS=--duration 5 --port 8093 --recording "{folder}/session.mcap" --json'),
    ],
    ids=lambda arguments: " ".join(arguments),
)
def test_make_targets_run(arguments: tuple[str, ...], tmp_path: Path) -> None:
    command = ["make", *(word.format(folder=tmp_path) for word in arguments)]
    done = subprocess.run(command, cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    if "teleop" in arguments:
        assert "prediction_error_percent" in done.stdout or "Forces at equal command" in done.stdout
        assert (tmp_path / "session.mcap").stat().st_size > 100_000


def test_readme_begins_with_the_page_and_then_the_two_commands_and_a_picture() -> None:
    first = (ROOT / "README.md").read_text().split("\n## ")[0]
    page = r"\[!\[.+\]\(docs/images/demo\.png\)\]\(docs/demo\.md\)\n\n`make demo`, then open `out/demo/"
    assert re.match(page, first)
    assert re.search(
        r"# foretouch\n\n```sh\nmake teleop.*\nmake test.*\n```\n\n!\[.+\]\(docs/images/console\.png\)", first
    )


def test_the_picture_is_a_small_png() -> None:
    data = (ROOT / "docs" / "images" / "console.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", data[16:24]) == (1280, 900)
    assert len(data) < 300_000


def test_files_that_are_named_exist() -> None:
    named = {
        (page, name)
        for page, span in code_spans()
        for name in re.findall(r"(?<![\w/.])(?:src|tests|docs|tools)/[\w./-]*[\w/]", span)
        if "<" not in span and "_build" not in name
    }
    assert len(named) > 20
    assert [f"{page}: {name}" for page, name in sorted(named) if not (ROOT / name).exists()] == []


def test_links_lead_somewhere() -> None:
    missing = []
    for page in PAGES:
        for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text()):
            if "://" not in link and not (page.parent / link).exists():
                missing.append(f"{page.name}: {link}")
    assert missing == []


def test_every_room_has_its_page() -> None:
    rooms = {path.parent.name for path in (ROOT / "src" / "foretouch").glob("*/__init__.py")}
    text = "\n".join(page.read_text() for page in (ROOT / "docs" / "rooms").glob("*.md"))
    shown = set(re.findall(r"\.\. room:: foretouch\.(\w+)", text)) | {"cli"}  # the page of cli shows its commands
    assert shown == rooms


def test_every_field_of_the_report_is_described(tmp_path: Path) -> None:
    command = ["simulate", "--duration", "2", "--json", "--recording", str(tmp_path / "session.mcap")]
    report = json.loads(CliRunner().invoke(app, command).stdout)
    for free in ("settings", "counts"):  # names of options, and of counters
        report[free] = None
    scores = {before + field.name for field in dataclasses.fields(Scores) for before in ("", "rendered_")}
    docstring = set(re.findall(r"``(\w+)``", inspect.getdoc(session_figures) or ""))
    assert keys(report) - scores - docstring - fields("docs/rooms/report.md") == set()


@pytest.mark.long
def test_every_field_of_identify_and_predict_is_described(tmp_path: Path) -> None:
    rows = "\n".join(
        f"{0.001 * i},{0.01 + 0.005 * (i % 1000 > 500)},{0.1 + 3.0 * (i % 1000 > 500)}" for i in range(4000)
    )
    press = tmp_path / "press.csv"
    press.write_text(f"time_s,position_m,force_N\n{rows}\n")
    for command in ("identify", "predict"):
        result = json.loads(CliRunner().invoke(app, [command, str(press), "--json"]).stdout)
        result.pop("parameters", None)
        assert keys(result) - fields("docs/recordings.md") == set(), command


def test_every_status_is_listed() -> None:
    text = (ROOT / "docs" / "recordings.md").read_text()
    assert ".. statuses::" in text  # those of scoring, from STATUSES
    offline = (ROOT / "src" / "foretouch" / "cli" / "commands" / "offline.py").read_text()
    for name in set(re.findall(r'"status": .*"(\w+)" if', offline)) | set(re.findall(r'else "(\w+)",', offline)):
        assert name in STATUSES or f"`{name}`\n: " in text, name


def results() -> dict[str, dict[str, str]]:
    """The table of what is reached: file to its columns by their heads."""
    text = (ROOT / "docs" / "results.md").read_text()
    table = re.split(r"<!-- measured: reach of \w+ -->", text)[1].split("<!-- end -->")[0]
    rows = [line for line in table.splitlines() if line.startswith("|")]
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in rows]
    return {row[0].strip("`"): dict(zip(lines[0], row, strict=True)) for row in lines[2:]}


def test_results_have_every_recording_and_say_which_the_design_was_chosen_on() -> None:
    said = {name: row["Chosen on"] == "yes" for name, row in results().items() if name in DATASETS}
    assert said == {name: entry.seen for name, entry in DATASETS.items()}


@pytest.mark.parametrize("name", ["tue/b-foam", "tue/a-free-motion", "aurora/400-mN"])
def test_results_are_those_of_the_command(name: str) -> None:
    """The figures that no estimator enters: they change only with the data or the scoring."""
    window = ["--delay", "0.02", "--score-from", "0.5", "--score-to", "1.6"] if name.startswith("aurora/") else []
    result = json.loads(CliRunner().invoke(app, ["predict", "--dataset", name, *window, "--json"]).stdout)
    row = results()[name]
    force, late = row["Force RMS [N]"], row["Delayed [%]"]
    for shown, value in ((force, result["contact_force_rms_N"]), (late, result["delayed_force_error_percent"])):
        if value is None:
            assert shown == "–"
        else:
            # the scored samples contain those that were wrongly predicted to be in contact
            assert float(shown) == pytest.approx(value, rel=0.1)
