"""After any models and any motion, a hand that has left is at rest, and nothing but a debt is kept from what was."""

from __future__ import annotations

import math

from hypothesis import given, settings
from renderer_runs import Run, parts, renderers

from foretouch.models import KelvinVoigt


@settings(derandomize=True, deadline=None, max_examples=12)
@given(renderers, parts(teleports=False, most=6))
def test_after_all_of_it_a_hand_that_has_left_is_at_rest(options, session):
    run = Run(**options)
    for seed, one in enumerate(session):
        run.play(one, seed)
    renderer = run.renderer
    if not renderer.proxy.engaged:
        run.tick(run.hand, clutch=True)
    run.tick(run.hand, ((KelvinVoigt(100.0, 0.0), 0.0),))
    for _ in range(10):  # what waits to be caught up with
        run.tick(run.hand)
    way = max((renderer.proxy.position + renderer.proxy.apart + 0.02) / options["position_scale"], 0.0)
    for number in range(1, 51):
        run.tick(run.hand - way * number / 50)
    assert renderer.proxy.apart < 0.05
    for number in range(math.ceil(renderer.proxy.apart / 1e-5) + 300):  # 10 mm/s
        force = renderer.update(run.time + 1e-3 * (number + 1), run.hand - way, 1e-3)
    assert force == 0.0
    assert renderer.mediation.offset == renderer.proxy.indexed == renderer.proxy.yielded == 0.0
    assert -renderer.booked[1] <= renderer.booked[0] <= 0.0  # what is owed stays, and no surplus
