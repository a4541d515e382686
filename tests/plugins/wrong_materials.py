"""A material that keeps every rule, and ones that each break one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from foretouch.models import ContactModel, ContactState
from foretouch.robot import Material


@dataclass(frozen=True)
class Spring(ContactModel):
    """F = k x + b v inside, never negative."""

    law: ClassVar[str] = "spring of a test"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "damping")
    stiffness: float = 600.0
    damping: float = 2.0

    def force(self, depth: float, velocity: float) -> float:
        return max(self.stiffness * depth + self.damping * velocity, 0.0) if depth > 0.0 else 0.0

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        return state, self.force(depth, velocity), math.nan


class Sticky(Spring):
    def force(self, depth: float, velocity: float) -> float:
        return super().force(depth, velocity) if depth > 0.0 else 0.05


class Negative(Spring):
    def force(self, depth: float, velocity: float) -> float:
        return self.stiffness * depth + 20.0 * velocity if depth > 0.0 else 0.0


class NoNumber(Spring):
    def force(self, depth: float, velocity: float) -> float:
        return math.nan if abs(velocity) > 1.0 else super().force(depth, velocity)


class Snapping(Spring):
    def force(self, depth: float, velocity: float) -> float:
        return super().force(depth if depth < 0.006 else depth - 0.003, velocity)


class Driving(Spring):
    """It pushes harder while it is left than while it is pressed: it gives energy."""

    def force(self, depth: float, velocity: float) -> float:
        return super().force(depth, 0.0) * (1.2 if velocity < 0.0 else 1.0)


class Hoarding(Spring):
    """A state that grows with every sample."""

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        return (*state[-2000:], depth), self.force(depth, velocity), math.nan


def material(model: ContactModel, **changes: object) -> Material:
    values: dict[str, object] = {"name": "test", "description": "soft", "provenance": "made up", "press_depth": 0.009}
    return Material(model=model, **values | changes)  # type: ignore[arg-type]


WRONG: dict[str, tuple[Callable[[], Material], str]] = {
    "name": (lambda: material(Spring(), name="other"), "name = 'other'"),
    "name / lines": (lambda: material(Spring(), description="two\nlines"), ""),
    "units": (lambda: material(Spring(), press_depth=9.0), "press depth 9 m"),
    "units / newtons": (lambda: material(Spring(6e6, 0.0)), "5.4e+04 N"),
    "force is a number": (lambda: material(Negative()), "are not"),
    "force is a number / jumps": (lambda: material(NoNumber()), "are not"),
    "no force outside": (lambda: material(Sticky()), "0.05 N"),
    "loading grows": (lambda: material(Snapping()), "falls by"),
    "passive": (lambda: material(Driving()), "% of"),
    "no allocation": (lambda: material(Hoarding()), "bytes more"),
}
