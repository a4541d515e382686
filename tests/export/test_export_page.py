"""The page for a browser: it needs nothing but itself, and gives Python's bits, sixty frames a second."""

from __future__ import annotations

import base64
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_browser import COURSE, PACE, PLAIN_MATHEMATICS, TRIAL, bits, chromium, numbers_of, opened, rows_of_python
from page_course import COURSES, aims
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.export import demo, write_page
from foretouch.identification import predict
from foretouch.recordings import read_recording
from foretouch.report import score_prediction

HERE = Path(__file__).parent
SPRING = HERE.parents[1] / "docs" / "examples" / "spring.csv"
BROWSER = [
    pytest.mark.long,
    pytest.mark.browser,
    pytest.mark.skipif(chromium() is None, reason="no Chromium: install it or set FORETOUCH_BROWSER"),
    pytest.mark.skipif(shutil.which("wasm-ld") is None, reason="no lld: make demo installs it"),
]


def in_browser(*marked: Any) -> Callable[[Any], Any]:
    def mark(test: Any) -> Any:
        for one in (*BROWSER, *marked):
            test = one(test)
        return test

    return mark


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("page") / "demo"
    write_page(made)
    return made


@in_browser()
@pytest.mark.parametrize(
    ("mathematics", "near"), [(PLAIN_MATHEMATICS, 0.0), ({}, 1e-9)], ids=["plain mathematics", "this machine's"]
)
def test_a_session_in_the_browser_has_the_bits_of_python(
    folder: Path, mathematics: dict[str, str], near: float
) -> None:
    python = rows_of_python(mathematics)
    with opened(folder, "?clock=off") as page:
        for name, options in COURSES.items():
            words, *sizes = page.evaluate(COURSE, [aims(), options])
            rows = numbers_of(words)
            assert np.nanmax(np.abs(rows - python[name])) <= near
            assert near > 0.0 or np.array_equal(bits(rows), bits(python[name])), name
            assert sizes == python[f"bytes {name}"].tolist()
            assert rows[:, 4].max() > 1.0


@in_browser()
def test_the_delayed_force_swings_and_the_model_does_not(folder: Path) -> None:
    held = aims() + [aims()[-1]] * 6000
    with opened(folder, "?clock=off") as page:
        by_model, by_delayed = (
            numbers_of(page.evaluate(COURSE, [held, COURSES["foam"] | {"delayed": delayed}])[0])[-3000:, 2]
            for delayed in (False, True)
        )
    assert np.ptp(by_model) < 2e-4
    assert np.ptp(by_delayed) > 5e-3


@in_browser(pytest.mark.live)
def test_it_ticks_a_thousand_times_and_draws_sixty_times_a_second(folder: Path) -> None:
    with opened(folder) as page:
        page.get_by_role("button", name="Press for me").click()
        page.wait_for_timeout(1000)
        frames, ticks, _ = page.evaluate(PACE)
    median = float(np.median(np.diff(frames)))
    assert median < 17.5
    assert 950 < ticks < 1050


@in_browser()
@pytest.mark.parametrize("width", [390, 1366])
def test_it_is_used_by_keyboard_and_finger_and_fits_the_screen(folder: Path, width: int) -> None:
    small = width < 500
    context = {"viewport": {"width": width, "height": 844 if small else 768}, "has_touch": small, "is_mobile": small}
    with opened(folder, color_scheme="dark" if small else "light", **context) as page:
        assert page.evaluate("document.documentElement.scrollWidth") == width
        for part in ("#scene", "#handle", "#plot"):  # on the first screen: the hand, and what comes of it
            box = page.locator(part).bounding_box()
            assert box["y"] + box["height"] < (700 if small else 600)
        assert box["height"] >= 150
        page.get_by_label("Handle").focus()
        for _ in range(7):
            page.keyboard.press("PageDown")
        assert page.evaluate("aim") == 21.0
        # The first touch is guarded: the robot waits at the surface until that is known here.
        page.wait_for_function("state.has_model && latest[TRUE] > 0.01", timeout=20_000)
        for _ in range(3):
            page.keyboard.press("PageDown")
        page.wait_for_function("latest[FELT] > 0.5 && latest[ARRIVED] > 0.5", timeout=20_000)
        page.wait_for_function("document.getElementById('summary').textContent.includes('You press')")
        box = page.locator("#scene").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x, y - 100, steps=5)
        page.mouse.up()
        assert page.evaluate("aim") < 20.0
        page.keyboard.press("Tab")
        unnamed = page.evaluate("""[...document.querySelectorAll("button, input, select, canvas, svg")].filter(
          (one) => !one.textContent.trim() && !one.labels?.length && !one.ariaLabel).length""")
        assert unnamed == 0
        page.get_by_role("tab", name="Press").focus()
        page.keyboard.press("ArrowRight")
        assert page.get_by_role("tab", name="Your recording").get_attribute("aria-selected") == "true"
        assert page.evaluate("document.documentElement.scrollWidth") == width


