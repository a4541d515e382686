"""A gamepad as the operator's handle: a stick and a trigger move it, rumble is a cue. It gives no force.

The first gamepad of this machine is read by pygame (SDL), which is imported here alone.
"""

from __future__ import annotations

import math
import os
from typing import Any, ClassVar, NamedTuple

from foretouch.devices.device import AnyDevice, Device, Tracker, limit_force
from foretouch.errors import MissingExtraError, SettingError
from foretouch.errors.checks import require


class Reach(NamedTuple):
    """What an operator may know of the material, at the hand.

    Attributes:
        surface: Position of the surface [m]; NaN where unknown.
        press_depth: Depth of the deepest press [m]; NaN where unknown.
    """

    surface: float
    press_depth: float

    @property
    def known(self) -> bool:
        """Whether both are known."""
        return math.isfinite(self.surface) and math.isfinite(self.press_depth)


UNKNOWN_REACH = Reach(math.nan, math.nan)
"""Reach of a robot that does not report what it presses: the surface is found by touching."""


FULL = 32767.0  # A controller's axis at its end
RUMBLE_MS = 1000  # Time after which a rumble ends by itself [ms]: a process that is gone leaves no pad shaking


class PygamePad:
    """Left stick, right trigger, and the left shoulder button as clutch; both motors rumble.

    A pad that SDL knows is read as a game controller, whatever its maker; any other as a joystick, whose second axis is
    the stick, and which has no trigger.

    Raises:
        MissingExtraError: pygame is not installed.
        SettingError: No gamepad is connected.
    """

    def __init__(self) -> None:
        # SDL reads joysticks with its events, and those only with a display: none is needed.
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
        os.environ.setdefault("SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS", "1")
        os.environ.setdefault("SDL_NO_SIGNAL_HANDLERS", "1")  # Ctrl-C is the session's
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
            from pygame._sdl2 import controller
        except ImportError:
            raise MissingExtraError("pygame", "gamepad") from None
        self._pygame: Any = pygame
        pygame.display.init()
        pygame.joystick.init()
        controller.init()
        if pygame.joystick.get_count() == 0:
            self._quit()
            rule = "no gamepad is connected: plug one in (it must be readable under /dev/input), or take browser"
            raise SettingError("operator", "gamepad", rule)
        self._controller: Any = controller.Controller(0) if controller.is_controller(0) else None
        self._joystick: Any = pygame.joystick.Joystick(0)

    def state(self) -> PadState | None:
        """Present state of the pad; None where it is gone."""
        pygame = self._pygame
        pygame.event.pump()
        pad = self._controller
        if pad is None:
            if pygame.joystick.get_count() == 0 or self._joystick.get_numaxes() < 2:
                return None
            return PadState(float(self._joystick.get_axis(1)), 0.0, bool(self._joystick.get_button(0)))
        if not pad.attached():
            return None
        return PadState(
            pad.get_axis(pygame.CONTROLLER_AXIS_LEFTY) / FULL,
            pad.get_axis(pygame.CONTROLLER_AXIS_TRIGGERRIGHT) / FULL,
            bool(pad.get_button(pygame.CONTROLLER_BUTTON_LEFTSHOULDER)),
        )

    def rumble(self, strength: float) -> None:
        """Rumble from now on for a second, 0 to 1; a pad without motors does nothing."""
        pad = self._joystick if self._controller is None else self._controller
        if strength > 0.0:
            pad.rumble(strength, strength, RUMBLE_MS)
        else:
            pad.stop_rumble()

    def close(self) -> None:
        """Give the pad back."""
        self._joystick.quit()
        self._quit()

    def _quit(self) -> None:
        self._pygame.joystick.quit()
        self._pygame.display.quit()


STICK_SPEED = 0.06  # Speed of the handle at full deflection [m/s]
DEAD_ZONE = 0.15  # Deflections below this are a stick at rest
TRACKING_RATE = 60.0  # Rate [1/s] of the critically damped tracker: the handle lags by 2 / rate = 33 ms
LARGEST_SPEED = 0.2  # Bound on the speed of what the tracker follows [m/s]: a trigger is pulled within milliseconds
FARTHEST, TRIGGER_REACH = 0.2, 0.02
"""Largest depth of the handle, and depth that the trigger presses, where the surface is not known [m]."""
PRESSES = 1.2  # Largest depth of the handle, where the reach is known, over the press depth [-]
LONGEST_STEP = 0.05  # Upper limit to which a gap between two reads is cut [s]
FULL_RUMBLE, RUMBLE_PERIOD_NS, RUMBLE_STEP = 10.0, 50_000_000, 0.02
"""Force of the strongest rumble [N]; shortest time between commands to the pad [ns]; least change of strength [-]."""
RENEWED_NS = 500_000_000  # Time after which the same rumble is asked for again [ns]: it ends by itself


