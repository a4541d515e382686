"""The console: watches a session, and lets a person press, set the delays, stop the robot and end the session."""

from __future__ import annotations

import contextlib
import io
import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from foretouch.console.alarm import ASKING, LATCHED, READY, UNABLE
from foretouch.console.description import describe
from foretouch.console.emergency import EmergencyCall
from foretouch.console.history import Window
from foretouch.console.panel import INSTRUCTION, Numbers, Panel, felt
from foretouch.console.ports import free_port, require_free_port
from foretouch.console.scene import UNITS, Scene
from foretouch.console.sentences import doing, robot_alerts, warnings
from foretouch.console.shapes import HANDLE_HEIGHT
from foretouch.console.watched import GONE, Watched
from foretouch.errors import LinkError, MissingExtraError
from foretouch.link import new_press
from foretouch.messages import VERSION, EmergencyStop, Handle, Message, Settings, Status, Stop, Telemetry

__all__ = ["Console"]

SCENE_PERIOD, PLOT_PERIOD, TEXT_PERIOD = 1 / 30, 1 / 12, 1 / 6
"""How often scene, plot and numbers are sent to the browser [s]."""
KEEP_ALIVE = 0.1
"""A held handle says where it is at least this often [s], so that silence means a lost browser."""
NAMES = ("material", "model", "estimator")
"""Settings that stand in the panel."""
ANSWERS = (Status.STOPPED, Status.SHADOW)
"""After these nobody has to ask for an emergency stop any more: it is there, or not to be had."""
INTRODUCTION = {"position_delay", "force_delay", "operator"}
"""Settings that both sides must have said before the panel speaks of the session."""