@in_browser()
@pytest.mark.parametrize("given", ["example.csv", "spring.csv"])
def test_a_recording_is_predicted_as_the_command_predicts_it(folder: Path, given: str) -> None:
    file = folder / given if given == "example.csv" else SPRING
    recording = read_recording(file)
    forces = predict(recording, delay=0.3).force
    known = np.interp(recording.time - 0.3, recording.time, recording.force)
    scores = score_prediction(
        recording.time, recording.force, forces, known, contact_floor=0.05, position=recording.position
    )
    with opened(folder) as page:
        page.get_by_role("tab", name="Your recording").click()
        page.set_input_files("#file", file)
        predicted, rmse, _, rms = page.evaluate(TRIAL)
    farthest = float(np.abs(np.array(predicted) - forces).max())
    assert farthest < 1e-9
    assert rmse == pytest.approx(scores.prediction_rmse_N, rel=1e-6)
    assert rms == pytest.approx(scores.contact_force_rms_N, rel=1e-6)


DROP = """([text, name]) => {
  const dropped = new DataTransfer();
  dropped.items.add(new File([text], name));
  dispatchEvent(new DragEvent("drop", { dataTransfer: dropped }));
}"""


@in_browser()
def test_a_dropped_file_is_read_and_one_that_is_no_recording_is_refused_with_the_reason(folder: Path) -> None:
    with opened(folder) as page:
        page.evaluate(DROP, [(folder / "example.csv").read_text(), "mine.csv"])
        page.evaluate(TRIAL)
        assert "mine.csv: 3000 samples" in page.locator("#file-says").inner_text()
        refused = {
            "nothing": "no line names columns",
            "time_s,position_m,force_N\n1,2,3\n": "too few rows of numbers (1)",
        }
        for text, said in refused.items():
            page.evaluate(DROP, [text, "other.csv"])
            page.wait_for_function("said => document.getElementById('file-says').textContent.includes(said)", arg=said)


GAMEPAD = """() => {
  window.effects = [];
  const playEffect = async (kind, effect) => window.effects.push(effect.strongMagnitude);
  navigator.getGamepads = () => [null, { connected: true, axes: [0, 0.5], vibrationActuator: { playEffect } }];
}"""
"""A stand-in for a gamepad, whose stick is held down."""


@in_browser()
def test_the_force_is_heard_and_shakes_a_gamepad_that_moves_the_handle(folder: Path) -> None:
    with opened(folder) as page:
        page.get_by_role("button", name="Sound").click()
        page.evaluate(GAMEPAD)
        page.wait_for_timeout(500)
        assert page.evaluate("[aim, effects.length]") == [0.0, 0]  # nobody has asked for it
        page.get_by_role("button", name="Gamepad").click()
        page.wait_for_function("latest[FELT] > 0.5", timeout=20_000)
        page.wait_for_function("Math.max(...effects) > 0.05", timeout=5_000)
        said = page.locator("#also-says").inner_text()
        assert "Left ear" in said
        assert "left stick" in said
        assert page.evaluate("audio.context.state") == "running"
        page.get_by_role("button", name="Pause").click()
        aim, count = page.evaluate("[aim, effects.length]")
        page.wait_for_timeout(300)
        assert page.evaluate("[aim, effects.length]") == [aim, count]  # no rumble stays
        page.get_by_role("button", name="Sound").click()
        page.wait_for_function("audio.context.state === 'suspended'", timeout=5_000)


TABLES = {
    "time_ms;Weg [mm];Kraft [N]": (";", ",", (1e3, 1e3, 1.0)),
    "t\tposition_m\tforce_mN": ("\t", ".", (1.0, 1.0, 1e3)),
}


@in_browser()
@pytest.mark.parametrize("names", TABLES)
def test_other_names_units_and_separators_are_understood(folder: Path, tmp_path: Path, names: str) -> None:
    separator, point, scales = TABLES[names]
    lines = (folder / "example.csv").read_text().splitlines()[1:]
    numbers = [zip(map(float, line.split(",")), scales, strict=True) for line in lines]
    rows = [[repr(value * scale).replace(".", point) for value, scale in row] for row in numbers]
    (tmp_path / "table.csv").write_text("\n".join([names, *map(separator.join, rows)]))
    with opened(folder) as page:
        page.get_by_role("tab", name="Your recording").click()
        page.set_input_files("#file", tmp_path / "table.csv")
        page.evaluate(TRIAL)
        assert 2.0 < page.evaluate("result.rms") < 4.0
        assert "times as near" in page.locator("#trial-says").inner_text()


