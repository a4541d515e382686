"""The panel beside the picture: what to do, the forces, behind tabs the rest; and recordings, with a bar at the top."""

from __future__ import annotations

import html
import math
import time
from typing import Any

from foretouch.console.panels.figures import EnergyPanel, ForcePanel, ModelPanel
from foretouch.console.panels.session import LONGEST_DELAY, SLIDERS, Actions, NetworkPanel, SessionPanel
from foretouch.console.panels.space import ImagePanel
from foretouch.console.panels.stop import HELP, STEP, WHOLE_ARM, Alarm, add_keys
from foretouch.console.playback import Playback
from foretouch.console.plots import by_person, handler, put
from foretouch.console.sentences import WAITING_INSTRUCTION
from foretouch.quantities.colours import BLUE, GREY, INK, ORANGE, css

NOT_LIVE = "RECORDING, NOT LIVE"
LIVE_MEANWHILE = "The robot goes on with the session; the emergency stop below is the robot's."
_TOP = (
    "position:fixed;left:12px;top:12px;z-index:100;pointer-events:none;"
    "max-width:max(calc(100vw - 500px), min(366px, calc(100vw - 24px)));overflow-wrap:anywhere;"
)
"""Over the top of the picture, no wider than it is beside the panel."""


def banner_html(playback: Playback | None, note: str, *, live: bool) -> str:
    """Which recording is looked at, and which moment of it; without one, a note, if there is any."""
    if playback is not None:
        moment = f"{playback.now:.1f} of {playback.duration:.1f} s"
        return (
            f'<div role="status" style="{_TOP}background:{css(ORANGE)};color:{css(INK)};'
            f'border:3px solid {css(INK)};border-radius:8px;padding:6px 12px;font-weight:700;font-size:17px">'
            f"{NOT_LIVE}: {html.escape(playback.name)}, {moment}<br>"
            f'<span style="font-weight:400;font-size:14px">{LIVE_MEANWHILE if live else ""}</span></div>'
        )
    if not note:
        return ""
    return (  # a small box; on a phone, what is urgent takes its place
        f'<div role="status" class="foretouch-note" style="{_TOP}background:#fff;color:{css(INK)};'
        f"border:2px solid {css(ORANGE)};border-radius:6px;padding:4px 10px;font-size:13px;line-height:1.3"
        f'">{html.escape(note)}</div>'
    )


CHOOSE_RECORDING = "Choose a recording below, in the tab Recordings."
WATCH_RECORDING = "A recording: play it, or drag its time bar."
PRESS_CLUTCH, RELEASE_CLUTCH = "Clutch (C)", "Clutch is pressed: let it go (C)"
CLUTCH = "While it is pressed your hand moves alone and the robot stays where it is"
WIDTH = 460  # [pixel]
PHONE = "(max-width: 36em)"  # Style-sheet query for a viewer that shows its panel as a sheet
_LAYOUT = (
    '<div class="foretouch-layout"><style>'
    # The viewer's advice on software rendering would cover banner and handle; the console draws less there by itself.
    '.mantine-Notification-root[style*="orange"]{display:none}'
    # The description of a control is beside the panel, where it covers neither tabs nor what is urgent.
    "@media (min-width:56em){.mantine-Tooltip-tooltip{transform:translate(-400px,60%);z-index:90 !important}"
    ".mantine-Tooltip-arrow{display:none}}"
    # The viewer's labels are a pale grey, in letters that are pushed together.
    ".mantine-Paper-root:has(.foretouch-layout) label{color:#444 !important;letter-spacing:-0.2px !important}"
    # A laptop shows handle, material, plot and all sliders of the network at once.
    "@media (max-height:800px) and (min-width:36.01em){.foretouch-about{display:none}}"
    # The viewer leaves it as narrow as a small window had made it.
    f"@media (min-width:56em){{[data-dock-region],div:has(> [data-dock-column]){{min-width:{WIDTH + 4}px !important}}}}"
    # A phone shows the scene above, the panel as a sheet below it, and the stop below both.
    f"@media {PHONE}{{"
    "div:has(> .mantine-Paper-root .foretouch-layout){flex-direction:column}"
    "div:has(> .mantine-Paper-root .foretouch-layout) > div:not(.mantine-Paper-root){height:auto !important;"
    "min-height:0;flex:1 1 0 !important}"
    ".mantine-Paper-root:has(.foretouch-layout){position:relative !important;width:100% !important;"
    "max-height:50% !important;margin-bottom:84px !important}"
    '.mantine-Paper-root:has(.foretouch-layout) div[style*="20em"]{width:100% !important}'
    ".foretouch-table{font-size:0.85em}.foretouch-about{display:none}"
    ".foretouch-note{font-size:11px !important;padding:2px 6px !important}"
    "body:has(.foretouch-alerts) .foretouch-note{display:none}}"
    "</style></div>"
)


