"""How contacts end and surfaces move: what holds a force up, closes an account, and takes the proxy along."""

from __future__ import annotations

import numpy as np
import pytest

from foretouch.devices import DeviceSpecification
from foretouch.models import KelvinVoigt
from foretouch.rendering import Renderer

TICK = 1e-3


def renderer(**options: object) -> Renderer:
    """One whose hand is coupled at 0."""
    made = Renderer(DeviceSpecification(damping=2.0, friction=0.0, resolution=0.0), **options)  # type: ignore[arg-type]
    made.engage(0.0, 0.0)
    return made


def walk(made: Renderer, places: np.ndarray, begin: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Rendered and mediated force along these places of the hand."""
    rows = []
    for tick, place in enumerate(places.tolist(), begin):
        rows.append((made.update(tick * TICK, place, TICK), made.mediation.force))
    rendered, mediated = np.array(rows).T
    return rendered, mediated


@pytest.mark.parametrize(("stiffness", "speed"), [(2000.0, 0.15), (3000.0, 0.2)])
def test_a_hand_that_leaves_quickly_is_not_pushed_by_the_limit_of_the_rate(stiffness: float, speed: float) -> None:
    made = renderer()
    made.adopt(KelvinVoigt(stiffness, 0.0), 0.0, message=1)
    inwards = np.arange(-1e-3, 2.5e-3, 2e-5)
    walk(made, inwards)
    outwards = np.arange(inwards[-1], -2e-3, -speed * TICK)
    rendered, mediated = walk(made, outwards, inwards.size)
    assert (rendered <= mediated + 1e-12).all()
    assert (rendered >= mediated - 0.02).all()  # and what the spring gives back is not cut


class Airy(KelvinVoigt):
    """A spring that gives 20 mN in the air, as maps may."""

    def advance(self, state, depth, velocity, sample_period):  # type: ignore[no-untyped-def]
        state, force, deviation = super().advance(state, depth, velocity, sample_period)
        return state, max(force, 0.02), deviation


def test_what_was_dissipated_in_one_contact_pays_for_nothing_in_the_next() -> None:
    made = renderer()
    made.adopt(Airy(500.0, 100.0), 0.0, message=1)
    press = np.concatenate((np.arange(-3e-3, 4e-3, 2e-5), np.arange(4e-3, -3e-3, -2e-5)))
    begin = 0
    for _ in range(3):
        walk(made, press, begin)
        begin += press.size
        assert made.account.energy <= 0.0


def test_a_surface_that_comes_and_goes_takes_the_proxy_along_and_back() -> None:
    made = renderer(guarded=True)
    spring = KelvinVoigt(500.0, 0.0)
    made.adopt(spring, 0.0, message=1)
    walk(made, np.arange(-1e-3, 6e-3, 2e-5))
    force = made.limiter.force
    for count in range(20):
        made.adopt(spring, (-8e-4, 0.0)[count % 2], message=2 + count)
        walk(made, np.full(20, 6e-3), 350 + 20 * count)
    assert made.proxy.indexed == pytest.approx(0.0, abs=1e-9)
    assert made.limiter.force == pytest.approx(force, rel=0.02)


def test_a_model_that_is_missing_for_a_while_moves_no_surface() -> None:
    made = renderer(guarded=True)
    spring = KelvinVoigt(500.0, 0.0)
    made.adopt(spring, 0.0, message=1)
    walk(made, np.arange(-1e-3, 6e-3, 2e-5))
    made.adopt(None, 0.0, message=2)
    walk(made, np.full(20, 6e-3), 350)
    made.adopt(spring, 0.0, message=3)
    walk(made, np.full(20, 6e-3), 370)
    assert made.proxy.indexed == 0.0


def test_a_largest_stiffness_is_that_of_a_device() -> None:
    plain, asked = Renderer(), Renderer(largest_stiffness=300.0)
    places = np.concatenate((np.arange(-1e-3, 5e-3, 2e-5), np.arange(5e-3, -1e-3, -2e-5)))
    for made in (plain, asked):
        made.adopt(KelvinVoigt(1000.0, 1.0), 0.0, message=1)
    np.testing.assert_array_equal(walk(plain, places), walk(asked, places))
