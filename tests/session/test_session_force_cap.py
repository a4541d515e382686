"""The force on the probe in space: how fast the place goes against it, as far as the believed normal explains it."""

from __future__ import annotations

import pytest

from foretouch.quantities.pose import Vector
from foretouch.session.safety.force_guard import PATIENCE, STEEPER
from foretouch.session.safety.kernel import AIMED
from foretouch.session.safety.safety import SafetyLimits
from foretouch.session.spatial.last_limit import ForceCap

CEILING, STIFFNESS, MOST_DAMPED = 15.0, 2000.0, SafetyLimits().most_damped
UP: Vector = (0.0, 0.0, 1.0)


def pressed(normal: Vector) -> ForceCap:
    cap = ForceCap(CEILING, MOST_DAMPED, 0.25, 1e-3)
    for tick in range(200):
        depth = 1e-5 * tick
        cap.observe((0.0, 0.0, -depth), (0.0, 0.0, STIFFNESS * depth), normal)
    return cap


def test_along_the_believed_normal_it_goes_as_a_guard_on_a_line_does() -> None:
    missing = AIMED * CEILING - STIFFNESS * 199e-5
    assert pressed(UP).fastest == pytest.approx(missing / (STEEPER * STIFFNESS * PATIENCE), rel=0.3)


def test_a_force_that_the_normal_does_not_explain_may_be_of_something_damped() -> None:
    missing = AIMED * CEILING - STIFFNESS * 199e-5
    assert 0.0 < pressed((1.0, 0.0, 0.0)).fastest <= missing / MOST_DAMPED
