"""The console: watches a session, and lets a person press, choose, record, look at recordings and stop the robot."""

from __future__ import annotations

import contextlib
import io
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from foretouch.console import sentences
from foretouch.console.gate import Entrance, make_gated_server
from foretouch.console.gate.entrance import require_free_port
from foretouch.console.panels.figures import describe, numbers_html
from foretouch.console.panels.panel import CHOOSE_RECORDING, WATCH_RECORDING, Panel, banner_html, felt
from foretouch.console.panels.session import CHOICES, SLIDERS, Actions, Publisher
from foretouch.console.panels.stop import ASKING, LATCHED, READY, UNABLE, EmergencyCall
from foretouch.console.playback import Library
from foretouch.console.plots import SECONDS, put
from foretouch.console.views.arms import ArmView
from foretouch.console.views.hold import Hold, SpaceHold
from foretouch.console.views.line import LineView, look
from foretouch.console.views.space import SpaceView
from foretouch.console.watched import NOWHERE, Watched
from foretouch.errors import MissingExtraError, one_line
from foretouch.link import new_press
from foretouch.link.access import free_port
from foretouch.messages import Choice, EmergencyStop, Message, Settings, Status, Stop, Telemetry
from foretouch.quantities.pose import Vector

ROUND_PERIOD, PLOT_PERIOD, TEXT_PERIOD, LIST_PERIOD = 1 / 30, 1 / 12, 1 / 6, 2.0
"""Periods at which a due picture is looked for, and forces, numbers and the list of recordings are sent at most [s]."""
LOOK_PERIOD = 0.5  # Period at which the lateness of the loops is read [s]
LAST_WORD = 0.3  # Time that the pages have to learn that the session has ended [s]
UNSEEN_PERIOD = 0.5  # Period without a browser [s]: the first that comes sees no older state
ANSWERS = (Status.STOPPED, Status.SHADOW)
"""Statuses that answer a request for an emergency stop: the robot has stopped, or cannot be stopped from here."""
INTRODUCTION = {"position_delay", "force_delay", "operator"}
"""Settings that both sides must have sent before the panel describes the session."""


