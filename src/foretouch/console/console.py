"""The console: watches a session, and lets a person press, set the delays and stop."""

from __future__ import annotations

import contextlib
import io
import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from foretouch.console.description import describe
from foretouch.console.history import History, Window
from foretouch.console.panel import INSTRUCTION, Numbers, Panel, felt
from foretouch.console.ports import free_port, require_free_port
from foretouch.console.scene import UNITS, Scene
from foretouch.console.shapes import HANDLE_HEIGHT
from foretouch.devices import GRIPS, INTENDED_FORCE
from foretouch.errors import LinkError, MissingExtraError
from foretouch.messages import VERSION, Handle, Hello, LeaderState, Message, ModelUpdate, Settings, Stop, Telemetry

__all__ = ["Console"]

SCENE_PERIOD, PLOT_PERIOD, TEXT_PERIOD = 1 / 30, 1 / 12, 1 / 6
"""How often scene, plot and numbers are sent to the browser [s]."""
KEEP_ALIVE = 0.1
"""A held handle says where it is at least this often [s], so that silence means a lost browser."""
NAMES = ("material", "model", "estimator")
"""Settings that stand in the panel."""
DEEPEST = 1.2
"""How far the handle goes below the surface, in press depths."""
NO_GRIP, SMALLEST_SCALE = "none", 1e-3
"""The grip of an operator whose hand the force does not move, and a bound on the position scale."""
INTRODUCTION = {"position_delay", "force_delay", "operator"}
"""Settings that both sides must have said before the panel speaks of the session."""
SURFACE, PRESS_DEPTH = 0.012, 0.01
"""Surface position and depth of presses [m] until the session says its own."""


