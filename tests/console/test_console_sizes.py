"""The console in a real browser, on a laptop, a phone and a large screen: what is seen, and what nothing covers."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from console_driver import Session, chromium, drawn, on_screen, open_page, open_tab, wait_until_shown

pytest.importorskip("viser")

from foretouch.console import Console
from foretouch.console.gate.page import ENDED, LOST
from foretouch.console.panels.panel import WIDTH
from foretouch.console.panels.session import SLIDERS
from foretouch.console.panels.stop import READY
from foretouch.console.sentences import ENDED_INSTRUCTION
from foretouch.console.views.shapes import HANDLE_HEIGHT
from foretouch.messages import Settings

pytestmark = [
    pytest.mark.browser,
    pytest.mark.long,  # the page, its stop and its handle are tried in the browser in test_console_browser.py
    pytest.mark.skipif(chromium() is None, reason="no Chromium: install it, or set FORETOUCH_BROWSER"),
]

LAPTOP, PHONE, LARGE = (1280, 720), (390, 844), (1920, 1080)
LABELS = [label for label, *_ in SLIDERS.values()]


class Bench(NamedTuple):
    """One console, one session, one page for all tests: it comes up anew only for another size."""

    console: Console
    session: Session
    page: Any

    def shown(self, size: tuple[int, int]) -> Any:
        """The page as it comes up on a screen of this size."""
        if self.page.viewport_size != {"width": size[0], "height": size[1]}:
            self.resize(size)
            self.page.reload()
            wait_until_shown(self.page)
        return self.page

    def resize(self, size: tuple[int, int]) -> None:
        self.page.set_viewport_size({"width": size[0], "height": size[1]})


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with drawn() as (console, session), session, open_page(console.url, *LAPTOP) as (page, _):
        yield Bench(console, session, page)


def box_of(locator: Any) -> dict[str, float]:
    """Where something is; the panel writes some of it anew many times a second, and in between it is nowhere."""
    box = next((result for _ in range(20) if (result := locator.bounding_box()) is not None), None)
    assert box is not None
    return {"left": box["x"], "top": box["y"], "right": box["x"] + box["width"], "bottom": box["y"] + box["height"]}


def apart(one: dict[str, float], other: dict[str, float]) -> bool:
    beside = one["right"] <= other["left"] or other["right"] <= one["left"]
    return beside or one["bottom"] <= other["top"] or other["bottom"] <= one["top"]


def on_top(page: Any, x: float, y: float) -> str:
    return str(page.evaluate("([x, y]) => document.elementFromPoint(x, y).tagName", [x, y]))


@pytest.mark.parametrize("size", [LAPTOP, LARGE])
def test_handle_material_plot_and_all_sliders_of_the_network_are_seen_at_once(
    bench: Bench, size: tuple[int, int]
) -> None:
    page = bench.shown(size)
    page.get_by_text("hunt-crossley").wait_for()
    seen = [page.locator(".uplot").first, page.get_by_text("hunt-crossley")]
    seen += [page.get_by_text(label, exact=True) for label in LABELS]
    seen += page.locator("input[type=text]:visible").all()[: len(LABELS)]
    for one in seen:
        box = box_of(one)
        assert 0 <= box["left"] < box["right"] <= size[0], one
        assert 0 <= box["top"] < box["bottom"] <= size[1], one
    for height in (0.0, HANDLE_HEIGHT + 1.0):  # the surface, and the handle
        assert on_top(page, *on_screen(page, (0.0, 0.0, height))) == "CANVAS"


def test_the_panel_keeps_its_width_and_its_tables_keep_theirs(bench: Bench) -> None:
    page = bench.shown(LAPTOP)
    table = page.locator(".foretouch-table:visible").first
    width = box_of(table)["right"] - box_of(table)["left"]
    assert width == pytest.approx(WIDTH, abs=30)
    for size in (PHONE, LAPTOP):
        bench.resize(size)
        page.wait_for_timeout(1000)
    assert box_of(table)["right"] - box_of(table)["left"] == width
    tab = page.get_by_role("tab", name="Network")
    tops = set()
    for _ in range(8):
        tops.add(box_of(tab)["top"])
        page.wait_for_timeout(250)
    assert len(tops) == 1


def test_a_curve_has_a_gap_where_it_is_no_number(bench: Bench) -> None:
    drawn = """() => {
        const canvas = document.createElement("canvas");
        const context = canvas.getContext("2d");
        const path = new Path2D();
        path.moveTo(0, 50);
        for (const x of [20, 40, 60, 80, 100]) path.lineTo(x, x === 60 ? NaN : 50);
        context.lineWidth = 6;
        context.stroke(path);
        return [10, 30, 50, 70, 90].map(x => context.getImageData(x, 50, 1, 1).data[3] > 0);
    }"""
    assert bench.page.evaluate(drawn) == [True, True, False, False, True]


@pytest.mark.parametrize("tab", ["Network", "Model", "Energy", "Session", "Recordings"])
def test_nothing_of_a_tab_is_wider_than_the_panel(bench: Bench, tab: str) -> None:
    page = bench.shown(LAPTOP)
    open_tab(page, tab)
    page.wait_for_timeout(500)
    wider = """() => [...document.querySelectorAll(".mantine-ScrollArea-viewport")]
        .map(area => area.scrollWidth - area.clientWidth).filter(more => more > 1)"""
    assert page.evaluate(wider) == []


def test_every_number_of_a_picture_is_of_one_moment(bench: Bench) -> None:
    """The panel's own, and the newest points of its plot; in the scene no number stands that could be older."""
    both = """() => {
        const row = name => [...document.querySelectorAll("tr")].find(one => one.textContent.includes(name)).innerText;
        const number = name => Number(row(name).match(/-?\\d+\\.\\d+(?= N)/)[0]);
        const {data, series} = Object.values(window.__viserTestpoints.uplots)[0].chart;
        const newest = name => data[series.findIndex(one => one.label === name)].at(-1);
        return ["Rendered to the hand", "Delayed force now"].map(name => [number(name), newest(name)]);
    }"""
    page = bench.shown(LAPTOP)
    page.locator("tr", has_text="Rendered to the hand").wait_for()
    page.wait_for_function(f"({both})()[0][0] > 0.5")
    seen = [page.evaluate(both) for _ in range(16) if page.wait_for_timeout(170) is None]
    labels = page.evaluate("JSON.stringify(window.__viserSceneTree.getState())")
    assert max(pairs[0][0] for pairs in seen) > 0.3  # something was pressed
    apart = [abs(number - newest) for pairs in seen for number, newest in pairs]
    assert np.median(apart) < 0.02
    assert "rendered force" in labels
    assert ' N"' not in labels


