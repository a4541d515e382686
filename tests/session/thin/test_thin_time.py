"""What a thin link takes of a tick."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest
from thin_serial import SerialLink
from thin_ticks import MS, command_at, telemetry_at

from foretouch.session.thin import FollowerEnd, LeaderEnd


@pytest.mark.parametrize("space", [False, True])
def test_what_an_end_takes_of_a_tick(space: bool) -> None:
    """It is told and not required: a busy machine has a part in it."""
    leader, follower = LeaderEnd(2000.0), FollowerEnd(2000.0)
    forth, back = SerialLink(1e9), SerialLink(1e9)
    took: dict[str, list[float]] = {"leader": [], "follower": []}
    for tick in range(1, 6000):
        now_ns = tick * MS
        command, telemetry = command_at(tick, space=space), telemetry_at(tick, space=space)
        for name, end, message, coming, going in (
            ("follower", follower, telemetry, forth, back),
            ("leader", leader, command, back, forth),
        ):
            packets = coming.pop_due(now_ns)
            begun = time.perf_counter_ns()
            end.heard(packets, now_ns)
            said = end.said([message], now_ns)
            took[name].append(1e-3 * (time.perf_counter_ns() - begun))
            for packet in said[1:]:
                going.push(now_ns, packet)
    for name, all_took in took.items():
        median, most = np.quantile(all_took[500:], (0.5, 0.99))
        sys.stdout.write(f"{'in space' if space else 'along a line'}, {name}: {median:.1f} us, 99 % {most:.1f} us\n")
    assert len(forth.waiting) + len(back.waiting) <= 2
