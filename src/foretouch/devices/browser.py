"""An operator at a mouse."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from foretouch.devices.device import PEAK_SPEED_RATIO, Device, Tracker, limit_force, minimum_jerk
from foretouch.errors.checks import require

TRACKING_RATE = 100.0  # Rate [1/s] of the critically damped tracker: it lags by 2 / rate = 20 ms
RAMP_SHARE, LONGEST_RAMP = 0.8, 0.05
"""Fraction of the usual time between positions in which each new one is approached, and its largest value [s]."""
LARGEST_SPEED = 0.25  # Bound on the speed of the aim [m/s]
SILENCE = 1.0  # Silence after which a held handle or clutch counts as released [s]: its browser may be gone
HOLD_TIME = 3.0  # Time for which the hand stays where it was released [s]
EASE_TIME, EASE_SPEED = 1.5, 0.1
"""Shortest way back into the script [s], and the peak speed [m/s] above which it takes longer."""


class BrowserOperator(Device):
    r"""Presses by script until the handle is taken.

    Handle positions arrive irregularly, 10 to 60 a second. The aim r goes to each new one in a straight line, no faster
    than 0.25 m/s, and the hand x follows it by

    .. math:: \ddot x = \omega^2 (r - x) - 2 \omega \dot x, \quad \omega = 100/\mathrm{s}

    solved exactly for every step: no overshoot, no step, a lag of 20 ms plus 0.8 of the usual time between positions
    (60 ms at 20 a second). Let go, the hand stays for 3 s, then eases back into the script, which has gone on
    meanwhile.

    Args:
        script: The device that presses while the handle is free, for example `ScriptedOperator`.
        deepest: Bound on handle positions [m]; those beyond it, or below 0, count as the bound.

    Raises:
        SettingError: `deepest` out of range.
    """

    name: ClassVar[str] = "browser"
    closed_loop: ClassVar[bool] = False

    def __init__(self, script: Device, deepest: float = 0.2) -> None:
        require("deepest", deepest, above=0.0, at_most=0.5)
        self._script = script
        self._deepest = deepest
        self._mode: Literal["script", "held", "resting", "returning"] = "script"
        self._since_ns = 0  # when the mode began; while held, when the newest position arrived
        self._now_ns: int | None = None
        self._hand = Tracker(TRACKING_RATE)
        self._target = self._aim_speed = 0.0
        self._interval = LONGEST_RAMP  # usual time between handle positions
        self._ease_time = EASE_TIME
        self._clutched = False
        self._heard_ns = 0  # when the newest message arrived

    @property
    def held(self) -> bool:
        """Whether the handle is held."""
        return self._mode == "held"

    @property
    def clutched(self) -> bool:
        """Whether the clutch is pressed, as the newest handle message says that is no older than 1 s."""
        return self._clutched

    def take(self, position: float, held: bool, now_ns: int, *, clutched: bool = False) -> None:
        """One handle message; call it from the thread that calls `read`.

        Args:
            position: Position of the handle [m]; one that is not a finite number is ignored.
            held: Whether it is being dragged.
            now_ns: Time of the message's arrival [ns], by the clock that `read` gets.
            clutched: Whether the clutch is pressed, from now on.
        """
        self._clutched, self._heard_ns = clutched, now_ns
        if not math.isfinite(position) or not (held or self.held):
            return
        if not self.held:
            self._hand.aim = self._hand.position
            self._interval = LONGEST_RAMP
        elif now_ns > self._since_ns:
            self._interval += 0.3 * (min((now_ns - self._since_ns) * 1e-9, 0.1) - self._interval)
        self._target = min(max(position, 0.0), self._deepest)
        ramp = max(min(RAMP_SHARE * self._interval, LONGEST_RAMP), 1e-3)
        self._aim_speed = min(abs(self._target - self._hand.aim) / ramp, LARGEST_SPEED)
        self._mode = "held" if held else "resting"
        self._since_ns = now_ns

    @property
    def fresh(self) -> bool:
        """Whether nothing was read yet."""
        return self._now_ns is None

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]."""
        now_ns = now_ns if self._now_ns is None else max(now_ns, self._now_ns)
        period = 0.0 if self._now_ns is None else (now_ns - self._now_ns) * 1e-9
        self._now_ns, hand = now_ns, self._hand
        script = self._script.read(now_ns)
        since = (now_ns - self._since_ns) * 1e-9
        self._clutched = self._clutched and (now_ns - self._heard_ns) * 1e-9 <= SILENCE
        if self._mode == "held" and since > SILENCE:
            self._mode, self._since_ns = "resting", now_ns
        elif self._mode == "resting" and since > HOLD_TIME:
            self._mode, self._since_ns, since = "returning", now_ns, 0.0
            self._target = hand.position
            self._ease_time = max(EASE_TIME, PEAK_SPEED_RATIO * abs(script - self._target) / EASE_SPEED)
        if self._mode == "held" or self._mode == "resting":
            return hand.update(self._target, self._aim_speed, period)
        if self._mode == "returning":
            fraction = minimum_jerk(since / self._ease_time)
            if fraction >= 1.0:
                self._mode = "script"
            script = self._target + fraction * (script - self._target)
        if period > 0.0:
            hand.velocity = (script - hand.position) / period
        hand.position = script
        return script

    def render(self, force: float) -> float:
        """Limit the force [N] as every device does; no hand feels it."""
        return limit_force(force)
