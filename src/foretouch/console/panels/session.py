"""The session: its network's delays and faults, what it is made of and its end; all messages that the console sends."""

from __future__ import annotations

import functools
import html
import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.console.history import LossTrace, Window
from foretouch.console.plots import Curve, Row, TimePlot, by_person, handler, inset, number, put, table
from foretouch.console.sentences import NOTHING_LIVE
from foretouch.devices import GRIPS, OPERATORS
from foretouch.messages import VERSION, Message
from foretouch.quantities import Rows
from foretouch.quantities.colours import BLUE, GREY, INK, VERMILLION, Colour, css
from foretouch.robot import MATERIALS
from foretouch.session.latency import HALVES, IN_THE_LOOP, STAGES, latency_figures
from foretouch.settings import NO_GRIP

STAGED_EVERY = 3.0  # Time between two looks at the stages of the loop [s]
LONGEST_DELAY = 2.0  # End of the sliders of delays [s]
OWN = 2.0  # Time for which a slider that was moved stays as it is [s], until the session sends the new value too
TRIP = Curve("Round trip: age of the answer", INK, 2.0)
THERE = Curve("Lost on the way there", BLUE, 2.0)
BACK = Curve("Lost on the way back", VERMILLION, 2.0, "dashed")


SLIDERS = {
    "position_delay": ("Delay there [s]", LONGEST_DELAY, 0.01, "One-way delay of your positions to the robot"),
    "force_delay": ("Delay back [s]", LONGEST_DELAY, 0.01, "One-way delay of models and measured forces"),
    "jitter": ("Jitter ± [s]", 0.5, 0.005, "Largest change of either delay, drawn for each message"),
    "loss": ("Loss [ratio]", 0.9, 0.01, "Ratio of messages that are lost, either way"),
    "outage": ("Outage [s]", 5.0, 0.1, "In every 10 s all messages are lost for this time"),
}
"""Of each fault: the label, the end of its slider, its step and what it is."""


STALL = "Longest time without an answer"
LEAST_STALL = 0.02  # Time without an answer that is no stall [s]


def longest_stall(time: NDArray[np.float64], round_trip: NDArray[np.float64]) -> float:
    """The longest time over which the answer only grew older [s]; 0 where there is none."""
    longest, begin = 0.0, 0
    older = np.diff(round_trip) > 0.9 * np.diff(time)
    for end in [*np.flatnonzero(~older).tolist(), len(time) - 1]:
        longest = max(longest, float(time[end] - time[begin])) if end > begin else longest
        begin = end + 1
    return longest if longest >= LEAST_STALL else 0.0


class NetworkPanel:
    """Sliders, and below them delay and loss as measured; `on_faults` gets all of them when a person moves one."""

    def __init__(self, gui: Any, on_faults: Callable[[Mapping[str, float]], None]) -> None:
        self._on_faults = on_faults
        self._moved = -math.inf
        self._sliders = {
            name: gui.add_slider(label, 0.0, end, step, 0.0, hint=hint)
            for name, (label, end, step, hint) in SLIDERS.items()
        }
        for slider in self._sliders.values():
            slider.on_update(by_person(self._slid))
        self._trip = TimePlot(gui, "Round trip as measured [ms]", (TRIP,), height=120)
        self._text = gui.add_html("")
        self._loss = TimePlot(gui, "Messages lost [%]", (THERE, BACK), height=120)
        self._stages, self._staged = gui.add_html(""), -math.inf

    def put(self, faults: Mapping[str, float]) -> None:
        """Put sliders where the session is, without telling the session."""
        if time.monotonic() - self._moved < OWN:
            return  # the session will confirm its new value
        for name, value in faults.items():
            self._sliders[name].value = min(max(value, 0.0), SLIDERS[name][1])

    def offer(self, offered: bool) -> None:
        """Let the sliders be moved, or not, as while a recording is played."""
        for slider in self._sliders.values():
            slider.disabled = not offered

    def draw(self, window: Window, losses: LossTrace, model_age: float, budget: float) -> None:
        """Draw and write what is measured; age of the model that is felt [s], and bytes a second that may be sent."""
        trips = window.round_trip * 1e3
        self._trip.draw(window.time, (trips,))
        self._loss.draw(losses.time, (losses.there, losses.back), most=100.0)
        rows = [Row(TRIP.name, number(_last(trips[np.isfinite(trips)]), "ms", 0), TRIP)]
        for curve, percent in ((THERE, losses.there), (BACK, losses.back)):
            rows.append(Row(curve.name, number(_last(percent), "%", 1), curve))
        rows.append(Row("Model that is felt: its age", number(model_age, "s", 1)))
        rows.append(Row(STALL, number(longest_stall(window.time, window.round_trip), "s", 2)))
        for way, sent in zip(("there", "back"), losses.sent, strict=True):
            if math.isfinite(sent):
                rows.append(Row(f"Sent {way} [bytes/s], of {budget:,.0f}", f"{sent:,.0f}"))
        put(self._text, content=inset(table(rows)))

    def show_stages(self, now: float, rows: Callable[[], tuple[Rows, Rows]], settings: Mapping[str, str]) -> None:
        """Write where the time of the loop goes, every few seconds: it is the work of some milliseconds."""
        if now - self._staged < STAGED_EVERY:
            return
        self._staged = now
        found = latency_figures(*rows(), settings)
        put(self._stages, content=inset(stages_html(found)))

    def _slid(self, event: Any) -> None:
        self._moved = time.monotonic()
        self._on_faults({name: float(slider.value) for name, slider in self._sliders.items()})


