"""The watch over the sensors: every fault is found in time, and nothing where there is none."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.identification import SENSOR_SENTENCES, SensorState, SensorWatch
from foretouch.recordings import DATASETS, FORCE_CHANNELS, read_recording
from foretouch.robot import MATERIALS, make_robot

PERIOD = 1e-3
Sample = tuple[float, float, float]


def free_air(count: int = 2000, seed: int = 0, speed: float = 0.0) -> list[Sample]:
    """A noisy sensor in free air, still or moving to and fro."""
    random = np.random.default_rng(seed)
    time = PERIOD * np.arange(count)
    position = -0.02 + 0.005 * np.sin(speed / 0.005 * time) + random.normal(0.0, 2e-6, count)
    return list(zip(time.tolist(), position.tolist(), (0.3 + random.normal(0.0, 0.02, count)).tolist(), strict=True))


def states(samples: list[Sample], watch: SensorWatch | None = None) -> list[SensorState]:
    watch = SensorWatch((-50.0, 50.0)) if watch is None else watch
    return [watch.update(*sample) for sample in samples]


def off(samples: list[Sample], begin: int, end: int, *, position: float = 0.0, force: float = 0.0) -> list[Sample]:
    """Samples of which some are off by this."""
    wrong = [(time, place + position, felt + force) for time, place, felt in samples[begin:end]]
    return samples[:begin] + wrong + samples[end:]


@pytest.mark.parametrize("speed", [0.0, 0.04])
def test_good_sensors_are_good(speed: float) -> None:
    assert set(states(free_air(speed=speed))) == {SensorState.GOOD}


@pytest.mark.parametrize("late", [0.005, 0.03, 0.06, 0.09])
def test_a_loop_that_is_held_up_is_no_dropout(late: float) -> None:
    """Samples that come late are new all the same."""
    held = [(time + late * (index // 100), *rest) for index, (time, *rest) in enumerate(free_air())]
    assert set(states(held)) == {SensorState.GOOD}


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize("column", [0, 1, 2])
def test_what_is_no_number_is_found_at_once_and_passes_in_half_a_second(bad: float, column: int) -> None:
    samples = free_air()
    samples[1000] = tuple(bad if place == column else value for place, value in enumerate(samples[1000]))  # type: ignore[assignment]
    result = states(samples)
    assert result.index(SensorState.NOT_FINITE) == 1000
    assert set(result[1000:1490]) == {SensorState.NOT_FINITE}
    assert set(result[1510:]) == {SensorState.GOOD}


@pytest.mark.parametrize("size", [1.0, -1.0, 30.0])
def test_a_spike_is_found_a_sample_later_and_passes(size: float) -> None:
    result = states(off(free_air(), 1000, 1001, force=size))
    assert result.index(SensorState.SPIKE) == 1001
    assert result[1490] is SensorState.SPIKE
    assert set(result[1510:]) == {SensorState.GOOD}


def test_a_blow_that_slows_the_probe_is_no_spike() -> None:
    """One sample of 20 N on 0.1 kg takes 0.2 m/s."""
    for slower, states_found in ((0.2, {SensorState.GOOD}), (0.0, {SensorState.GOOD, SensorState.SPIKE})):
        samples = [
            (time, -0.1 + PERIOD * (0.3 * index - slower * max(index - 500, 0)), force)
            for index, (time, _, force) in enumerate(free_air(1000))
        ]
        assert set(states(off(samples, 500, 501, force=20.0))) == states_found


def test_a_sensor_that_hangs() -> None:
    samples = free_air(speed=0.04)
    hung = [(time, position, samples[min(index, 999)][2]) for index, (time, position, _) in enumerate(samples)]
    result = states(hung)
    assert result.index(SensorState.STUCK) in (1098, 1099, 1100)
    assert set(result[1100:]) == {SensorState.STUCK}  # stays
    lost = states(samples[:1000] + [(time, *samples[999][1:]) for time, *_ in samples[1000:1200]] + samples[1200:])
    assert lost.index(SensorState.DROPOUT) in (1018, 1019, 1020)
    assert lost[1690] is SensorState.DROPOUT
    assert set(lost[1710:]) == {SensorState.GOOD}


def test_repetition_alone_is_no_fault() -> None:
    """Without noise a sensor may stand; one of few bits, or of a slower rate, repeats."""
    silent = [(PERIOD * index, 0.0, 0.3) for index in range(2000)]
    assert set(states(silent)) == {SensorState.GOOD}
    smooth = [(PERIOD * index, 0.0, 0.3 + math.sin(min(index, 700) * PERIOD)) for index in range(2000)]
    assert set(states(smooth)) == {SensorState.GOOD}
    slow = free_air(5000)
    slow = [(time, position, slow[index - index % 12][2]) for index, (time, position, _) in enumerate(slow)]
    held = [(time, slow[index - index % 12][1], force) for index, (time, _, force) in enumerate(slow)]
    assert set(states(slow)) == {SensorState.GOOD}
    assert set(states(held)) == {SensorState.GOOD}
    coarse = [(time, round(position, 5), round(force, 2)) for time, position, force in free_air(5000)]
    assert set(states(coarse)) == {SensorState.GOOD}


@pytest.mark.parametrize("end", [49.5, -49.5, 80.0])
def test_the_end_of_the_range_is_found_from_two_samples_and_stays(end: float) -> None:
    samples = free_air()
    result = states(samples[:1000] + [(time, place, end) for time, place, _ in samples[1000:1100]] + samples[1100:])
    assert result.index(SensorState.SATURATED) == 1001
    assert set(result[1001:]) == {SensorState.SATURATED}


def test_an_unknown_end_is_never_reached() -> None:
    high = off(free_air(), 1000, 1100, force=60.0)
    assert SensorState.SATURATED not in states(high, SensorWatch((-50.0, math.inf)))
    assert SensorState.SATURATED in states(high, SensorWatch((-math.inf, 50.0)))


@pytest.mark.parametrize("step", [0.4, -0.4, 5.0, -5.0])
def test_a_step_of_the_offset_of_a_still_probe(step: float) -> None:
    result = states(off(free_air(), 1000, 2000, force=step))
    assert 1045 <= result.index(SensorState.OFFSET_STEP) <= 1055
    assert result[-1] is SensorState.OFFSET_STEP


@pytest.mark.parametrize("step", [1.0, 5.0, -1.0])
@pytest.mark.parametrize("begin", [2100, 2300, 2500, 2700])
def test_a_step_of_the_offset_of_a_moving_probe_shows_as_it_leaves(step: float, begin: int) -> None:
    result = states(off(free_air(4000, speed=0.04), begin, 4000, force=step))
    assert result.index(SensorState.OFFSET_STEP) - begin < 1000
    assert set(result[:begin]) == {SensorState.GOOD}


def test_an_encoder_that_jumps_is_believed_again_after_a_reset() -> None:
    watch = SensorWatch()
    result = states(off(free_air(), 1000, 2000, position=2e-3), watch)
    assert result.index(SensorState.ENCODER_JUMP) == 1000
    assert result[-1] is SensorState.ENCODER_JUMP
    assert watch.state is SensorState.ENCODER_JUMP
    watch.reset()
    assert watch.state is SensorState.GOOD
    assert set(states(free_air(), watch)) == {SensorState.GOOD}


def test_every_state_has_its_sentence() -> None:
    assert set(SENSOR_SENTENCES) == set(SensorState)
    assert len(set(SENSOR_SENTENCES.values())) == len(SensorState)


NUMBERS = st.one_of(st.floats(), st.floats(-1.0, 1.0), st.sampled_from([0.0, 1e-3, 5e5, -5e5]))


@given(st.lists(st.tuples(st.floats(0.0, 0.2) | st.floats(), NUMBERS, NUMBERS, NUMBERS), max_size=200))
def test_nothing_makes_it_raise(values: list[tuple[float, float, float, float]]) -> None:
    watch, time = SensorWatch((-10.0, 10.0)), 0.0
    for step, position, force, tool_force in values:
        time += step if math.isfinite(step) and abs(step) < 1.0 else 0.0
        state = watch.update(time if math.isfinite(step) else step, position, force, tool_force)
        assert state is watch.state


def test_bad_settings_are_refused() -> None:
    for bad in ((5.0, -5.0), (math.nan, 5.0)):
        with pytest.raises(SettingError, match="force_range"):
            SensorWatch(bad)
    with pytest.raises(SettingError, match="largest_speed"):
        SensorWatch(largest_speed=0.0)


# --- no false alarms --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "channel"),
    [(name, channel) for name in DATASETS for channel in (FORCE_CHANNELS if name.startswith("tue/") else ("raw",))],
)
def test_measured_sensors_are_good(name: str, channel: str, measured: Callable[[str], Path]) -> None:
    recording = read_recording(measured(name), force_channel=channel)
    columns = (recording.time.tolist(), recording.position.tolist(), recording.force.tolist())
    assert set(states(list(zip(*columns, strict=True)), SensorWatch())) == {SensorState.GOOD}


def motions(seed: int) -> Iterator[tuple[str, Callable[[int, float], float]]]:
    """Presses, blows at full speed, chatter at the surface, random steps: position over tick and time."""
    steps = np.random.default_rng(seed).uniform(-0.01, 0.02, 100)
    yield "presses", lambda tick, time: 0.004 * math.sin(9.0 * time)
    yield "blows", lambda tick, time: 0.01 if int(time * 5.0) % 2 else -0.01
    yield "chatter", lambda tick, time: 0.001 * math.sin(2.0 * math.pi * 25.0 * time)
    yield "steps", lambda tick, time: float(steps[tick // 150])


@pytest.mark.parametrize(
    "material",
    [
        pytest.param(name, marks=[] if name in ("bone", "kelvin-voigt", "sponge") else pytest.mark.long)
        for name in MATERIALS
    ],
)
def test_a_simulated_sensor_is_good_whatever_it_hits(material: str) -> None:
    for seed, (name, motion) in enumerate(motions(7)):
        robot = make_robot(material, seed=seed)
        specification = robot.specification
        watch = SensorWatch((-specification.sensor_range, specification.sensor_range))
        for tick in range(2500):
            sample = robot.exchange(robot.surface + motion(tick, tick * PERIOD))
            tool_force = specification.tool_force(sample.acceleration)
            state = watch.update(tick * PERIOD, sample.position, sample.sensor_force, tool_force)
            assert state is SensorState.GOOD, f"{name}: {SENSOR_SENTENCES[state]} at {tick * PERIOD:.3f} s"


@pytest.mark.parametrize(("floor", "found"), [(0.0, SensorState.OFFSET_STEP), (1.5, SensorState.GOOD)])
def test_a_step_of_friction_is_no_fault_of_a_robot_that_shows_friction(floor: float, found: SensorState) -> None:
    """A joint that turns around shows its friction as another force, of a size that its robot says."""
    result = states(off(free_air(), 1000, 2000, force=1.2), SensorWatch((-50.0, 50.0), contact_floor=floor))
    assert result[-1] is found


@pytest.mark.parametrize(("floor", "found"), [(0.0, SensorState.CONTACT_LOST), (1.5, SensorState.GOOD)])
def test_a_force_that_falls_by_the_friction_is_no_lost_contact(floor: float, found: SensorState) -> None:
    """It falls from 2.5 to 0.2 N within 6 ms while the probe stays."""
    felt = np.interp(np.arange(60), [20, 26], [2.5, 0.2]).tolist()
    watch = SensorWatch((-50.0, 50.0), contact_floor=floor)
    result = [watch.update(PERIOD * tick, 0.01, force, zero=0.0) for tick, force in enumerate(felt)]
    assert result[-1] is found
    assert watch.update(0.06, 0.01, 0.2, zero=0.0) is found