class Console:
    """A session in a browser.

    It never blocks: `watch` only stores, `run` draws the newest state, and actions of the person go out as
    `Handle`, `Settings`, `Choice`, `Stop` and `EmergencyStop`, each in order, from whichever thread notices it.

    Surface and press depth come from `Hello` (settings ``surface`` and ``press_depth`` [m]), the surface from the
    newest valid model once there is one; the sliders begin at the session's delays and faults. With an ``operator``
    other than ``browser`` handle and clutch are hidden. A browser that is gone lets go of both.

    The emergency stop is requested every 50 ms until telemetry reports that the robot has stopped, whatever happens to
    the browser, and whatever is shown. Of several leaders, the one that the robot obeys is shown.

    Args:
        port: TCP port; 0 takes a free one.
        publish: Called with every message that an action causes. It should return at once.
        host: Address to listen on.
        recordings: Folder whose recordings can be looked at, or several.
        live: Whether a session may be received; else there are only recordings, and no emergency stop.
        names: Names of hosts, beside those of this machine, under which a browser may reach it.
        say: Prints one line for people: whenever an address was used, the next one.

    Attributes:
        base: Its address.
        trouble: Reason that a picture could not be drawn, the last time that this happened; "" for never.
        url: The address that lets the next browser in; each does so once.

    Raises:
        MissingExtraError: viser is not installed.
        LinkError: The port is in use, nothing has been started then; or this viser cannot be put behind the gate.
    """

    def __init__(
        self,
        port: int,
        publish: Callable[[Message], None],
        *,
        host: str = "127.0.0.1",
        recordings: Path | str | Sequence[Path | str] = ".",
        names: Sequence[str] = (),
        live: bool = True,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        require_free_port(port, host)
        port = port or free_port(host)
        self._entrance = Entrance(f"http://{host}:{port}", say, names)
        try:
            self._server: Any = make_gated_server(host, port, self._entrance)
        except ImportError:
            raise MissingExtraError("viser", "console") from None
        self.base, self._live = self._entrance.base, live
        self.trouble = self._standing = self._ending = ""  # the last: that it ends, or has ended, in a sentence
        self._watched = Watched()
        self._publisher = Publisher(publish)
        folders = (recordings,) if isinstance(recordings, Path | str) else recordings
        self._library = Library([Path(folder) for folder in folders])
        self._introduced: dict[str, str] = {}  # what the panel was introduced with
        self._press = 0  # the number of the press that is asked for
        self._emergency = EmergencyCall(
            lambda: self._publisher.send(EmergencyStop, reason="pressed in the console", press=self._press)
        )
        self._line = LineView(self._server, self._watched, Hold(self._watched, self._publisher))
        self._panel = Panel(self._server, self._actions(), live=live)
        self._space = SpaceView(self._server, self._panel, SpaceHold(self._watched, self._publisher))
        self._arm = ArmView(self._server, self._panel.whole_arm)
        self._picture: LineView | SpaceView = self._line
        self._camera: tuple[Vector, Vector] = self._line.camera
        self._server.on_client_disconnect(self._browser_gone)
        self._next: dict[str, float] = {}  # when each is due again

    @property
    def url(self) -> str:
        """The address that lets the next browser in."""
        return self._entrance.url

    def watch(self, message: Message) -> None:
        """Take note of one message; costs some microseconds, never waits. Call it from one thread."""
        self._watched.take(message, time.monotonic())
        if isinstance(message, Telemetry) and message.status in ANSWERS and self._emergency.asking:
            self._emergency.answered()

    def run(self, should_stop: Callable[[], bool]) -> None:
        """Draw until `should_stop`, which is called 30 times a second."""
        next_round, drawn = time.monotonic(), -math.inf
        while not should_stop():
            now = time.monotonic()
            if due := bool(self._server.get_clients()) or now - drawn > UNSEEN_PERIOD:
                drawn = now
            self._round(now, due)
            next_round = max(next_round + ROUND_PERIOD, now)
            time.sleep(max(0.0, next_round - time.monotonic()))

    def _round(self, now: float, due: bool) -> None:
        """Keep hold, let a recording go on, and draw where that is due.

        Whatever raises there, the emergency stop stays with all that is urgent, and the next round is tried.
        """
        self._standing = ""
        try:
            self._holding.keep_alive(now)
            self._play_on(now)
            if self._due("look", now, LOOK_PERIOD):
                self._watched.lateness.look()
            if due and self._due("scene", now, 1.0 / self._watched.lateness.pictures - 0.5 * ROUND_PERIOD):
                self._draw(now)
        except Exception as error:
            self.trouble = f"{type(error).__name__}: {one_line(error)}"
            self._standing = f"The picture stands still ({self.trouble}); the stop works."
            self._show_alarm(now)
        if due:
            self._panel.alarm.beat(now, self._watched.lateness.pictures)

    def _due(self, what: str, now: float, period: float) -> bool:
        """Whether something is to be done now, and then after a period [s] again."""
        due = now >= self._next.get(what, 0.0)
        if due:
            self._next[what] = now + period
        return due

    def _play_on(self, now: float) -> None:
        """Let the recording that is looked at go on; one that cannot be shown is looked at no more."""
        playback = self._library.playback
        if playback is None:
            return
        try:
            playback.tick(now)
        except Exception as error:
            self._library.close()
            self._library.note = f"{playback.name} cannot be shown: {type(error).__name__}: {one_line(error)}"
            raise

    def _draw(self, now: float) -> None:
        shown = self._shown.at_once()
        names = self._library.names() if self._due("list", now, LIST_PERIOD) else None
        with self._server.atomic():
            self._draw_scene(shown, self._library.playback is None, useful=not self._hindrance(now))
            if names is not None:
                self._panel.recordings.list(names, self._library.where)
            if self._due("plot", now, PLOT_PERIOD):
                self._plot(shown)
            if self._due("text", now, TEXT_PERIOD):
                self._write(shown, now)
                self._turn()

    def close(self, *, ended: bool = False) -> None:
        """End the server; the pages then show that the session has `ended`, or that they do not reach the console."""
        self._emergency.close()
        if ended:
            self._ending = sentences.ENDED_INSTRUCTION
            self._panel.instruct(sentences.ENDED_INSTRUCTION, "")
            self._draw_scene(self._shown.at_once(), self._library.playback is None, useful=False)
            self._panel.alarm.end(sentences.HAS_ENDED)
            time.sleep(LAST_WORD)
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    # Actions of the person. The viewer calls these from its thread.

    def _actions(self) -> Actions:
        return Actions(
            faults=lambda faults: self._publisher.send(Settings, **faults),
            clutch=self._toggle_clutch,
            end=self._stop,
            emergency=self._press_emergency,
            choose=lambda name, value: self._publisher.send(Choice, **{name: value}),
            record=self._toggle_recording,
            open=self._library.open,
            play=self._toggle_playing,
            seek=self._seek,
            live=self._library.close,
            again=lambda there, back, closed: self._library.run_again(there, back, closed_loop=closed),
            step=self._step,
        )

    def _step(self, way: float) -> None:
        """A stroke of a key moves the hand in by a way [m]; there is none in a recording."""
        if self._library.playback is None and self._by_mouse:
            self._holding.stroke((0.0, 0.0, -way))

    def _toggle_clutch(self, browser: int | None = None) -> None:
        pressed = self._holding.clutched  # one that is pressed is let go of while a recording is looked at, too
        if self._by_mouse and (pressed or self._library.playback is None):
            self._holding.toggle_clutch(browser)
            self._panel.show_clutch(self._holding.clutched)

    async def _browser_gone(self, client: Any) -> None:
        if self._holding.browser_gone(client.client_id):
            self._panel.show_clutch(self._holding.clutched)

    def _toggle_recording(self) -> None:
        if self._watched.supervised(time.monotonic()):
            recording = self._watched.reported("supervisor", "recording")
            self._publisher.send(Choice, record="stop" if recording else "start")

    def _toggle_playing(self) -> None:
        if (playback := self._library.playback) is not None:
            playback.play(not playback.playing)

    def _seek(self, now: float) -> None:
        if (playback := self._library.playback) is not None:
            playback.play(False)
            playback.go_to(now)

    def _stop(self) -> None:
        self._ending = sentences.ENDING_INSTRUCTION
        self._publisher.send(Stop, reason="ended in the console")
        self._panel.session.ending()

    def _press_emergency(self) -> None:
        if not self._live:
            return
        if not self._emergency.asking:
            self._press = new_press()
        self._emergency.press()
        self._show_alarm(time.monotonic())

    # Display of the session, or of a recording.

    @property
    def _shown(self) -> Watched:
        return self._library.playback or self._watched

    def _picture_of(self, watched: Watched) -> LineView | SpaceView:
        return self._line if watched.leader_space is NOWHERE else self._space

    @property
    def _holding(self) -> Hold:
        return self._picture_of(self._watched).hold

    @property
    def _by_mouse(self) -> bool:
        return self._live and self._watched.operator == "browser"

    def _hindrance(self, now: float) -> str:
        return self._ending or (sentences.hindrance(self._watched, now) if self._live else CHOOSE_RECORDING)

    def _draw_scene(self, shown: Watched, live: bool, *, useful: bool = True) -> None:
        before, self._picture = self._picture, self._picture_of(shown)
        if self._picture is not before:  # sessions along a line and in space take turns
            before.show(False)
            self._picture.show(True)
        self._picture.draw(shown, live=live and self._live, useful=useful)  # without a session there is no handle
        self._arm.draw(shown)
        camera = self._arm.camera or self._picture.camera
        if camera is not self._camera:
            self._camera = camera
            look(self._server, camera)

    def _turn(self) -> None:
        """Give the camera of this picture to a page that loaded while it changed, and began with that of the other."""
        others = [one.camera[0] for one in (self._line, self._space) if one.camera is not self._camera]
        for client in self._server.get_clients().values():
            if any(math.dist(client.camera.position, other) < 1e-3 for other in others):
                client.camera.position, client.camera.look_at = self._camera

    def _plot(self, shown: Watched) -> None:
        playback = self._library.playback
        other = None if playback is None or playback.other is None else playback.other.window(SECONDS)
        self._panel.forces.plot(shown.window(SECONDS), other)
        self._picture.plot(shown)

    def _write(self, shown: Watched, now: float) -> None:
        """Numbers, labels, the other plots, and where the sliders begin."""
        playback, panel = self._library.playback, self._panel
        other = None if playback is None else playback.other
        window = shown.window(SECONDS)
        status = self._status(now) if playback is None else "A recording is shown; see the tab Recordings."
        missing = self._picture.problem, self._arm.problem
        notes = tuple(filter(None, (*missing, *sentences.warnings(self._watched, now))))
        depth, ahead = self._picture.depth(shown), self._picture.ahead
        panel.forces.write(numbers_html(shown, window, other, depth=depth, status=status, warnings=notes, ahead=ahead))
        panel.network.draw(window, shown.loss_trace(SECONDS, now), shown.model_age, shown.setting("budget", 0.0))
        panel.network.show_stages(now, shown.rows, shown.settings)
        panel.energy.draw(window)
        lines = () if shown.model is None else describe(shown.model)
        panel.models.draw(shown.model_trace(SECONDS), shown.model_depth, lines)
        panel.recordings.show(playback, self._library.note, self._library.busy)
        put(panel.banner, content=banner_html(playback, sentences.lateness(self._watched), live=self._live))
        self._show_session(now)
        self._show_alarm(now)
        self._picture.write(shown, now)

    def _show_session(self, now: float) -> None:
        """Show the running session and what there is to do; set the sliders when both sides have sent new values."""
        watched, settings = self._watched, self._watched.settings
        live = self._library.playback is None
        supervised = watched.supervised(now)
        self._library.being_written = watched.reported("supervisor", "recording") if supervised else ""
        self._panel.session.show(
            {name: settings[name] for name in CHOICES if name in settings},
            offered=supervised and live and not self._ending,
            recording=self._library.being_written,
            refused=watched.reported("supervisor", "refused"),
        )
        self._panel.network.offer(live)
        shown = self._shown
        by_mouse = self._live and shown.operator == "browser"  # which hand the force moves
        put(self._panel.clutch, visible=self._by_mouse and live)
        possible = self._picture.instruction if by_mouse else f"Watch the {shown.operator} operator press."
        instruction = (self._hindrance(now) or possible) if live else WATCH_RECORDING
        self._panel.instruct(instruction, felt(shown.grip, by_mouse))
        if settings.keys() >= INTRODUCTION:
            texts = {name: settings.get(name, "") for name in SLIDERS}
            new = dict(texts.items() - self._introduced.items())
            self._introduced = texts
            self._panel.network.put({name: watched.setting(name, 0.0) for name in new})

    def _show_alarm(self, now: float) -> None:
        status = self._watched.status
        label = LATCHED if status == Status.STOPPED else UNABLE if status == Status.SHADOW else READY
        alerts = (*(sentences.robot_alerts(self._watched, now) if self._live else ()), self._standing)
        self._panel.alarm.show(ASKING if self._emergency.asking else label, tuple(filter(None, alerts)))

    def _status(self, now: float) -> str:
        if self._ending or not self._live:
            return self._ending or sentences.NOTHING_LIVE
        return sentences.session_status(self._watched, now, held=self._holding.held, clutched=self._holding.clutched)
