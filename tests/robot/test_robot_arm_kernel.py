"""What is compiled of the simulated arm: the same samples as interpreted, and nothing compiled while it moves."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest

from foretouch.robot import make_robot
from foretouch.robot import servo_kernel as kernel

KERNELS = (kernel.begin, kernel.effort, kernel.sense, kernel.show, kernel.push_gantry, kernel.sense_gantry)
"""What is called from Python at each physics step."""


def shown(seed: int, ticks: int = 1500) -> list[tuple[object, ...]]:
    """Samples of an arm that is pushed deeper than its force limit lets it, and told what is no place."""
    random = np.random.default_rng(seed)
    robot, place, samples = make_robot("hunt-crossley", seed=seed), 0.0, []
    for tick in range(ticks):
        place += 1e-4 * random.normal() + 6e-5 * math.sin(0.004 * tick)
        told = {100: math.nan, 200: math.inf, 300: 1, 400: -1e300}.get(tick, place)
        samples.append(tuple(robot.exchange(told)))
    return samples


INTERPRETED = """
import sys
sys.path.insert(0, {folder!r})
from test_robot_arm_kernel import KERNELS, shown
assert not any(hasattr(one, "signatures") for one in KERNELS)
print(repr([shown(seed) for seed in range(2)]))
"""


@pytest.mark.long
def test_compiled_and_interpreted_are_equal() -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERPRETED.format(folder=os.path.dirname(__file__))],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    output = [shown(seed) for seed in range(2)]
    assert done.stdout.strip() == repr(output)  # the types too: what is sent is of Python's own
    rows = [row for run in output for row in run]
    assert {row[-2] for row in rows} == {True, False}  # the force limit has cut, and has not
    assert max(row[3] for row in rows) > 10.0


def test_nothing_is_compiled_while_it_moves() -> None:
    """Who compiles in a loop stands still for a second."""
    made = [len(getattr(one, "signatures", [None])) for one in KERNELS]
    shown(3, 400)
    assert [len(getattr(one, "signatures", [None])) for one in KERNELS] == made == [1] * len(KERNELS)