class Panel:
    """The viewer's panel. Each part is a class.

    Where no session may be received, recordings come first, and nothing offers to act on a robot.
    """

    def __init__(self, server: Any, actions: Actions, *, live: bool) -> None:
        gui = server.gui
        gui.set_panel_label("foretouch")
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False, brand_color=BLUE)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        gui.add_html(_LAYOUT)
        self.alarm = Alarm(gui, actions.emergency, offered=live)  # the first that the keyboard reaches
        self.banner = gui.add_html("")
        self._head = gui.add_html(_head_html(WAITING_INSTRUCTION, felt("", True)))
        self.forces = ForcePanel(gui)
        self.image = ImagePanel(gui)
        self.whole_arm = gui.add_checkbox(WHOLE_ARM[0], False, hint=f"Key {WHOLE_ARM[1]}", visible=False)
        self.clutch = gui.add_button(PRESS_CLUTCH, color=GREY, hint=CLUTCH)
        self.clutch.on_click(handler(lambda event: actions.clutch(event.client_id)))
        self.tabs = tabs = gui.add_tab_group()
        titles = ["Network", "Model", "Energy", "Session"]
        titles.insert(len(titles) if live else 0, "Recordings")
        tab = {title: tabs.add_tab(title) for title in titles}
        with tab["Network"]:
            self.network = NetworkPanel(gui, actions.faults)
        with tab["Model"]:
            self.models = ModelPanel(gui)
        with tab["Energy"]:
            self.energy = EnergyPanel(gui)
        with tab["Session"]:
            self.session = SessionPanel(gui, actions, live=live)
        with tab["Recordings"]:
            self.recordings = RecordingsPanel(gui, actions, live=live)
        self._help = gui.add_html(_help_html(HELP), visible=live)
        add_keys(
            gui,
            ("Hand deeper", "D", lambda event: actions.step(STEP)),
            ("Hand up", "U", lambda event: actions.step(-STEP)),
            ("Clutch", "C", lambda event: actions.clutch(event.client_id)),
            ("Start or stop recording", "R", lambda event: actions.record()),
            ("Play or pause the recording", "P", lambda event: actions.play()),
        )

    def instruct(self, instruction: str, note: str) -> None:
        """Show what to do, in one line, and which hand the force moves."""
        put(self._head, content=_head_html(instruction, note))

    def name_keys(self, more: str) -> None:
        """Name more keys than there are in every session."""
        put(self._help, content=_help_html(HELP.replace("Keys: ", f"Keys: {more}")))

    def show_clutch(self, pressed: bool) -> None:
        """Show whether the clutch is pressed."""
        label, colour = (RELEASE_CLUTCH, BLUE) if pressed else (PRESS_CLUTCH, GREY)
        put(self.clutch, label=label, color=colour)


def felt(grip: str, by_mouse: bool) -> str:
    """The hand that the force moves, in a sentence; with an empty grip it moves none."""
    if not grip:
        return "A mouse cannot push back: see the blue arrow." if by_mouse else "It moves nobody's hand."
    leads = "that follows your mouse" if by_mouse else "of the operator"
    return f"It moves a hand {leads} ({grip} grip)."


def _help_html(text: str) -> str:
    return f'<div style="padding:4px 12px;font-size:0.85em;line-height:1.5;color:#555">{text}</div>'


def _head_html(instruction: str, note: str) -> str:
    return (
        f'<div style="padding:0 12px 2px 12px;font-size:1.15em;line-height:1.3"><b style="color:{css(BLUE)}">'
        f'{html.escape(instruction)}</b><br><span style="font-size:0.78em;color:#555"><span class="foretouch-about">A '
        "robot touches the material beyond a slow network. A model of it comes back, and the force is computed here, "
        f"at once. </span>{html.escape(note)}</span></div>"
    )


