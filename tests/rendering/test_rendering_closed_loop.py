"""A hand, a device and the renderer in a loop: nothing that a model asks for makes them swing."""

from __future__ import annotations

import numpy as np
import pytest
from renderer_runs import Run

from foretouch.devices import GRIPS, Device, DeviceSpecification, Grip, Hand
from foretouch.models import HuntCrossley, KelvinVoigt
from foretouch.rendering import Renderer

TICK_NS = 1_000_000
TICK = 1e-3


class At(Device):
    """Wants to be where it is told to."""

    name = "at"
    closed_loop = False

    def __init__(self) -> None:
        self.position = 0.0

    def read(self, now_ns):
        return self.position

    def render(self, force):
        raise AssertionError("the intention feels nothing")


class Loop:
    """Hand, device and renderer, all promises checked in each tick."""

    def __init__(self, device, grip, **options):
        self.intention = At()
        self.hand = Hand(self.intention, grip, device)
        self.run = Run(device, **options)
        self.run.renderer.engage(0.0, 0.0)
        self.time_ns = 0

    def tick(self, *arrivals):
        shown = self.hand.read(self.time_ns)
        self.time_ns += TICK_NS
        self.hand.render(self.run.tick(shown, arrivals))
        return self.hand.exact_position

    def go(self, where, seconds):
        """Want to be there [m], and where the hand gets in so many seconds [m]."""
        begin, ticks = self.intention.position, round(seconds * 1000)
        places = []
        for number in range(ticks):
            self.intention.position = begin + (where - begin) * min((number + 1) / (0.2 * 1000), 1.0)
            places.append(self.tick())
        return np.array(places)


def swing_and_force(device, grip, model, press=2.0, **options):
    """How far the hand still swings [m] 2 s after it has pressed with about so many newtons, and the largest force."""
    loop = Loop(device, grip, **options)
    loop.tick((model, 1e-3))
    loop.go(1e-3 + press / grip.stiffness, 2.0)
    forces, places = [], []
    for _ in range(300):
        places.append(loop.tick())
        forces.append(loop.run.renderer.limiter.force)
    return float(np.ptp(places)), max(forces)


def swing(device, grip, model):
    """How far it swings, where there still is a force to swing against."""
    size, force = swing_and_force(device, grip, model)
    assert force > 0.1
    return size


HARD = [
    KelvinVoigt(1e6, 0.0),
    KelvinVoigt(1e4, 0.0),
    KelvinVoigt(1e5, 0.0),
    KelvinVoigt(3e3, 40.0),
    HuntCrossley(1e6, 0.0, 1.5),
    HuntCrossley(1e7, 1e4, 1.5),
]
ENDS = [grip if grip != "normal" else pytest.param(grip, marks=pytest.mark.long) for grip in GRIPS]
"""Every grip, of which `make test` takes the softest and the stiffest."""
NAMES = ["1000 N/mm", "10 N/mm", "100 N/mm", "damper", "stiffening", "stiffening damper"]


@pytest.mark.parametrize("model", HARD, ids=NAMES)
@pytest.mark.parametrize("damping", [0.5, *(pytest.param(damping, marks=pytest.mark.long) for damping in (2.0, 5.0))])
@pytest.mark.parametrize("grip", ENDS)
def test_no_material_swings_in_any_grip_without_the_help_of_friction(grip, damping, model):
    device = DeviceSpecification(damping=damping, friction=0.0, resolution=0.0, delay=5e-4)
    assert swing(device, GRIPS[grip], model) < 2e-5


@pytest.mark.parametrize("grip", ENDS)
@pytest.mark.parametrize(
    "resolution", [5e-5, *(pytest.param(resolution, marks=pytest.mark.long) for resolution in (1e-6, 1e-5))]
)
def test_nor_with_a_real_encoder_and_friction(grip, resolution):
    device = DeviceSpecification(damping=2.0, resolution=resolution, delay=5e-4)
    for model in HARD:
        assert swing(device, GRIPS[grip], model) <= max(2.0 * resolution, 2e-5)


@pytest.mark.parametrize(
    "model", [KelvinVoigt(1e5, 0.0), pytest.param(HuntCrossley(1e6, 0.0, 1.2), marks=pytest.mark.long)]
)
def test_without_the_share_it_swings_or_the_account_takes_the_force_away(model, monkeypatch):
    """The tests above can fail: the same hands and the whole model."""
    device, loosely = DeviceSpecification(damping=2.0, friction=0.0, resolution=0.0, delay=5e-4), Grip(0.0, 0.0, 300.0)
    assert swing_and_force(device, loosely, model)[0] < 1e-6
    assert swing_and_force(device, GRIPS["soft"], model)[1] > 1.8
    update = Renderer.update

    def with_the_whole_model(renderer, *inputs, **named):
        force = update(renderer, *inputs, **named)
        renderer._rendering["share"] = 1.0
        return force

    monkeypatch.setattr(Renderer, "update", with_the_whole_model)
    for grip in (loosely, GRIPS["soft"]):
        size, force = swing_and_force(device, grip, model)
        assert size > 1e-3 or force < 1.0


@pytest.mark.parametrize("grip", ENDS)
@pytest.mark.parametrize("guarded", [True, False])
def test_models_that_jump_fifty_times_a_second_move_a_still_hand_little(grip, guarded):
    loop = Loop(DeviceSpecification(damping=2.0, delay=5e-4), GRIPS[grip], guarded=guarded)
    models = (KelvinVoigt(200.0, 0.0), 1e-3), (KelvinVoigt(2e4, 10.0), 5e-4)
    loop.tick(models[0])
    loop.go(4e-3, 1.0)
    places, forces = [], []
    for number in range(1500):
        places.append(loop.tick(*([models[number // 20 % 2]] if number % 20 == 0 else [])))
        forces.append(loop.run.renderer.mediation.force)
    assert np.ptp(places) < 2e-3
    assert max(abs(np.diff(places))) < 5e-5  # 50 mm/s
    # What is let in and taken back in 20 ticks is at most 20 steps, less what the hand makes way for.
    assert np.ptp(forces[200:]) < 20 * 0.08 + 0.4


def test_what_the_device_carries_is_rendered_whole():
    """A spring of less than b / (T / 2 + d) is felt as it is: where the hand rests is where spring and grip agree."""
    device, grip = DeviceSpecification(damping=2.0, friction=0.0, resolution=0.0, delay=5e-4), GRIPS["normal"]
    loop = Loop(device, grip)
    loop.tick((KelvinVoigt(1000.0, 0.0), 1e-3))
    rest = loop.go(5e-3, 3.0)[-1]
    assert loop.run.lowest_share == 1.0
    # k (aim - x) = K (x - surface)
    assert rest == pytest.approx((400.0 * 5e-3 + 1000.0 * 1e-3) / 1400.0, abs=2e-5)


def test_what_it_does_not_carry_is_felt_as_stiff_as_it_can():
    """A wall of 100 N/mm by a device that carries 2: the hand rests where a spring of 2 N/mm would hold it."""
    device, grip = DeviceSpecification(damping=2.0, friction=0.0, resolution=0.0, delay=5e-4), GRIPS["normal"]
    loop = Loop(device, grip)
    loop.tick((KelvinVoigt(1e5, 0.0), 1e-3))
    rest = loop.go(5e-3, 3.0)[-1]
    assert rest == pytest.approx((400.0 * 5e-3 + 2000.0 * 1e-3) / 2400.0, abs=6e-5)
    assert loop.run.lowest_share == pytest.approx(0.02, rel=0.01)
