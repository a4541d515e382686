"""The first gamepad of this machine, by pygame (SDL): the one place that imports it."""

from __future__ import annotations

import os
from typing import Any

from foretouch.devices.gamepad import PadState
from foretouch.errors import MissingExtraError, SettingError

__all__ = ["PygamePad"]

FULL = 32767.0
"""A controller's axis at its end."""
RUMBLE_MS = 1000
"""A rumble ends by itself after so long: a process that is gone leaves no pad shaking."""


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
        """What the pad shows now; None where it is gone."""
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