SETTLED = 0.3
"""Time without a motion after which a bar is put where the recording is [s], whatever a page shows: the value sent to
it last may have crossed one that a person typed into it."""
SLIGHTLY = 0.01  # Smallest difference from the former value: the viewer does not send a repetition [s]
CHOOSE = "choose one to look at it"
PLAY, PAUSE = "Play (P)", "Pause (P)"
BACK, CLOSE = "Back to live", "Close the recording"
RUN_AGAIN = "Run it again under these delays"


class RecordingsPanel:
    """The recording, and the moment of it that is shown."""

    def __init__(self, gui: Any, actions: Actions, *, live: bool) -> None:
        self._actions = actions
        self._list = gui.add_dropdown("Recording", (CHOOSE,), hint="The newest first")
        self._where = gui.add_html("")
        self._bar = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0, disabled=True)
        self._play = gui.add_button(PLAY, color=GREY, disabled=True)
        self._live = gui.add_button(BACK if live else CLOSE, color=BLUE, disabled=True)
        self._note = gui.add_html("")
        self._delays = {
            name: gui.add_slider(SLIDERS[name][0], 0.0, LONGEST_DELAY, 0.01, 0.0, disabled=True)
            for name in ("position_delay", "force_delay")
        }
        hint = "The force moves the hand; needs a grip"
        self._closed = gui.add_checkbox("Closed loop", False, hint=hint, disabled=True)
        self._again = gui.add_button(RUN_AGAIN, color=GREY, disabled=True)
        self._shown: Playback | None = None
        self._moved = math.nan  # when a person moved the bar [s], until it has settled
        self._list.on_update(by_person(self._chosen))
        self._bar.on_update(by_person(self._dragged))
        self._play.on_click(handler(lambda event: actions.play()))
        self._live.on_click(handler(lambda event: actions.live()))
        self._again.on_click(handler(self._run_again))

    def list(self, names: tuple[str, ...], where: str) -> None:
        """Show which recordings there are, and in which folders."""
        put(self._where, content=_quiet(where))
        options = (CHOOSE, *names)
        if tuple(self._list.options) != options:
            value = self._list.value
            self._list.options = options
            if value in options:
                self._list.value = value

    def show(self, playback: Playback | None, note: str, busy: bool) -> None:
        """Show the recording that is looked at, one line on it, and whether something is being read or run."""
        if playback is not self._shown:
            if playback is None:
                self._list.value, self._bar.value, self._play.label = CHOOSE, 0.0, PLAY
            elif self._shown is None or playback.log is not self._shown.log:
                self._bar.max = max(round(playback.duration, 2), 0.01)
                for name, slider in self._delays.items():
                    slider.value = min(max(playback.setting(name, 0.0), 0.0), LONGEST_DELAY)
            self._shown = playback
        for control in (self._bar, self._play, self._live, *self._delays.values(), self._closed):
            put(control, disabled=playback is None)
        put(self._again, disabled=playback is None or busy)
        put(self._list, disabled=busy)
        if playback is not None:
            if time.monotonic() - self._moved > SETTLED:
                self._moved = math.nan
                self._bar.value = round(playback.now, 2) + SLIGHTLY
            if abs(self._bar.value - playback.now) > 0.005:
                self._bar.value = round(playback.now, 2)
            put(self._play, label=PAUSE if playback.playing else PLAY)
        put(self._note, content=_quiet(note))

    def _chosen(self, event: Any) -> None:
        if self._list.value != CHOOSE:
            self._actions.open(str(self._list.value))

    def _dragged(self, event: Any) -> None:
        self._moved = time.monotonic()
        self._actions.seek(float(self._bar.value))

    def _run_again(self, event: Any) -> None:
        there, back = (float(slider.value) for slider in self._delays.values())
        self._actions.again(there, back, bool(self._closed.value))


def _quiet(text: str) -> str:
    return f'<div style="padding:2px 12px;color:#555;overflow-wrap:anywhere">{html.escape(text)}</div>'
