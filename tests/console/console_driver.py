"""What tests of the console share: a browser, the mouse on the handle, and a session made of a script and a law."""

from __future__ import annotations

import contextlib
import functools
import heapq
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from foretouch.console import Console
from foretouch.console.views.hold import HOME
from foretouch.console.views.line import CAMERA, FIELD_OF_VIEW
from foretouch.console.views.probes import UNITS
from foretouch.console.views.shapes import HANDLE_HEIGHT
from foretouch.console.views.space import HANDLE_SIZE, SPACE_CAMERA
from foretouch.devices import BrowserOperator, ScriptedOperator
from foretouch.messages import (
    VERSION,
    Choice,
    Handle,
    Hello,
    LeaderState,
    Message,
    ModelUpdate,
    SessionLog,
    Settings,
    Status,
    Telemetry,
)
from foretouch.models import HuntCrossley, advance
from foretouch.recordings import SessionWriter
from foretouch.session import SessionSettings, make_operator, make_session_robot, simulate

SURFACE, PRESS_DEPTH = 0.012, 0.009
ARROW_SHARE = 0.7
"""Of the handle in space, at which its arrow is taken."""

# --- the browser ------------------------------------------------------------------------------------------------------

CHROMIUM_ARGUMENTS = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking",
    "--disable-component-update", "--disable-default-apps", "--disable-domain-reliability", "--disable-sync",
    "--no-first-run", "--no-pings",
]  # fmt: skip