class Console:
    """A session in a browser.

    It stands in nobody's way: `watch` only stores, `run` draws what is newest, and what the person does goes out as
    `Handle`, `Settings` and `Stop`, each in order, from whichever thread notices it.

    While nobody drags the handle it is where the operator's hand wants to be. It is drawn in the probe's frame, from 0
    to 1.2 times the press depth below the surface; a drag moves the hand from where it was when it was taken, by the
    drag over the position scale, so that index and clutch, which part hand and probe, are no hindrance. Surface and
    press depth come from `Hello` (settings ``surface`` and ``press_depth`` [m]), the surface from the newest valid
    model once there is one; the sliders begin at the session's ``position_delay`` and ``force_delay`` [s]. With an
    ``operator`` other than ``browser`` handle and clutch are hidden.

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
        self._handle = 0.0  # the handle as drawn, in the probe's frame [m]
        self._hand = 0.0  # where it asks the hand to be, in the hand's own [m]
        self._handle_sent = 0.0
        self._stopped = False
        self._history = History()
        self._leader: LeaderState | None = None
        self._telemetry: Telemetry | None = None
        self._model: ModelUpdate | None = None
        self._settings: dict[str, str] = {}
        self._introduced = False
        self._heard = self._heard_before = 0
        self._silent_since = -math.inf
        port = port or free_port(host)
        with contextlib.redirect_stdout(io.StringIO()):  # viser greets on stdout, which belongs to the report
            self._server: Any = viser.ViserServer(host=host, port=port, verbose=False)
        if self._server.get_port() != port:  # taken in between: viser would go on with the next one
            self._server.stop()
            raise LinkError(f"port {port} on {host} is in use: choose another with --port")
        self.url = f"http://{host}:{port}"
        self._scene = Scene(self._server, self._dragged)
        self._panel = Panel(self._server, self._set_delays, self._toggle_clutch, self._stop)

    def watch(self, message: Message) -> None:
        """Take note of one message; costs some microseconds, never waits. Call it from one thread."""
        self._heard += 1
        if isinstance(message, LeaderState):
            self._history.add_leader(message)
            self._leader = message
        elif isinstance(message, Telemetry):
            self._history.add_telemetry(message)
            self._telemetry = message
        elif isinstance(message, ModelUpdate):
            self._model = message
        elif isinstance(message, Hello):
            self._settings = {**self._settings, **dict(zip(message.names, message.values, strict=False))}

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
                    window = self._history.window()
                    self._panel.plot(window)
                    if now >= next_text:
                        next_text = now + TEXT_PERIOD
                        self._write(window, now)
            next_scene = max(next_scene + SCENE_PERIOD, now)
            time.sleep(max(0.0, next_scene - time.monotonic()))

    def close(self) -> None:
        """End the server; browsers show that the connection is gone."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    # What the person does. The viewer calls these from its own thread.

    def _dragged(self, z: float, held: bool) -> None:
        """The handle was moved to a height [scene units]."""
        surface = self._surface()
        with self._lock:
            self._held = held
            handle = min(max(surface - (z - HANDLE_HEIGHT) / UNITS, 0.0), self._deepest())
            self._hand += (handle - self._handle) / self._scale()
            self._handle = handle
            self._scene.hold_at((surface - self._handle) * UNITS + HANDLE_HEIGHT)
            self._send_handle()

    def _toggle_clutch(self) -> None:
        """The clutch was pressed or let go."""
        with self._lock:
            self._clutched = not self._clutched
            self._send_handle()
        self._panel.show_clutch(self._clutched)

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
            self._publish(Stop(*self._stamp(Stop), reason="the stop button of the console was pressed"))
        self._panel.stopping()

    def _stamp(self, kind: type[Message]) -> tuple[int, int, int]:
        """What every message begins with."""
        self._sequences[kind] = self._sequences.get(kind, 0) + 1
        return VERSION, self._sequences[kind], time.monotonic_ns()

    # What the session says.

    def _surface(self) -> float:
        """Position of the surface [m], as well as it is known."""
        model = self._model
        if model is not None and model.valid and math.isfinite(model.surface):
            return model.surface
        return self._setting("surface", SURFACE)

    def _operator(self) -> str:
        """Who moves the leader's hand: a handle is of use to the operator ``browser`` alone."""
        return self._settings.get("operator", "browser")

    def _grip(self) -> str:
        """How the hand holds the device that the force moves; empty where the force moves nothing."""
        grip = self._settings.get("grip", NO_GRIP)
        return "" if grip == NO_GRIP else grip

    def _scale(self) -> float:
        """Probe's motion for the hand's."""
        return max(self._setting("position_scale", 1.0), SMALLEST_SCALE)

    def _hand_ahead(self) -> float:
        """How much further in the hand is than the probe, in the probe's lengths [m]; NaN where no force moves it."""
        leader = self._leader
        if leader is None or not self._grip():
            return math.nan
        return self._scale() * leader.hand_position - leader.position

    def _deepest(self) -> float:
        """Bound of the handle [m]: a hand that the force moves has to want more than it gets."""
        grip = GRIPS.get(self._grip())
        more = 0.0 if grip is None else self._scale() * INTENDED_FORCE / grip.stiffness
        return self._surface() + DEEPEST * (self._setting("press_depth", PRESS_DEPTH) + more)

    def _setting(self, name: str, otherwise: float) -> float:
        """A number among the session's settings, or another where there is none."""
        try:
            value = float(self._settings.get(name, otherwise))
        except ValueError:
            return otherwise
        return value if math.isfinite(value) else otherwise

    def _robot_position(self) -> float:
        """Where the operator's side last saw the robot [m]; NaN before."""
        if self._leader is not None:
            position = self._history.follower_position(self._leader.telemetry_sequence)
            if math.isfinite(position):
                return position
        return math.nan if self._telemetry is None else self._telemetry.position

    def _draw_scene(self) -> None:
        surface, leader = self._surface(), self._leader
        position = 0.0 if leader is None or math.isnan(leader.position) else leader.position
        self._follow_hand(position)
        z = (surface - position) * UNITS
        robot = self._robot_position()
        rendered, delayed = (0.0, 0.0) if leader is None else (leader.rendered_force, leader.delayed_force)
        self._scene.set_travel(round((surface - self._deepest()) * UNITS, 1), round(surface * UNITS, 1))
        self._scene.draw(z, (surface - robot) * UNITS, rendered, delayed)
        self._scene.draw_handle((surface - self._handle) * UNITS + HANDLE_HEIGHT)
        self._scene.draw_hand(z, self._hand_ahead() * UNITS)

    def _follow_hand(self, position: float) -> None:
        """While nobody holds the handle: it is as far ahead of the probe as the hand wants to go."""
        leader = self._leader
        with self._lock:
            if self._held:
                return
            self._handle = self._hand = position
            if leader is not None and math.isfinite(leader.hand_position):
                intended = leader.intended_position
                self._hand = intended if math.isfinite(intended) else leader.hand_position
                self._handle += self._scale() * (self._hand - leader.hand_position)

    def _write(self, window: Window, now: float) -> None:
        """Numbers, labels, and where the sliders begin."""
        leader = self._leader
        known = np.flatnonzero(np.isfinite(window.true))
        true, age = (window.true[known[-1]], -window.time[known[-1]]) if len(known) else (math.nan, math.nan)
        numbers = Numbers(
            predicted=math.nan if leader is None else leader.predicted_force,
            delayed=math.nan if leader is None else leader.delayed_force,
            true=float(true),
            true_age=float(age),
            rendered=math.nan if leader is None else leader.rendered_force,
            depth=0.0 if leader is None else leader.position - self._surface(),
            prediction_error=window.prediction_error,
            delayed_error=window.delayed_error,
            status=self._status(now),
            names=" · ".join(self._settings[name] for name in NAMES if name in self._settings),
            deviation=math.nan if leader is None else leader.standard_deviation,
            model=() if self._model is None else describe(self._model),
            hand_ahead=self._hand_ahead(),
            energy=math.nan if leader is None or not self._grip() else leader.energy,
        )
        self._panel.write(numbers)
        self._scene.label(
            "Let go and the script goes on" if self._held else "Drag me down to press",
            "" if leader is None else f"rendered: {leader.rendered_force:.2f} N",
            "" if leader is None else f"delayed robot: {leader.delayed_force:.2f} N" + self._guarded(", holds back"),
        )
        if not self._introduced and self._settings.keys() >= INTRODUCTION:
            self._introduced = True
            self._introduce()

    def _introduce(self) -> None:
        """Put sliders and texts to what the session is, once both sides have said so."""
        self._panel.set_delays(self._setting("position_delay", 0.0), self._setting("force_delay", 0.0))
        by_mouse = self._operator() == "browser"
        if not by_mouse:
            self._scene.offer_handle(False)
            self._panel.offer_clutch(False)
        instruction = INSTRUCTION if by_mouse else f"Watch the {self._operator()} operator press."
        self._panel.instruct(instruction, felt(self._grip(), by_mouse))

    def _guarded(self, text: str) -> str:
        """A text where the robot holds back from a first touch, else nothing."""
        return text if self._telemetry is not None and self._telemetry.guarded else ""

    def _status(self, now: float) -> str:
        """One line: what the session is doing."""
        if self._heard != self._heard_before:
            self._heard_before, self._silent_since = self._heard, now
        if self._stopped:
            return "Stopping the session."
        if self._heard == 0:
            return "Waiting for the session."
        if now - self._silent_since > 1.0:
            return "The session has gone silent."
        if self._operator() != "browser":
            doing = f"The {self._operator()} operator presses."
        else:
            doing = "You press." if self._held else "A script presses until you take the handle."
        if self._clutched:
            doing = "The clutch is pressed: the hand moves alone, the robot stays."
        doing += self._guarded(" The robot holds back until its surface is known here.")
        model = self._model
        if model is None or not model.valid:
            doing += " No force yet: " + (model.reason if model and model.reason else "no model has arrived.")
        return doing
