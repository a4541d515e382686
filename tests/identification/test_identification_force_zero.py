"""Whether a recording shows where its force is zero: the same answer as scoring gives, however long it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from presses import press

from foretouch.identification import Learner, predict
from foretouch.identification import force_calibration as force_zero
from foretouch.identification.force_calibration import is_zero_unobservable
from foretouch.quantities import Recording
from foretouch.recordings import DATASETS, read_recording
from foretouch.report import delayed_force


def pressed_always(noise: float = 0.01) -> Recording:
    time = np.arange(0.0, 6.0, 1e-3)
    position = 0.01 + 0.004 * np.sin(5.0 * time)
    random = np.random.default_rng(0)
    return Recording(time, position, 600.0 * position + random.normal(0.0, noise, time.size))


NEVER_LET_GO = {"tue/a-spring", "tue/b-spring", "tue/d-spring"}


def silent() -> Recording:
    time = np.arange(0.0, 6.0, 1e-3)
    return Recording(time, 0.01 * np.sin(time), np.random.default_rng(0).normal(0.0, 0.01, time.size))


@pytest.mark.parametrize(("block", "overlap"), [(1 << 18, 1 << 15), (1000, 200), (1001, 500)])
def test_pressed_always_sometimes_and_never(monkeypatch: pytest.MonkeyPatch, block: int, overlap: int) -> None:
    monkeypatch.setattr(force_zero, "BLOCK", block)
    monkeypatch.setattr(force_zero, "OVERLAP", overlap)
    assert is_zero_unobservable(pressed_always())
    assert not is_zero_unobservable(press(noise=0.02))
    assert not is_zero_unobservable(silent())


@pytest.mark.parametrize("size", [5999, 6000, 6001])
def test_blocks_give_the_lowest_mean_of_all(monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    recording = press(noise=0.02, duration=6.1)
    time, force = recording.time[:size], recording.force[:size]
    whole = force_zero.lowest_mean(time, force)
    monkeypatch.setattr(force_zero, "BLOCK", 1000)
    monkeypatch.setattr(force_zero, "OVERLAP", 100)
    assert force_zero._lowest(time, force, 1.0, 0.05) == pytest.approx(whole, abs=1e-12)
    assert force_zero._lowest(time, force, -1.0, 0.05) == pytest.approx(force_zero.lowest_mean(time, -force), abs=1e-12)


@pytest.mark.parametrize("name", DATASETS)
@pytest.mark.long
def test_measured_recordings(measured: Callable[[str], Path], name: str) -> None:
    """Three springs are preloaded and never let go."""
    assert is_zero_unobservable(read_recording(measured(name))) == (name in NEVER_LET_GO)


@pytest.mark.parametrize("name", sorted(NEVER_LET_GO))
@pytest.mark.first
def test_a_zero_that_is_not_known_makes_nothing_else_wrong(measured: Callable[[str], Path], name: str) -> None:
    """A force that is predicted, and the zero that it counts from, are together the one that the sensor will give.

    That zero is the lowest force so far: while the spring is let out further it moves, and the predicted force with it.
    """
    recording, delay = read_recording(measured(name)), 0.3
    learner, zeros = Learner(contact_floor=recording.contact_floor), []
    for time, position, force in zip(recording.time, recording.position, recording.force, strict=True):
        learner.update(time, position, force)
        zeros.append(learner.conditioner.force_offset)
    known = delayed_force(recording.time, np.array(zeros), delay)
    predicted = predict(recording, Learner(contact_floor=recording.contact_floor), delay=delay).force
    pressed = (recording.time > recording.time[0] + 1.5) & (predicted > 0.0)
    error = (predicted + known - recording.force)[pressed]
    true = (recording.force - force_zero.lowest_mean(recording.time, recording.force))[pressed]
    assert np.sqrt(np.mean(error**2)) < 0.03 * np.sqrt(np.mean(true**2))
    assert np.std(known[pressed]) > 0.8 * np.std((predicted - recording.force)[pressed])