def test_a_number_out_of_range_is_said_to_be_and_goes_nowhere(bench: Bench) -> None:
    page, before = bench.shown(LAPTOP), len(bench.session.of(Settings))
    open_tab(page, "Network")
    box = page.locator("input[type=text]:visible").nth(1)
    note, value = page.locator("#foretouch-range"), box.input_value()
    for typed in ("50", "-3", "abc"):
        box.click()
        box.press("Control+a")
        page.keyboard.type(typed)
        assert note.inner_text() == "Not set. Delay back [s]: 0 to 2"
        assert note.is_visible()
        box.press("Tab")
        page.wait_for_timeout(500)
        assert note.is_visible()  # for as long as it takes to read it
        assert box.input_value() == value
        assert len(bench.session.of(Settings)) == before
    box.fill("0.5")
    box.press("Enter")
    page.wait_for_timeout(500)
    assert bench.session.of(Settings)[-1].force_delay == 0.5
    assert not note.is_visible()


def test_on_a_phone_the_scene_is_above_the_panel_and_the_stop_is_over_no_data(bench: Bench) -> None:
    page = bench.shown(PHONE)
    stop = box_of(page.get_by_role("button", name=READY))
    sheet = box_of(page.locator(".mantine-Paper-root").filter(has=page.locator(".foretouch-alarm")).first)
    plot = box_of(page.locator(".uplot").first)
    assert (sheet["left"], sheet["right"]) == (0, PHONE[0])
    assert apart(stop, sheet)
    assert stop["bottom"] <= PHONE[1]
    assert sheet["top"] >= 0.38 * PHONE[1]
    assert 0 <= plot["left"] < plot["right"] <= PHONE[0]
    assert plot["bottom"] <= sheet["bottom"]  # no scrolling for it
    for height in (-1.0, HANDLE_HEIGHT + 1.0):
        x, y = on_screen(page, (0.0, 0.0, height))
        assert y < sheet["top"]
        assert on_top(page, x, y) == "CANVAS"


def test_the_key_of_the_stop_is_named_where_there_are_keys(bench: Bench) -> None:
    shown = "button => getComputedStyle(button.querySelector('.mantine-Button-label'), '::after').content"
    there = bench.page.get_by_role("button", name=READY)
    assert there.evaluate(shown) == '"(Space)"'
    phone = bench.page.context.browser.new_context(
        viewport=dict(zip(("width", "height"), PHONE, strict=True)), has_touch=True, is_mobile=True
    )
    with contextlib.closing(phone):
        page = phone.new_page()
        page.goto(bench.console.url)
        wait_until_shown(page)
        assert page.get_by_role("button", name=READY).evaluate(shown) == "none"


def test_a_session_that_has_ended_says_so(bench: Bench) -> None:
    """The last of all: after it the console is closed."""
    bench.console.close(ended=True)
    bench.page.get_by_text(ENDED, exact=True).wait_for(timeout=10_000)
    bench.page.get_by_text("so is the way to start another: foretouch teleop").wait_for()
    bench.page.get_by_text(ENDED_INSTRUCTION, exact=True).first.wait_for()
    assert bench.page.get_by_text(LOST).count() == 0
