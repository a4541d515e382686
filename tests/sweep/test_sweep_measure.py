import numpy as np
import pytest
from numpy.typing import NDArray

from foretouch.sweep.outcome import felt_stiffness

Array = NDArray[np.float64]


def press(fraction: float, *, depth: float = 5e-3, samples: int = 1000, apart: float = 0.0) -> tuple[Array, ...]:
    """In and out of a spring of 300 N/m, felt by this fraction; the hand's zero is `apart` from the probe's."""
    probe = 0.02 + depth * np.sin(np.linspace(0.0, np.pi, samples))
    force = 300.0 * (probe - 0.02)
    return probe + apart, fraction * force, probe, force


def test_felt_stiffness_does_not_see_how_far_hand_and_probe_are_apart() -> None:
    assert felt_stiffness([press(0.5), press(0.5, apart=0.03)]) == pytest.approx(50.0)


def test_felt_stiffness_is_the_median_of_presses() -> None:
    assert felt_stiffness([press(0.9), press(1.0, apart=-0.01), press(0.0)]) == pytest.approx(90.0)


@pytest.mark.parametrize("presses", [[], [press(1.0, samples=150)], [press(1.0, depth=5e-4)]])
def test_felt_stiffness_of_short_presses_is_not_told(presses: list[tuple[Array, ...]]) -> None:
    assert felt_stiffness(presses) is None
    assert felt_stiffness([*presses, press(0.7)]) == pytest.approx(70.0)