class PadState(NamedTuple):
    """State of a pad: stick, -1 (out) to 1 (in), trigger, 0 (let go) to 1 (pulled), and whether the clutch is held."""

    stick: float
    trigger: float
    clutched: bool


class RateControlled(AnyDevice):
    """A handle that is moved by rate, in an open loop: no force moves the hand."""

    closed_loop: ClassVar[bool] = False
    real_time: ClassVar[bool] = True

    def __init__(self) -> None:
        self._now_ns: int | None = None
        self._clutched = self._closed = self._gone = False

    @property
    def clutched(self) -> bool:
        """Whether the clutch's button was pressed at the newest `read`."""
        return self._clutched

    @property
    def gone(self) -> bool:
        """Whether what a hand holds was gone at the newest `read`."""
        return self._gone

    def _pass_time(self, now_ns: int) -> tuple[int, float]:
        """The time [ns], which never goes back, and how long after the last `read` it is, at most 50 ms [s]."""
        before = now_ns if self._now_ns is None else self._now_ns
        self._now_ns = max(now_ns, before)
        return self._now_ns, min((self._now_ns - before) * 1e-9, LONGEST_STEP)


def farthest(reach: Reach) -> float:
    """How far in a handle goes [m]: as far as a press does, where that is known.

    Raises:
        SettingError: A reach that is no place to press.
    """
    if not reach.known:
        return FARTHEST
    require("surface", reach.surface, above=0.0, at_most=1.0)
    require("press_depth", reach.press_depth, above=0.0, at_most=1.0)
    return reach.surface + PRESSES * reach.press_depth


class Gamepad(RateControlled, Device):
    r"""A handle that a stick moves by rate and a trigger by position.

    .. math:: \dot b = V s, \quad r = b + R t, \quad \ddot x = \omega^2 (r - x) - 2 \omega \dot x

    with the stick s less its dead zone, the trigger t, V = 60 mm/s, the trigger's reach R and :math:`\omega = 60/s`,
    solved exactly for every step. b stays where the stick is let go. A pad that is gone, or shows what is no number,
    leaves the handle where it is, and without rumble.

    It is an open loop: the rumble moves no hand.

    Args:
        pad: Pad to read.
        reach: Reach of the material; where it is known, trigger and stick go as far as a press does.

    Raises:
        SettingError: A reach that is no place to press.
    """

    name: ClassVar[str] = "gamepad"

    def __init__(self, pad: PygamePad, reach: Reach = UNKNOWN_REACH) -> None:
        super().__init__()
        self._farthest = farthest(reach)
        self._trigger_reach = PRESSES * reach.press_depth if reach.known else TRIGGER_REACH
        self._pad = pad
        self._base = self._trigger = 0.0
        self._tracker = Tracker(TRACKING_RATE)
        self._rumble, self._rumble_ns = 0.0, 0

    def read(self, now_ns: int) -> float:
        """Position of the handle [m]."""
        _, period = self._pass_time(now_ns)
        state = None if self._closed else self._pad.state()
        self._gone = state is None or not math.isfinite(state.stick + state.trigger)
        if state is None or self._gone:
            self._clutched = False
        else:
            self._clutched = state.clutched
            self._trigger = min(max(state.trigger, 0.0), 1.0) * self._trigger_reach
            self._base += STICK_SPEED * deflection(state.stick) * period
            self._base = min(max(self._base, 0.0), self._farthest)
        goal = min(self._base + self._trigger, self._farthest)
        return self._tracker.update(goal, LARGEST_SPEED, period)

    def render(self, force: float) -> float:
        """Rumble as strongly as the force says [N]; the force within the limit that every device has, 0 once closed."""
        force = 0.0 if self._closed else limit_force(force)
        strength = 0.0 if self._gone else min(force / FULL_RUMBLE, 1.0)
        now_ns = self._now_ns or 0
        changed = abs(strength - self._rumble) >= RUMBLE_STEP or (strength == 0.0) != (self._rumble == 0.0)
        ends = strength > 0.0 and now_ns - self._rumble_ns >= RENEWED_NS
        due = now_ns - self._rumble_ns >= RUMBLE_PERIOD_NS or strength == 0.0
        if (changed or ends) and due and not self._closed:
            self._pad.rumble(strength)
            self._rumble, self._rumble_ns = strength, now_ns
        return force

    def close(self) -> None:
        """End the rumble and give the pad back."""
        if not self._closed:
            self._closed = True
            self._pad.rumble(0.0)
            self._pad.close()


def deflection(stick: float) -> float:
    """A stick's deflection without its dead zone, -1 to 1."""
    beyond = max(min(abs(stick), 1.0) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE)
    return math.copysign(beyond, stick)


def open_gamepad(reach: Reach = UNKNOWN_REACH) -> Gamepad:
    """The first gamepad of this machine, for this reach of the material.

    Raises:
        MissingExtraError: pygame is not installed.
        SettingError: No gamepad is connected.
    """
    return Gamepad(PygamePad(), reach)
