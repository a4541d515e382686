"""A recording in one compiled loop: what a learner makes of it is what it makes of it sample by sample, bit for bit."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from presses import press

from foretouch.errors import InputError, RecordingError
from foretouch.identification import ContactMap, KelvinVoigtRLS, Learner, Status, identify, make_estimator, predict
from foretouch.identification.learner import BLOCK, RawSamples, run_by_sample
from foretouch.models import MotionFilter
from foretouch.quantities import Recording
from foretouch.recordings import read_recording


def columns(recording: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    return recording.time, recording.position, recording.force, recording.velocity


def both(recording: Recording, **options: float) -> tuple[Learner, np.ndarray]:
    """Sample by sample and in one loop; everything that is told and remembered is compared."""
    one, whole = Learner(ContactMap(), **options), Learner(ContactMap(), **options)
    slow, fast = run_by_sample(one, RawSamples(*columns(recording))), whole.run(*columns(recording))
    for name in ("in_contact", "contact_force_rms", "residual", "standard_deviation"):
        np.testing.assert_array_equal(getattr(fast, name), getattr(slow, name), name)
    assert_alike(one, whole)
    return whole, fast.residual


def assert_alike(one: Learner, whole: Learner) -> None:
    assert whole.estimator.states.tobytes() == one.estimator.states.tobytes()
    for mine, its in zip(whole.conditioner.memory, one.conditioner.memory, strict=True):
        assert mine.tobytes() == its.tobytes()
    assert whole.lag.records.tobytes() == one.lag.records.tobytes()
    np.testing.assert_array_equal(whole.sample, one.sample)
    conditioner, known = one.conditioner, whole.conditioner
    for name in ("surface", "surface_error", "force_offset", "in_contact"):
        np.testing.assert_array_equal(getattr(known, name), getattr(conditioner, name), name)
    assert whole.status is one.status
    assert (whole.estimator.updates, whole.estimator.changes) == (one.estimator.updates, one.estimator.changes)
    assert whole.learnt().model == one.learnt().model


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"surface": 0.01},
        {"force_offset": 0.3},
        {"surface": 0.0102, "force_offset": 0.28, "contact_floor": 0.2},
        {"sensor_lag": 0.004},
        {"sensor_lag": 0.05, "surface": 0.01},
    ],
)
def test_a_press_with_what_is_given_of_it(options: dict[str, float]) -> None:
    learner, residual = both(press(noise=0.02), **options)
    assert np.isfinite(residual).sum() > 1000
    assert learner.estimator.updates > 500


@pytest.mark.parametrize("rate", [90.0, 1000.0, 10_000.0])
def test_any_rate_and_more_samples_in_the_window_than_there_was_room_for(rate: float) -> None:
    both(press(noise=0.02, rate=rate, duration=3.0), sensor_lag=0.05)


def test_measured_velocities() -> None:
    recording = press(noise=0.02)
    velocity = 1.1 * MotionFilter().run(recording.time, recording.position)
    given = Recording(recording.time, recording.position, recording.force, velocity)
    without, with_velocity = both(recording)[1], both(given)[1]
    assert not np.array_equal(without, with_velocity, equal_nan=True)


@pytest.mark.parametrize("scale", [pytest.param(0.0, marks=pytest.mark.long), 3.0])
def test_a_material_that_changes_or_goes(scale: float) -> None:
    """Where the material goes, the surface is looked for again and the sums of the lag begin anew."""
    recording = press(noise=0.01, duration=20.0)
    force = np.where(recording.time < 14.0, recording.force, 0.3 + scale * (recording.force - 0.3))
    learner, _ = both(Recording(recording.time, recording.position, force))
    assert learner.estimator.changes > 0
    moved = recording.position + np.where(recording.time < 14.0, 0.0, 0.004)
    both(Recording(recording.time, moved, recording.force))


def test_an_offset_that_falls_with_each_sample() -> None:
    """Every sample is an event that the map is told of; the first contacts are none, and the map begins anew."""
    recording = press(noise=0.01, duration=4.0)
    drift = 2.0 * np.exp(-recording.time)
    both(Recording(recording.time, recording.position, recording.force + drift))


def test_more_than_one_block_and_in_pieces() -> None:
    recording = press(noise=0.02, duration=1.1 * BLOCK / 1000.0)
    one, residual = both(recording)
    pieces = Learner(ContactMap())
    begin, result = 0, []
    for end in (1, 700, 12_345, len(recording)):
        part = [None if column is None else column[begin:end] for column in columns(recording)]
        result.append(pieces.run(*part).residual)  # type: ignore[arg-type]
        begin = end
    assert_alike(one, pieces)
    np.testing.assert_array_equal(np.concatenate(result), residual)


def test_nothing_touched() -> None:
    time = np.arange(0.0, 3.0, 1e-3)
    force = np.random.default_rng(0).normal(0.1, 0.005, time.size)
    recording = Recording(time, 0.01 * np.sin(time), force)
    learner, residual = both(recording)
    assert np.isnan(residual).all()
    assert learner.learnt().reason == "nothing has been touched yet"
    with pytest.raises(RecordingError, match="0 samples in contact"):
        identify(recording, Learner(ContactMap()))


@settings(max_examples=15, deadline=None)
@given(
    bad=st.lists(
        st.tuples(
            st.integers(0, 1999), st.integers(0, 2), st.sampled_from([np.nan, np.inf, -np.inf, 1e300, -5.0, 0.0, 40.0])
        ),
        max_size=8,
    )
)
def test_no_numbers_and_wild_ones(bad: list[tuple[int, int, float]]) -> None:
    """What a sensor says when it breaks: times that go back, infinities, forces beyond 32 bits."""
    recording = press(noise=0.02, duration=2.0)
    rows = [np.array(column) for column in columns(recording)[:3]]
    for place, column, value in bad:
        rows[column][place] = value
    one, whole = Learner(ContactMap()), Learner(ContactMap())
    slow, fast = run_by_sample(one, RawSamples(*rows, None)), whole.run(*rows)
    np.testing.assert_array_equal(fast.residual, slow.residual)
    np.testing.assert_array_equal(fast.in_contact, slow.in_contact)
    assert_alike(one, whole)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        *((name, {}) for name in ("tue/a-foam", "tue/a-rigid", "tue/a-free-motion", "aurora/600-mN")),
        ("tue/a-rigid", {"sensor_lag": 0.003}),
        *(
            pytest.param(name, {"sensor_lag": 0.003}, marks=pytest.mark.long)
            for name in ("tue/a-foam", "tue/a-free-motion", "aurora/600-mN")
        ),
    ],
)
def test_measured_recordings(measured: Callable[[str], Path], name: str, options: dict[str, float]) -> None:
    recording = read_recording(measured(name))
    both(recording, contact_floor=recording.contact_floor, **options)


@pytest.mark.parametrize(
    "names", [("contact-map", "bank"), ("continuous-switching", "exact"), ("hunt-crossley", "exact")]
)
@pytest.mark.first
def test_the_history_is_of_the_same_identification(names: tuple[str, str]) -> None:
    """With and without the parameters after every sample: two paths for the bank, one for others."""
    recording = press(noise=0.02, duration=3.0)
    without = identify(recording, Learner(make_estimator(*names)))
    kept = identify(recording, Learner(make_estimator(*names)), keep_history=True)
    np.testing.assert_array_equal(without.residual, kept.residual)
    np.testing.assert_array_equal(without.in_contact, kept.in_contact)
    assert without.model == kept.model
    assert without.parameters == kept.parameters
    assert without.contact_force_rms == kept.contact_force_rms
    np.testing.assert_array_equal(
        (without.surface, without.force_offset, without.standard_deviation, without.surface_error),
        (kept.surface, kept.force_offset, kept.standard_deviation, kept.surface_error),
    )
    assert (without.sensor_lag, without.sensor_lag_error) == (kept.sensor_lag, kept.sensor_lag_error)
    assert not without.history
    assert kept.history["stiffness"].shape == recording.time.shape


def test_the_residual_is_that_of_the_model_before() -> None:
    """Against `learnt` and `advance` by hand, at places along the recording."""
    from foretouch.models import advance

    recording = press(noise=0.02, duration=4.0)
    residual = Learner(ContactMap()).run(*columns(recording)).residual
    learner, seen, before = Learner(ContactMap()), 0, recording.time[0]
    for index, (time, position, force) in enumerate(zip(*columns(recording)[:3], strict=True)):
        learnt = learner.learnt()
        sample = learner.update(time, position, force)
        if np.isfinite(residual[index]):
            assert learnt.model is not None
            _, expected, _ = advance(
                learnt.model, learnt.state, position - learnt.surface, sample.velocity, time - before
            )
            assert residual[index] == sample.force - expected
            seen += 1
        before = time
    assert seen > 500


def test_columns_of_unlike_length_are_refused() -> None:
    with pytest.raises(InputError, match="columns of one length"):
        Learner(ContactMap()).run(np.zeros(3), np.zeros(3), np.zeros(2))
    empty = Learner(ContactMap()).run(np.zeros(0), np.zeros(0), np.zeros(0))
    assert empty.residual.shape == (0,)


INTERPRETED = """
import sys; sys.path.insert(0, {tests!r})
import numpy as np
from presses import press
from foretouch.identification import ContactMap, Learner
from foretouch.identification.learner import RawSamples, run_by_sample
recording = press(noise=0.02, duration=1.5, rate=300.0, deepest=0.003)
given = recording.time, recording.position, recording.force, None
one, whole = Learner(ContactMap(), sensor_lag=0.01), Learner(ContactMap(), sensor_lag=0.01)
slow, fast = run_by_sample(one, RawSamples(*given)), whole.run(*given)
np.testing.assert_array_equal(fast.residual, slow.residual)
assert whole.estimator.states.tobytes() == one.estimator.states.tobytes()
print(int(np.isfinite(fast.residual).sum()), repr(float(whole.conditioner.surface)), whole.conditioner.force_offset)
"""


@pytest.mark.long
def test_interpreted_it_is_the_same() -> None:
    script = INTERPRETED.format(tests=str(Path(__file__).parent))
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    compiled = io.StringIO()
    with contextlib.redirect_stdout(compiled):
        exec(script, {})
    assert compiled.getvalue() == done.stdout
    assert int(done.stdout.split()[0]) > 20


def test_the_status_after_a_run_is_that_of_the_newest_sample() -> None:
    recording = press(duration=2.0)
    learner = Learner(ContactMap())
    learner.run(recording.time[:500], recording.position[:500], recording.force[:500])
    assert learner.status is Status.FREE_AIR
    assert learner.sample.time == recording.time[499]


@pytest.mark.long
def test_an_estimator_alone_and_none_stand_for_a_learner() -> None:
    recording = dataclasses.replace(press(noise=0.02, duration=3.0), contact_floor=0.2)
    assert isinstance(Learner().estimator, ContactMap)
    whole = Learner(ContactMap(), contact_floor=0.2)
    assert identify(recording) == identify(recording, ContactMap()) == identify(recording, whole)
    one, other = predict(recording, KelvinVoigtRLS(), delay=0.1), Learner(KelvinVoigtRLS(), contact_floor=0.2)
    assert one == predict(recording, other, delay=0.1)
    assert predict(recording, delay=0.1) == predict(recording, Learner(contact_floor=0.2), delay=0.1)