@in_browser()
def test_a_row_of_units_and_times_in_nanoseconds_are_understood(folder: Path, tmp_path: Path) -> None:
    rows = [(0.004 * k, 10.0 * abs(np.sin(0.01 * k))) for k in range(1500)]
    plain = "\n".join(f"{time:.3f},{at:.6f},{0.5 * max(at - 5.0, 0.0):.6f}" for time, at in rows)
    late = "\n".join(f"{int(1e9 * time)},{1e-3 * at:.9f},{0.5 * max(at - 5.0, 0.0):.6f}" for time, at in rows)
    texts = {"units": f"time,position,force\n[s],mm,(N)\n{plain}", "ns": f"timestamp_ns,position_m,force_N\n{late}"}
    wrong = []
    with opened(folder) as page:
        page.click("#tab-recording")
        for name, text in texts.items():
            Path(tmp_path, f"{name}.csv").write_text(text)
            page.set_input_files("#file", str(Path(tmp_path, f"{name}.csv")))
            page.wait_for_function("result")
            wrong.append(page.evaluate("[result.predicted_rms, result.delayed_rms]"))
            page.evaluate("result = null")
    assert wrong[0] == pytest.approx(wrong[1], rel=0.02)
    assert wrong[0][0] < 0.2 * wrong[0][1]


ROWS = [(0.01 * k, 0.5 * k, -0.25 * k) for k in range(120)]
"""Time, position and force of a table that is read and not learnt from."""


def in_rows(separator: str, point: str = ".", quoted: bool = False) -> str:
    mark = '"' * quoted
    return "\n".join(separator.join(mark + repr(one).replace(".", point) + mark for one in row) for row in ROWS)


WRITTEN = {
    "commas, quoted": "time_s,position_mm,force_N\n" + in_rows(",", ",", quoted=True),
    "semicolons, quoted": '"time_s";"position_mm";"force_N"\n' + in_rows(";", ",", quoted=True),
    "tabs, with commas": "time_s\tposition_mm\tforce_N\n" + in_rows("\t", ","),
    "a name in quotes with a comma": 'time_s,"position_mm","force, by the cell_N"\n' + in_rows(","),
    "remarks": "% made by a program\n// a, b, c\n  # one more\ntime_s,position_mm,force_N\n" + in_rows(","),
    "names in a remark": "# time_s,position_mm,force_N\n" + in_rows(","),
    "lines on the sample": "Sample: A12\nSpeed;10;mm/s\n\nTime;Position;Force\n(s);(mm);(N)\n" + in_rows(";", ","),
    "remarks among the rows": "time_s,position_mm,force_N\n// begin\n" + in_rows(",") + "\n# end, 1, 2\n",
    "a point of thousands": "time_s;position_mm;force_N\n" + in_rows(";", ",") + "\n9,9;1.234;0,5",
    "no force in the first row": "time_s,position_mm,force_N\n-0.01,0.0,\n" + in_rows(","),
    "other letters for micrometres": "time_s,position_\u03bcm,force_N\n" + in_rows(","),
}


@in_browser()
def test_decimal_commas_quotes_and_lines_above_the_names_are_understood(folder: Path) -> None:
    with opened(folder) as page:
        page.click("#tab-recording")
        for name, text in WRITTEN.items():
            page.evaluate("text => { load(text, 'table'); }", text)
            time, position, force = page.evaluate("Object.values(chosen()).map((one) => Array.from(one))")
            scale = 1e-6 if "micrometres" in name else 1e-3
            assert time == pytest.approx([row[0] for row in ROWS]), name
            assert position == pytest.approx([scale * row[1] for row in ROWS]), name
            assert force == pytest.approx([row[2] for row in ROWS]), name


@in_browser()
def test_after_many_clicks_the_hand_is_where_it_was(folder: Path) -> None:
    with opened(folder) as page:
        page.evaluate("setAim(8); for (let k = 0; k < 30; k++) $('nudge').click();")
        page.evaluate("for (let k = 0; k < 31; k++) $('delayed').click();")
        page.wait_for_timeout(500)
        assert page.evaluate("aim") == pytest.approx(8.0)