STAGES_TITLE = "Where the time goes, hand to answer (medians)"
BESIDE = "Beside it: the answer does not wait for these"
GUESSED = "The clocks of both machines differ: the ways there and back are guessed"


def stages_html(found: Mapping[str, Any]) -> str:
    """The stages of the loop one behind the other, their sum, and what is beside the loop, of `latency_figures`.

    Each bar begins where that before it ends, so that the longest is seen before a number is read.
    """
    medians = found["stages_ms"]
    whole = max(found["sum_ms"] or 0.0, found["loop_ms"] or 0.0, 1e-6)  # what the bars' column is worth [ms]
    rows, begin = [], 0.0
    for name in IN_THE_LOOP:
        rows.append(_stage(name.replace("_", " "), medians[name], (begin / whole, BLUE, whole), STAGES[name]))
        begin += medians[name] or 0.0
    line = f";border-top:1px solid {css(GREY)}"
    rows.append(_stage("sum", found["sum_ms"], (0.0, INK, whole), "of the stages above", line))
    rows.append(_stage("by the motion", found["loop_ms"], (0.0, INK, whole), "the same, measured without any clock"))
    rows.append(f'<tr><td colspan="3" style="padding-top:6px;color:#555">{BESIDE}</td></tr>')
    rows += [
        _stage(name, medians[name], (0.0, GREY, whole), STAGES[name]) for name in STAGES if name not in IN_THE_LOOP
    ]
    if found["clocks"] == HALVES:
        rows.append(f'<tr><td colspan="3" style="padding-top:6px">{GUESSED}</td></tr>')
    return (
        f'<div style="text-align:center;font-size:13px;padding:8px 0 4px 0">{STAGES_TITLE}</div>'
        '<table class="foretouch-table" style="width:100%;table-layout:fixed;font-variant-numeric:tabular-nums;'
        'border-spacing:0;line-height:1.35"><colgroup><col style="width:30%"><col style="width:48%">'
        f'<col style="width:22%"></colgroup>{"".join(rows)}</table>'
    )


def _stage(name: str, value: float | None, bar: tuple[float, Colour, float], what: str, looks: str = "") -> str:
    """A line: the name, its bar (where it begins as a ratio, its colour, what the column is worth [ms]), the number."""
    begin, colour, whole = bar
    width = 100.0 * min((value or 0.0) / whole, 1.0 - min(begin, 1.0))
    drawn = (
        ""
        if value is None
        else (
            f'<div style="margin-left:{100.0 * begin:.1f}%;width:max({width:.1f}%, 2px);height:10px;'
            f'background:{css(colour)}"></div>'
        )
    )
    digits = 0 if (value or 0.0) >= 100.0 else 1 if (value or 0.0) >= 1.0 else 2
    text = number(math.nan if value is None else value, "ms", digits)
    return (
        f'<tr title="{html.escape(what)}"><td style="white-space:nowrap{looks}">{name}</td><td style="{looks[1:]}">'
        f'{drawn}</td><td style="text-align:right;white-space:nowrap{looks}"><b>{text}</b></td></tr>'
    )


def _last(values: np.ndarray) -> float:
    return float(values[-1]) if len(values) else math.nan


class Publisher:
    """Numbers the messages of each kind and publishes them, in order, from whichever thread causes them."""

    def __init__(self, publish: Callable[[Message], None]) -> None:
        self._publish = publish
        self._lock = threading.Lock()
        self._sequences: Counter[type[Message]] = Counter()

    def send(self, kind: type[Message], **fields: Any) -> None:
        """Send a message of a kind with these fields beside those that every message begins with."""
        with self._lock:
            self._sequences[kind] += 1
            self._publish(kind(VERSION, self._sequences[kind], time.monotonic_ns(), **fields))