class Console:
    """A session in a browser.

    It stands in nobody's way: `watch` only stores, `run` draws what is newest, and what the person does goes out as
    `Handle`, `Settings`, `Stop` and `EmergencyStop`, each in order, from whichever thread notices it.

    While nobody drags the handle it is where the operator's hand wants to be. It is drawn in the probe's frame, from 0
    to 1.2 times the press depth below the surface; a drag moves the hand from where it was when it was taken, by the
    drag over the position scale, so that index and clutch, which part hand and probe, are no hindrance. Surface and
    press depth come from `Hello` (settings ``surface`` and ``press_depth`` [m]), the surface from the newest valid
    model once there is one; the sliders begin at the session's ``position_delay`` and ``force_delay`` [s]. With an
    ``operator`` other than ``browser`` handle and clutch are hidden. A browser that is gone lets go of both.

    The emergency stop is asked for every 50 ms until telemetry says that the robot has stopped, whatever becomes of the
    browser. Of several leaders the one is shown that the robot obeys.

    Args:
        port: TCP port; 0 takes a free one.
        publish: Called with every message that the person causes. It should return at once.
        host: Address to listen on.

    Attributes:
        url: Where the browser finds it.

    Raises:
        MissingExtraError: viser is not installed.
        LinkError: The port is in use; nothing has been started then.
    """

    def __init__(self, port: int, publish: Callable[[Message], None], *, host: str = "127.0.0.1") -> None:
        require_free_port(port, host)
        try:
            import viser
        except ImportError:
            raise MissingExtraError("viser", "console") from None
        self._publish = publish
        self._lock = threading.Lock()  # over what a person does, so that it goes out in order
        self._sequences: dict[type[Message], int] = {}
        self._held = False
        self._clutched = False
        self._clutcher: int | None = None  # the browser that pressed the clutch
        self._handle = 0.0  # the handle as drawn, in the probe's frame [m]
        self._hand = 0.0  # where it asks the hand to be, in the hand's own [m]
        self._handle_sent = 0.0
        self._stopped = False
        self._watched = Watched()
        self._introduced = False
        port = port or free_port(host)
        with contextlib.redirect_stdout(io.StringIO()):  # viser greets on stdout, which belongs to the report
            self._server: Any = viser.ViserServer(host=host, port=port, verbose=False)
        if self._server.get_port() != port:  # taken in between: viser would go on with the next one
            self._server.stop()
            raise LinkError(f"port {port} on {host} is in use: choose another with --port")
        self.url = f"http://{host}:{port}"
        self._press = 0  # the number of the press that is asked for
        self._emergency = EmergencyCall(self._ask_to_stop)
        self._scene = Scene(self._server, self._take_handle, self._dragged)
        self._panel = Panel(self._server, self._set_delays, self._toggle_clutch, self._stop, self._press_emergency)
        self._server.on_client_disconnect(self._browser_gone)

    def watch(self, message: Message) -> None:
        """Take note of one message; costs some microseconds, never waits. Call it from one thread."""
        self._watched.take(message, time.monotonic())
        if self._emergency.asking and isinstance(message, Telemetry) and message.status in ANSWERS:
            self._emergency.answered()

    def run(self, should_stop: Callable[[], bool]) -> None:
        """Draw until told to stop.

        Args:
            should_stop: Asked before every picture, 30 times a second.
        """
        next_scene = next_plot = next_text = time.monotonic()
        while not should_stop():
            now = time.monotonic()
            self._keep_alive(now)
            with self._server.atomic():
                self._draw_scene()
                if now >= next_plot:
                    next_plot = now + PLOT_PERIOD
                    window = self._watched.history.window()
                    self._panel.plot(window)
                    if now >= next_text:
                        next_text = now + TEXT_PERIOD
                        self._write(window, now)
            next_scene = max(next_scene + SCENE_PERIOD, now)
            time.sleep(max(0.0, next_scene - time.monotonic()))

    def close(self) -> None:
        """End the server; browsers show that the connection is gone."""
        self._emergency.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    # What the person does. The viewer calls these from its own thread.

    def _take_handle(self) -> float:
        """A drag begins: the handle, which may be a picture old, is where it is now [scene units]."""
        self._follow_hand()
        return self._handle_height()

    def _dragged(self, z: float, held: bool) -> None:
        """The handle was moved to a height [scene units]."""
        surface = self._watched.surface
        with self._lock:
            self._held = held
            handle = min(max(surface - (z - HANDLE_HEIGHT) / UNITS, 0.0), self._watched.deepest)
            self._hand += (handle - self._handle) / self._watched.scale
            self._handle = handle
            self._scene.hold_at(self._handle_height())
            self._send_handle()

    def _toggle_clutch(self, browser: int | None = None) -> None:
        """The clutch was pressed, or let go, in this browser."""
        with self._lock:
            self._clutched = not self._clutched
            self._clutcher = browser
            self._send_handle()
        self._panel.show_clutch(self._clutched)

    async def _browser_gone(self, client: Any) -> None:
        """A browser that is gone holds no clutch; a drag of it the viewer ends."""
        if self._clutched and self._clutcher == client.client_id:
            self._toggle_clutch()

    def _keep_alive(self, now: float) -> None:
        with self._lock:
            if (self._held or self._clutched) and now - self._handle_sent > KEEP_ALIVE:
                self._send_handle()

    def _send_handle(self) -> None:
        self._handle_sent = time.monotonic()
        self._publish(Handle(*self._stamp(Handle), position=self._hand, held=self._held, clutched=self._clutched))

    def _set_delays(self, position_delay: float, force_delay: float) -> None:
        with self._lock:
            self._publish(Settings(*self._stamp(Settings), position_delay=position_delay, force_delay=force_delay))

    def _stop(self) -> None:
        with self._lock:
            self._stopped = True
            self._publish(Stop(*self._stamp(Stop), reason="ended in the console"))
        self._panel.ending()

    def _press_emergency(self) -> None:
        if not self._emergency.asking:
            self._press = new_press()
        self._emergency.press()
        self._show_alarm(time.monotonic())

    def _ask_to_stop(self) -> None:
        with self._lock:
            self._publish(
                EmergencyStop(*self._stamp(EmergencyStop), reason="pressed in the console", press=self._press)
            )

    def _stamp(self, kind: type[Message]) -> tuple[int, int, int]:
        """What every message begins with."""
        self._sequences[kind] = self._sequences.get(kind, 0) + 1
        return VERSION, self._sequences[kind], time.monotonic_ns()

    # What the session says.

    def _handle_height(self) -> float:
        """Of the handle as drawn [scene units]."""
        return (self._watched.surface - self._handle) * UNITS + HANDLE_HEIGHT

    def _draw_scene(self) -> None:
        watched, leader = self._watched, self._watched.leader
        self._follow_hand()
        surface, position = watched.surface, watched.probe_position
        z = (surface - position) * UNITS
        rendered, delayed = (0.0, 0.0) if leader is None else (leader.rendered_force, leader.delayed_force)
        self._scene.set_travel(round((surface - watched.deepest) * UNITS, 1), round(surface * UNITS, 1))
        self._scene.draw(z, (surface - watched.robot_position) * UNITS, rendered, delayed)
        self._scene.draw_handle(self._handle_height())
        self._scene.draw_hand(z, watched.hand_ahead * UNITS)

    def _follow_hand(self) -> None:
        """While nobody holds the handle: it is as far ahead of the probe as the hand wants to go."""
        leader, position = self._watched.leader, self._watched.probe_position
        with self._lock:
            if self._held:
                return
            self._handle = self._hand = position
            if leader is not None and math.isfinite(leader.hand_position):
                intended = leader.intended_position
                self._hand = intended if math.isfinite(intended) else leader.hand_position
                self._handle += self._watched.scale * (self._hand - leader.hand_position)

    def _write(self, window: Window, now: float) -> None:
        """Numbers, labels, and where the sliders begin."""
        watched, leader = self._watched, self._watched.leader
        known = np.flatnonzero(np.isfinite(window.true))
        true, age = (window.true[known[-1]], -window.time[known[-1]]) if len(known) else (math.nan, math.nan)
        numbers = Numbers(
            predicted=math.nan if leader is None or math.isnan(leader.position) else leader.predicted_force,
            delayed=math.nan if leader is None else leader.delayed_force,
            true=float(true),
            true_age=float(age),
            rendered=math.nan if leader is None else leader.rendered_force,
            depth=0.0 if leader is None else leader.position - watched.surface,
            prediction_error=window.prediction_error,
            delayed_error=window.delayed_error,
            status=self._status(now),
            names=" · ".join(watched.settings[name] for name in NAMES if name in watched.settings),
            deviation=math.nan if leader is None else leader.standard_deviation,
            model=() if watched.model is None else describe(watched.model),
            hand_ahead=watched.hand_ahead,
            energy=math.nan if leader is None or not watched.grip else leader.energy,
            warnings=warnings(watched, now),
        )
        self._panel.write(numbers)
        self._show_alarm(now)
        self._scene.label(
            "Let go and the script goes on" if self._held else "Drag me down to press",
            "" if leader is None else f"rendered: {leader.rendered_force:.2f} N",
            "" if leader is None else f"delayed robot: {leader.delayed_force:.2f} N" + self._guarded(", holds back"),
        )
        if not self._introduced and watched.settings.keys() >= INTRODUCTION:
            self._introduced = True
            self._introduce()

    def _introduce(self) -> None:
        """Put sliders and texts to what the session is, once both sides have said so."""
        self._panel.set_delays(self._watched.setting("position_delay", 0.0), self._watched.setting("force_delay", 0.0))
        by_mouse = self._watched.operator == "browser"
        if not by_mouse:
            self._scene.offer_handle(False)
            self._panel.offer_clutch(False)
        instruction = INSTRUCTION if by_mouse else f"Watch the {self._watched.operator} operator press."
        self._panel.instruct(instruction, felt(self._watched.grip, by_mouse))

    def _show_alarm(self, now: float) -> None:
        """How far an emergency stop is, and what is urgent."""
        watched = self._watched
        label = LATCHED if watched.stopped else UNABLE if watched.shadowed else READY
        self._panel.alarm.show(ASKING if self._emergency.asking else label, robot_alerts(watched, now))

    def _guarded(self, text: str) -> str:
        """A text where the robot holds back from a first touch, else nothing."""
        return text if self._watched.telemetry is not None and self._watched.telemetry.guarded else ""

    def _status(self, now: float) -> str:
        """One line: what the session is doing."""
        watched, model = self._watched, self._watched.model
        if self._stopped:
            return "The session ends."
        if watched.heard == -math.inf:
            return "Waiting for the session."
        if now - watched.heard > GONE:
            return "The session has gone silent."
        if watched.stopped:
            said = "The robot is stopped: nobody moves it."
        elif self._clutched:
            said = "The clutch is pressed: the hand moves alone, the robot stays."
        elif watched.operator != "browser":
            said = f"The {watched.operator} operator presses."
        else:
            said = "You press." if self._held else "A script presses until you take the handle."
        if model is None or not model.valid:
            reason = model.reason if model and model.reason else "no model has arrived."
            return " ".join((said, *doing(watched), f"No force yet: {reason}"))
        return " ".join((said, *doing(watched)))
