"""No stream of models and no motion breaks what rendering promises; the limits of energy and step are reckoned anew."""

from __future__ import annotations

import itertools
import math
import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from renderer_runs import NEVER, Latch, Part, Run, Sticky, parts, renderers

from foretouch.devices import DeviceSpecification
from foretouch.models import HuntCrossley, KelvinVoigt

quick = settings(derandomize=True, deadline=None, max_examples=25)
SOFT, STIFF = KelvinVoigt(100.0, 0.0), KelvinVoigt(1e6, 5.0)
DEVICE = DeviceSpecification(damping=2.0, delay=5e-4)


def part(ticks=30, motion="smooth", size=2e-3, model=STIFF, other=NEVER, surfaces=(0.0, 0.0), **rest):
    numbers = {"state": (), "late": 0, "clutch": False, "period": 1e-3} | rest
    return Part(ticks, motion, size, model, other, surfaces, **numbers)


def play(options, session):
    run = Run(**options)
    for seed, one in enumerate(session):
        run.play(one, seed)


@quick
@given(renderers, parts())
@example({"device": DEVICE}, [part(), part(motion=9.0), part(motion=math.nan), part(motion="wild", other=None)])
@example({"device": DEVICE}, [part(model=SOFT), part(clutch=True, other=STIFF), part(clutch=True, motion="wild")])
@example({"device": None, "guarded": True}, [part(model=SOFT), part(surfaces=(-4e-3, 4e-3), other=SOFT)])
@example({"device": DEVICE}, [part(model=Latch(1e3, 0.0)), part(motion="wild"), part(30, "smooth", 1e-2)])
def test_no_stream_of_models_and_no_motion_breaks_a_promise(options, session):
    play(options, session)


@pytest.mark.long
@settings(derandomize=True, deadline=None, max_examples=250)
@given(renderers, parts())
def test_nor_does_any_of_hundreds(options, session):
    play(options, session)


@pytest.mark.parametrize("delay", [0.0, 1e-3])
def test_a_hand_that_goes_in_before_it_catches_and_out_after_it_takes_no_more_than_the_bound(delay):
    """25 times a second 2 mm in and out of what catches at 1 mm, and would give back more than was put in."""
    run, ran = Run(DeviceSpecification(damping=2.0, delay=delay)), 0.0
    run.adopt(Latch(500.0, 0.0), -2e-3)
    for number in range(1000):
        run.tick(1e-3 * (1.0 - math.cos(0.157 * number)))
        ran = max(ran, run.renderer.mediation.force)
    assert ran > 1.0
    assert 0.8 < run.largest_debt <= 1.0


STICKY = DeviceSpecification(damping=2.0, delay=5e-4, pulls=True)


def test_a_hand_that_leaves_is_held_and_drawn_in_by_what_it_has_paid():
    """4 mm in and out of what pulls with 2 N and holds for ever: nobody has paid for the first way in."""
    run = Run(STICKY)
    run.adopt(Sticky(1000.0, 2.0), -2e-3)
    forces = [run.tick(2e-3 * (1.0 - math.cos(0.005 * math.pi * number))) for number in range(800)]
    first_in, out, again = forces[:100], forces[300:401], forces[400:500]
    assert min(first_in) == 0.0
    assert min(out) == pytest.approx(-2.0)
    assert min(again) == pytest.approx(-2.0)
    assert run.largest_debt <= 1.0


def test_a_hand_that_goes_to_and_fro_before_something_sticky_is_never_drawn_in_for_nothing():
    """25 times a second in where it catches, and out where it has let go."""
    run = Run(STICKY)
    run.adopt(Sticky(10.0, 5.0), -2e-3)
    for number in range(1000):
        run.tick(3e-3 * (1.0 - math.cos(0.157 * number)) - 4e-3)
    assert run.largest_pull > 0.05
    assert run.largest_debt <= 1.0


@pytest.mark.parametrize("model", [Sticky(1000.0, 2.0), Sticky(0.1, 9.0)])
def test_a_device_that_does_not_pull_is_given_none(model):
    run = Run(DEVICE)
    run.adopt(model, -2e-3)
    forces = [run.tick(2e-3 * (1.0 - math.cos(0.0157 * number))) for number in range(800)]
    assert min(forces) == 0.0


@pytest.mark.parametrize("closed", [True, False])
def test_a_long_wild_run_comes_near_its_bounds_and_never_past_them(closed):
    """No promise is kept by a distance: mediation uses up its half of the bound, models change as much as they may."""
    run, numbers = Run(DEVICE if closed else None), random.Random(3)
    for seed in range(30):
        motion = numbers.choice(("wild", "smooth", "noise", "rest"))
        model, other = numbers.choice(((SOFT, STIFF), (STIFF, None), (HuntCrossley(1e4, 100.0, 1.4), SOFT)))
        surfaces = (numbers.uniform(-2e-3, 0.0), numbers.uniform(-2e-3, 0.0))
        run.play(part(40, motion, 10 ** numbers.uniform(-4, -2), model, other, surfaces), seed)
    assert 0.5 < run.largest_debt <= 1.0
    assert 0.079 < run.largest_step <= 0.1


@settings(quick, max_examples=15)
@given(st.booleans(), st.lists(st.tuples(st.floats(1.0, 6.0), st.floats(0.0, 2.0), st.floats(-3e-3, 3e-3)), min_size=3))
def test_a_hand_that_holds_still_is_not_jerked(guarded, models):
    """Nothing but models, and what is given back because of them, changes the force: by 0.1 N in a tick at most."""
    run = Run(DEVICE, guarded=guarded)
    for number in range(200):  # a press, and then as long a rest as the velocity takes to be none
        run.tick(min(1e-4 * number, 4e-3))
    forces = []
    for size, damping, surface in models:
        model = KelvinVoigt(10.0**size, 10.0**damping)
        for number in range(20):
            run.tick(4e-3, ((model, surface),) if number == 0 else ())
            forces.append(run.renderer.mediation.force)
    assert max(abs(after - before) for before, after in itertools.pairwise(forces)) <= 0.1