def chromium() -> str | None:
    """Path of a Chromium, None where there is none."""
    named = os.environ.get("FORETOUCH_BROWSER")
    if named:
        return named if Path(named).is_file() else None
    return next((path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None)


@contextlib.contextmanager
def open_page(
    url: str, width: int = 1000, height: int = 720, says: str = "Drag the blue handle down to press"
) -> Iterator[tuple[Any, list[str]]]:
    """A page that shows the console, and the list of all addresses that it asked for."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=CHROMIUM_ARGUMENTS)
        page = browser.new_page(viewport={"width": width, "height": height})
        requests: list[str] = []
        page.on("request", lambda request: requests.append(request.url))
        page.on("websocket", lambda socket: requests.append(socket.url))
        page.goto(url)
        page.locator("canvas").first.wait_for(timeout=30_000)
        page.get_by_text(says).wait_for(timeout=30_000)
        try:
            yield page, requests
        finally:
            browser.close()


def wait_until_shown(page: Any) -> None:
    """Wait until a page that was loaded without `open_page` shows the console and nothing over it."""
    page.locator("canvas").first.wait_for(timeout=30_000)
    page.get_by_text("Drag the blue handle down to press").wait_for(timeout=30_000)


def wait_for(condition: Callable[[], Any], seconds: float = 10.0, page: Any = None) -> None:
    """Wait until something is so, while a page goes on where there is one: a slow machine has that time."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s"
        time.sleep(0.02) if page is None else page.wait_for_timeout(100)


def open_tab(page: Any, name: str) -> None:
    """Show one of the panel's tabs."""
    page.get_by_role("tab", name=name).click()


def on_screen(
    page: Any, point: tuple[float, float, float], camera: tuple[tuple[float, ...], tuple[float, ...]] = CAMERA
) -> tuple[float, float]:
    """Where a point of the scene is on the page [pixels], seen by the camera that nobody has moved yet."""
    box = _scene_box(page)
    eye, target = (np.array(v) for v in camera)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    to = np.array(point) - eye
    scale = 0.5 * box["height"] / np.tan(0.5 * FIELD_OF_VIEW) / (to @ ahead)
    return (
        box["x"] + 0.5 * box["width"] + scale * float(to @ right),
        box["y"] + 0.5 * box["height"] - scale * float(to @ up),
    )


def _scene_box(page: Any) -> dict[str, float]:
    """The largest canvas: the scene; plots are canvases too."""
    boxes = [canvas.bounding_box() for canvas in page.locator("canvas").all()]
    return max((box for box in boxes if box), key=lambda box: box["width"] * box["height"])


def drag_handle(page: Any, press_mm: float, seconds: float = 1.0, hold: float = 0.5, steps: int = 10) -> None:
    """Take the handle's rail with the mouse, push down by `press_mm` [mm], hold for `hold` [s], let go."""
    with held_handle(page, press_mm, seconds, steps):
        page.wait_for_timeout(1000 * hold)


@contextlib.contextmanager
def held_handle(page: Any, press_mm: float, seconds: float = 1.0, steps: int = 10) -> Iterator[None]:
    """Like `drag_handle`, held while the block runs."""
    try:
        take_handle(page, press_mm, seconds, steps)
        yield
    finally:
        page.mouse.up()


def take_handle(page: Any, press_mm: float, seconds: float = 1.0, steps: int = 10) -> None:
    """Like `held_handle`, and never let go."""
    middle = HANDLE_HEIGHT + 1.0
    x, y = on_screen(page, (0.0, 0.0, middle))
    to_x, to_y = on_screen(page, (0.0, 0.0, middle - press_mm * 1e-3 * UNITS))
    page.mouse.move(x, y)
    page.wait_for_timeout(300)
    page.mouse.down()
    for step in range(1, steps + 1):
        part = step / steps
        page.mouse.move(x + part * (to_x - x), y + part * (to_y - y))
        page.wait_for_timeout(1000 * seconds / steps)
    # A slow renderer answers late: go on when the console has heard of the drag and the last move has been drawn.
    page.get_by_text("You press.").wait_for(timeout=30_000)
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


@contextlib.contextmanager
def held_in_space(page: Any, down_mm: float, seconds: float = 1.5, steps: int = 10) -> Iterator[None]:
    """Take the upward arrow of the handle in space with the mouse and push it down by `down_mm` [mm]; let go behind."""
    x, y, z = (UNITS * value for value in HOME)
    grip = z + ARROW_SHARE * HANDLE_SIZE
    start = on_screen(page, (x, y, grip), SPACE_CAMERA)
    end = on_screen(page, (x, y, grip - down_mm * 1e-3 * UNITS), SPACE_CAMERA)
    page.mouse.move(*start)
    page.wait_for_timeout(500)
    page.mouse.down()
    try:
        for step in range(1, steps + 1):
            part = step / steps
            page.mouse.move(start[0] + part * (end[0] - start[0]), start[1] + part * (end[1] - start[1]))
            page.wait_for_timeout(1000 * seconds / steps)
        page.get_by_text("You press.").wait_for(timeout=30_000)
        yield
    finally:
        page.mouse.up()


def kill_tab(page: Any) -> None:
    """End the process that draws the page, as a crash of the tab or a full memory would (`kill -9`)."""
    session = page.context.browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    for process in processes:
        if process["type"] == "renderer":
            os.kill(process["id"], signal.SIGKILL)


def plot_columns(page: Any, label: str) -> list[np.ndarray]:
    """The columns of the plot that has a curve of this label, as the browser holds them; NaN where there is none."""
    columns = page.evaluate(
        "label => Array.from(Object.values(window.__viserTestpoints.uplots).map(one => one.chart)"
        ".find(chart => chart.series.some(series => series.label === label)).data,"
        " column => Array.from(column, value => Number.isFinite(value) ? value : null))",
        label,
    )
    return [np.array([np.nan if value is None else value for value in column]) for column in columns]


def plot_data(page: Any) -> list[np.ndarray]:
    """Time, true, predicted and delayed force as the browser's plot holds them; NaN where there is none."""
    columns = page.evaluate(
        "Array.from(Object.values(window.__viserTestpoints.uplots)[0].chart.data,"
        " column => Array.from(column, value => Number.isFinite(value) ? value : null))"
    )
    time_axis, *forces = (np.array([np.nan if value is None else value for value in column]) for column in columns)
    return [time_axis, *(np.where(force < 0.0, np.nan, force) for force in forces)]


def choose(page: Any, label: str, option: str) -> None:
    """Choose an option of a dropdown by its label."""
    page.get_by_label(label, exact=True).and_(page.locator("input")).click()
    page.get_by_role("option", name=option, exact=True).click()


# --- a recording ------------------------------------------------------------------------------------------------------


def simulated_session(path: Path, seconds: float = 5.0) -> SessionLog:
    """A simulated session, and the file that it is written to."""
    chosen = SessionSettings(material="hunt-crossley", seed=3)
    robot, reach = make_session_robot(chosen)
    operator = make_operator(chosen, surface=reach.surface, press_depth=reach.press_depth, say=lambda line: None)
    texts = {"surface": str(reach.surface), "press_depth": str(reach.press_depth)}
    run = functools.partial(simulate, chosen, duration=seconds, operator=operator, robot=robot, description=texts)
    with SessionWriter(path) as writer:
        log = run(record=writer.write).log
        writer.close(log.counts)
    return log


# --- the session ------------------------------------------------------------------------------------------------------


class Session:
    """Messages of a session in real time: the browser's operator, a law on the follower's side, a slightly wrong one on
    the leader's, and delays as the settings say.

    Args:
        watch: Gets every message.
    """

    def __init__(
        self, watch: Callable[[Message], None], position_delay: float = 0.08, force_delay: float = 0.3
    ) -> None:
        self.published: list[Message] = []
        self.positions: list[float] = []
        self.status = Status.FOLLOWING  # what the robot is to say of itself
        self.clutched = False  # what the operator at the mouse is known to do
        self.supervised = True  # whether somebody follows a choice
        self.runs = {"material": "hunt-crossley", "grip": "none"}
        self.recording = ""
        self.jumps: list[float] = []  # from hand to handle [m] whenever somebody takes it
        self._watch = watch
        self._delays = (position_delay, force_delay)
        self._operator = BrowserOperator(ScriptedOperator(SURFACE, PRESS_DEPTH, seed=5), deepest=0.05)
        self._material = HuntCrossley(stiffness=2600.0, damping=4000.0, exponent=1.5)
        self._model = HuntCrossley(stiffness=2750.0, damping=3000.0, exponent=1.5)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def publish(self, message: Message) -> None:
        self.published.append(message)
        if isinstance(message, Settings):
            self._delays = (message.position_delay, message.force_delay)
        if isinstance(message, Choice):
            named = {"material": message.material, "grip": message.grip}
            self.runs |= {name: value for name, value in named.items() if value}
            self.recording = {"start": "another.mcap", "stop": ""}.get(message.record, self.recording)

    def of(self, kind: type[Message]) -> list[Any]:
        return [message for message in self.published if isinstance(message, kind)]

    def __enter__(self) -> Session:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()

    def _run(self) -> None:
        tick, taken, before = 0, 0, 0.0
        arrived: Telemetry | None = None
        under_way: list[tuple[float, int, Telemetry]] = []
        commands: list[tuple[float, int, int, float, float]] = []
        start = time.monotonic()
        while not self._end.wait(0.004):
            while tick * 1e-3 < time.monotonic() - start:
                tick += 1
                now, now_ns = tick * 1e-3, tick * 1_000_000
                for message in self.published[taken:]:
                    if isinstance(message, Handle):
                        if message.held and not self._operator.held:
                            self.jumps.append(message.position - before)
                        self._operator.take(message.position, message.held, now_ns, clutched=message.clutched)
                    taken += 1
                position = self._operator.read(now_ns)
                self.clutched = self._operator.clutched
                velocity, before = (position - before) / 1e-3, position
                self.positions.append(position)
                heapq.heappush(commands, (now + self._delays[0], tick, tick, position, velocity))
                while commands and commands[0][0] <= now:
                    _, _, sequence, x, v = heapq.heappop(commands)
                    telemetry = self._telemetry(tick, now_ns, sequence, x, v)
                    self._watch(telemetry)
                    heapq.heappush(under_way, (now + self._delays[1], sequence, telemetry))
                while under_way and under_way[0][0] <= now:
                    arrived = heapq.heappop(under_way)[2]
                self._watch(self._leader(tick, now_ns, position, velocity, arrived))
                if tick % 500 == 1:
                    self._say_hello(tick, now_ns)

    def _telemetry(self, tick: int, now_ns: int, sequence: int, x: float, v: float) -> Telemetry:
        force = advance(self._material, (), x - SURFACE, v, 1e-3)[1]
        touching = x > SURFACE
        numbers = (x, x, v, force, force, force, touching, False, 1, 1_000_000, 50_000)
        return Telemetry(VERSION, tick, now_ns, sequence, *numbers, status=self.status)

    def _leader(self, tick: int, now_ns: int, x: float, v: float, arrived: Telemetry | None) -> LeaderState:
        force = advance(self._model, (), x - SURFACE, v, 1e-3)[1]
        if tick % 20 == 1:
            self._say_model(tick, now_ns)
        delayed, sequence = (arrived.force, arrived.sequence) if arrived else (0.0, 0)
        numbers = (x, v, force, min(force, 10.0), delayed, sequence, tick - (tick - 1) % 20, 0.0)
        return LeaderState(VERSION, tick, now_ns, *numbers, False, 1_000_000, 50_000)

    def _say_hello(self, tick: int, now_ns: int) -> None:
        values = {
            "operator": "browser",
            **self.runs,
            "position_delay": str(self._delays[0]),
            "force_delay": str(self._delays[1]),
            "surface": str(SURFACE),
            "press_depth": str(PRESS_DEPTH),
        }
        self._watch(Hello.of("leader", tick, now_ns, values))
        if self.supervised:
            self._watch(Hello.of("supervisor", tick, now_ns, {"supervised": "yes", "recording": self.recording}))

    def _say_model(self, tick: int, now_ns: int) -> None:
        law = (self._model.law, self._model.parameters, ())
        self._watch(ModelUpdate(VERSION, tick, now_ns, tick, *law, SURFACE, True, "", "given", b""))


@contextlib.contextmanager
def drawn(**options: Any) -> Iterator[tuple[Console, Session]]:
    """A console that draws, and the session that it watches; with ``publish`` it is not heard there."""
    sessions: list[Session] = []
    publish = options.pop("publish", lambda message: sessions[0].publish(message))
    console = Console(0, publish, **options)
    sessions.append(Session(console.watch))
    end = threading.Event()
    drawing = threading.Thread(target=console.run, args=(end.is_set,))
    drawing.start()
    try:
        yield console, sessions[0]
        assert drawing.is_alive()
    finally:
        end.set()
        drawing.join()
        console.close()
