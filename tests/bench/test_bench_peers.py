"""The peers really compute the same: the same regressors, the same mu, the same P_0, the same estimates."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from foretouch.bench.benchmarks.streams import Streams
from foretouch.bench.benchmarks.updates import theta_of
from foretouch.bench.peers import (
    FORGETTING_FACTOR,
    INITIAL_COVARIANCE,
    PEERS,
    RIVER_WITHOUT_FORGETTING,
    Press,
    Problem,
    peer,
    press,
    recursion_over,
)

SIZE = 3_000


def solved(problem: Problem, forgetting_factor: float) -> NDArray[np.float64]:
    """Weighted least squares with the pull of theta_0 = 0, solved at once: no recursion."""
    size = len(problem.targets)
    weights = forgetting_factor ** (0.5 * np.arange(size - 1, -1, -1))
    pull = np.sqrt(forgetting_factor**size / INITIAL_COVARIANCE) * np.eye(4)
    rows = np.vstack([weights[:, None] * problem.regressors, pull])
    return np.linalg.lstsq(rows, np.append(weights * problem.targets, np.zeros(4)))[0]


def agree(one: NDArray[np.float64], other: NDArray[np.float64], problem: Problem) -> float:
    """The largest difference of what both say of ln F on the press."""
    return float(np.abs(problem.regressors @ (one - other)).max())


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem.of(press(SIZE))


def test_ours_and_the_bare_loop_solve_the_problem(problem: Problem) -> None:
    exact = solved(problem, FORGETTING_FACTOR)
    assert agree(theta_of(press(SIZE)), exact, problem) < 1e-6
    assert agree(recursion_over(problem), exact, problem) < 1e-6
    assert np.exp(theta_of(press(SIZE))[0]) == pytest.approx(2000.0, rel=0.2)  # the law that was pressed


@pytest.mark.filterwarnings("ignore")  # of their own house
@pytest.mark.parametrize("name", PEERS)
def test_a_peer_computes_the_same(name: str, problem: Problem) -> None:
    output: list[str] = []
    run = peer(name, problem, output.append)
    if run is None:
        pytest.skip(output[0])
    factor = 1.0 if name == RIVER_WITHOUT_FORGETTING else FORGETTING_FACTOR
    ours = theta_of(press(SIZE)) if factor < 1.0 else solved(problem, 1.0)
    assert agree(run(), ours, problem) < 1e-5
    assert np.array_equal(run(), run()), "it begins anew"


def test_a_peer_that_is_not_there_is_said_in_one_line(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "padasip", None)  # as where it is not installed
    output: list[str] = []
    assert peer("padasip", problem, output.append) is None
    assert len(output) == 1
    assert "padasip is left out" in output[0]
    assert "\n" not in output[0]


def test_many_recordings_at_once_are_each_as_one() -> None:
    streams = Streams.of(5, 400)
    assert streams.in_ours() == pytest.approx(streams.in_numpy(), rel=1e-6, abs=1e-8)
    for place, theta in enumerate(streams.in_ours()):
        one = Press(*(column[:, place] for column in streams.pressed))
        assert np.array_equal(theta, theta_of(one))