END = "End the session"
START_RECORDING, STOP_RECORDING = "Start a recording (R)", "Stop the recording (R)"
BY_HAND = (
    "Material, operator, grip and recording are chosen where the two sides were started: nobody supervises them here."
)
CHOICES: dict[str, tuple[str, Sequence[str], str]] = {
    "material": ("Material", sorted(MATERIALS), "What the robot presses: both sides begin anew"),
    "operator": ("Operator", OPERATORS, "Who moves the hand: the leader begins anew"),
    "grip": ("Grip", (NO_GRIP, *GRIPS), "How a hand holds the device that the force moves"),
}
"""Of each choice: the label, what there is, and what comes of it."""
BEGINNING = 20.0  # Time for which a choice is shown before the session has confirmed it [s]
CLOSED = 0.3
"""For at least this time [s] nothing else can be chosen. Were a dropdown opened again in the moment in which it was
closed, the browser would hear of neither, and the focus would stay in it, where no key stops the robot."""


@dataclass(frozen=True)
class Actions:
    """Functions called for actions of a person, from the viewer's thread; moments and delays are in s, steps in m."""

    faults: Callable[[Mapping[str, float]], None]
    clutch: Callable[[int | None], None]
    end: Callable[[], None]
    emergency: Callable[[], None]
    choose: Callable[[str, str], None]
    record: Callable[[], None]
    open: Callable[[str], None]
    play: Callable[[], None]
    seek: Callable[[float], None]
    live: Callable[[], None]
    again: Callable[[float, float, bool], None]
    step: Callable[[float], None]


class SessionPanel:
    """Dropdowns, the recording's button, and the end."""

    def __init__(self, gui: Any, actions: Actions, *, live: bool) -> None:
        self._actions = actions
        self._unsupervised = BY_HAND if live else NOTHING_LIVE
        self._waiting: dict[str, tuple[str, float]] = {}  # what was chosen, and when [s]
        self._dropdowns = {
            name: gui.add_dropdown(label, tuple(options), hint=hint, disabled=True)
            for name, (label, options, hint) in CHOICES.items()
        }
        for name, dropdown in self._dropdowns.items():
            dropdown.on_update(by_person(functools.partial(self._choose, name)))
        self._record = gui.add_button(START_RECORDING, color=GREY, disabled=True)
        self._note = gui.add_html("")
        self._end = gui.add_button(END, color=GREY, disabled=not live)
        self._record.on_click(handler(lambda event: actions.record()))
        self._end.on_click(handler(lambda event: actions.end()))

    def show(self, runs: Mapping[str, str], *, offered: bool, recording: str, refused: str) -> None:
        """Show what runs: choices, the file that is written, and why the newest choice was refused; "" for none."""
        for name, (chosen, at) in tuple(self._waiting.items()):
            waited = time.monotonic() - at
            if waited > BEGINNING or (waited > CLOSED and (refused or runs.get(name) == chosen)):
                self._waiting.pop(name, None)
        for name, dropdown in self._dropdowns.items():
            value = "" if name in self._waiting else runs.get(name, "")
            if value and value not in dropdown.options:  # of a robot that is no simulation, for example
                dropdown.options = (*dropdown.options, value)
            put(dropdown, value=value or dropdown.value, disabled=not offered or bool(self._waiting))
        label, colour = (STOP_RECORDING, BLUE) if recording else (START_RECORDING, GREY)
        put(self._record, label=label, color=colour, disabled=not offered)
        what = f"Recording: {html.escape(recording)}" if recording else "Nothing is recorded."
        lines = [f'<span style="color:#555">{what if offered else self._unsupervised}</span>']
        if offered:
            lines += [f"<b>Begins anew with {html.escape(chosen)} …</b>" for chosen, _ in self._waiting.values()]
        if refused:
            lines.append(f'<b style="color:{css(VERMILLION)}">Not chosen: {html.escape(refused)}</b>')
        put(self._note, content=f'<div style="padding:2px 12px;overflow-wrap:anywhere">{"<br>".join(lines)}</div>')

    def ending(self) -> None:
        """Show that the session ends."""
        put(self._end, label="The session ends", disabled=True)

    def _choose(self, name: str, event: Any) -> None:
        value = str(event.target.value)
        self._waiting[name] = (value, time.monotonic())
        self._actions.choose(name, value)