@in_browser()
def test_no_note_stays_while_the_session_stands(folder: Path) -> None:
    with opened(folder) as page:
        page.click("#auto")
        page.click("#sound")
        page.evaluate("note = null; played = audio.now; audio.now = (force) => played((note = force));")
        page.wait_for_function("note > 1 && ($('pause').click(), true)", timeout=20_000)
        page.wait_for_timeout(300)
        felt, note = page.evaluate("[latest[FELT], note]")
        assert felt > 0.5
        assert note == 0.0


@in_browser()
def test_what_is_scored_was_predicted_for_that_delay_and_those_columns(folder: Path) -> None:
    with opened(folder) as page:
        page.click("#tab-recording")
        page.evaluate("load(CONTENT.example, 'example'); $('trial-delay').value = 10;")
        page.wait_for_function("result")
        assert page.evaluate("result.delayed_rms / result.rms") == pytest.approx(0.97, abs=0.01)
        page.evaluate("startTrial(); $('time-column').value = 1; table.columns[1].fill(0); startTrial();")
        page.wait_for_timeout(1500)
        assert page.evaluate("result") is None


@in_browser()
def test_a_file_that_cannot_be_read_leaves_nothing_of_the_one_before(folder: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("nothing")
    with opened(folder) as page:
        page.click("#tab-recording")
        page.click("#example")
        page.wait_for_selector("#scores:not([hidden])")
        for mended in ("nothing", "nothing, still"):  # the same file may be chosen again
            bad.write_text(mended)
            page.evaluate("say('file-says', '')")
            page.set_input_files("#file", str(bad))
            page.wait_for_function("$('file-says').textContent.startsWith('bad.csv')")
            assert page.is_hidden("#scores")
            assert page.input_value("#file") == ""
        drop = (
            "take => { const gone = new File(['x'], 'gone'); gone.text = () => Promise.reject(new Error('a folder'));"
        )
        drop += "dispatchEvent(Object.assign(new Event('drop'), { dataTransfer: { files: [gone] } })); }"
        page.evaluate(drop)
        page.wait_for_function("$('file-says').textContent === 'gone cannot be read: a folder'")


@in_browser()
def test_times_beyond_all_measure_do_not_hang_the_page(folder: Path) -> None:
    with opened(folder) as page:
        page.click("#tab-recording")
        page.evaluate(
            "axes($('trial-plot'), 2e20, 2e20 + 0.5, 0, 5, ' s'); axes($('trial-plot'), 0, 1e300, -1e308, 1e308, '')"
        )
        assert page.evaluate("ticks(0, 10, 2)") == [0, 2, 4, 6, 8, 10]


@in_browser()
def test_its_files_are_small_and_need_nothing_of_their_surroundings(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == sorted(demo.FILES)
    page = (folder / "index.html").read_text()
    content = json.loads(re.search(r"const CONTENT = (\{.*\});\n", page)[1])  # type: ignore[index]
    module = base64.b64decode(content["wasm"])
    assert sum(path.stat().st_size for path in folder.iterdir()) < 600_000
    assert len(module) < 175_000


def test_the_page_names_no_address() -> None:
    text = demo.page_text(b"\0asm", "time_s,position_m,force_N\n")
    assert "://" not in text
    assert not re.findall(r"@[A-Z]+@", text)
    assert not re.findall(r"\b(?:fetch\(|XMLHttpRequest|WebSocket|sendBeacon|importScripts)\b", text)


def a_file(folder: Path) -> Path:
    (folder / "there").write_text("")
    return folder / "there"


def something_else(folder: Path) -> Path:
    (folder / "notes.txt").write_text("")
    return folder


@pytest.mark.parametrize(
    ("place", "line"),
    [
        (a_file, "is there and is no folder"),
        (something_else, "holds something else than such a page (notes.txt)"),
        (lambda folder: folder / "no" / "x", "there is no folder"),
        (lambda folder: folder / ("x" * 300), "cannot be written: File name too long"),
        (lambda _: Path("/sys/foretouch-page"), "cannot be written"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_compiled(
    tmp_path: Path, place: Callable[[Path], Path], line: str
) -> None:
    done = CliRunner().invoke(app, ["export", "page", "--out", str(place(tmp_path))])
    assert line in str(done.exception)


def test_a_missing_tool_is_named_with_what_installs_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    done = CliRunner().invoke(app, ["export", "page", "--out", str(tmp_path / "page")])
    assert "clang and wasm-ld are missing" in str(done.exception)
    assert "apt-get install clang lld wasi-libc" in str(done.exception)
