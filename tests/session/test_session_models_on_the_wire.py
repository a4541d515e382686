"""Models on their way: how many bytes, when at once, and how soon a lost one is made good."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.devices import ScriptedOperator
from foretouch.identification import ContactSample, Estimator, Learner, Status
from foretouch.identification.contact_map.bank import ContactMap
from foretouch.messages import VERSION, Command, ModelUpdate, SessionLog, encode
from foretouch.models import ContactModel, KelvinVoigt, make_model
from foretouch.models.predictor import STATE_TOLERANCE
from foretouch.report import session_figures
from foretouch.robot import FaultySensor, RobotSample, SensorFault, make_robot
from foretouch.session import SessionSettings, replay, simulate
from foretouch.session.network.round_trip import RoundTrip
from foretouch.session.steps import follower, leader

MS = 1_000_000
SURFACE = 0.01


def simulated(duration: float = 8.0, **changes: Any) -> SessionLog:
    return simulate(SessionSettings(**changes), duration=duration).log


def bytes_in_worst_second(models: list[ModelUpdate]) -> int:
    time = np.array([model.time_ns for model in models])
    total = np.concatenate(([0], np.cumsum([len(encode(model)) for model in models])))
    until = np.searchsorted(time, time + 1_000_000_000, side="left")
    return int((total[until] - total[:-1]).max())


class Pressing:
    """A follower that presses a spring in sines, tick by tick; its stiffness [N/m] changes at given ticks."""

    def __init__(self, estimator: Estimator, stiffnesses: dict[int, float]) -> None:
        self.specification = make_robot("foam-measured", seed=0).specification
        self.state = follower.start(self.specification, SessionSettings(), estimator)
        self.stiffnesses, self.stiffness, self.tick = stiffnesses, 0.0, 0

    def step(self) -> ModelUpdate | None:
        self.stiffness = self.stiffnesses.get(self.tick, self.stiffness)
        position = SURFACE + 0.006 * float(np.sin(2.0 * np.pi * 0.9e-3 * self.tick - 1.2))
        force = self.stiffness * max(position - SURFACE, 0.0)
        hanging = self.specification.gravity  # falling with gravity, the tool weighs nothing
        sample = RobotSample(position, force, hanging, force, position, position, False)
        command = Command(
            VERSION, self.tick + 1, self.tick * MS, position, self.state.sender.sequence, False, "hand", 1
        )
        self.state, outputs = follower.step(self.state, follower.Inputs([command], sample, MS, 0), self.tick * MS)
        self.tick += 1
        return outputs.model

    def run(self, ticks: int) -> list[ModelUpdate]:
        return [model for model in (self.step() for _ in range(ticks)) if model is not None]


class Flickering(Estimator):
    name = "flickering"
    model_name = "kelvin-voigt"
    standard_errors = None
    updates = 0

    def update(self, sample: ContactSample) -> Status:
        self.updates += 1
        return Status.LEARNT

    def reset(self) -> None:
        self.updates = 0

    @property
    def model(self) -> ContactModel | None:
        return KelvinVoigt(500.0, 1.0) if self.updates % 2 else None


class Counting(ContactMap):
    asked = 0

    @property
    def model(self) -> ContactModel | None:
        self.asked += 1
        return super().model


@pytest.fixture(scope="module")
def session() -> SessionLog:
    return simulated(6.0, material="foam-measured")


def test_a_session_s_models_stay_within_fifty_kilobytes_a_second_and_are_packed_for_sending_alone(
    session: SessionLog,
) -> None:
    assert bytes_in_worst_second(list(session.models)) <= 50_000
    sizes = [len(encode(model)) for model in session.models]
    output = session_figures(session)["model_bytes"]
    assert output == {"per_s": pytest.approx(sum(sizes) / 5.999), "p50": np.median(sizes), "max": max(sizes)}
    estimator = Counting()
    models = Pressing(estimator, {0: 500.0}).run(5000)
    assert len(models) > 230
    assert estimator.asked <= len(models) + 50


@pytest.mark.parametrize(
    ("law", "told"),
    [
        ("contact-map", True),
        ("continuous-switching", False),
        pytest.param("hunt-crossley", True, marks=pytest.mark.long),
    ],
)
@pytest.mark.first
def test_models_carry_the_standard_errors_that_their_estimator_tells(law: str, told: bool) -> None:
    log = simulated(4.0, material="hunt-crossley", model=law)
    valid = [model for model in log.models if model.valid]
    assert len(valid) > 50
    assert all(len(model.standard_errors) in (0, len(model.parameters)) for model in valid)
    errors = np.array([model.standard_errors for model in valid[-20:]])
    assert errors.size > 0 if told else errors.size == 0
    if told:
        assert (errors[np.isfinite(errors)] > 0.0).all()
        assert np.isfinite(errors[-1, 0])
        assert errors[-1, 0] < abs(valid[-1].parameters[0])  # of the stiffness, which four seconds of presses show


class Large(Flickering):
    @property
    def state(self) -> tuple[float, ...]:
        return (0.1,) * 400


@pytest.mark.parametrize(("estimator", "size", "longest"), [(Flickering(), 50, 20), (Large(), 3_500, 200)])
@pytest.mark.first
def test_a_model_that_flickers_floods_nobody_and_a_large_one_is_sent_less_often(
    estimator: Estimator, size: int, longest: int
) -> None:
    models = Pressing(estimator, {0: 500.0}).run(6000)
    assert len(encode(models[-1])) > size
    assert 6000 * np.mean([len(encode(model)) for model in models]) > 6 * 50_000, "that would be too much"
    assert 40_000 < bytes_in_worst_second(models) <= 50_000
    assert max(np.diff([model.time_ns for model in models])) <= longest * MS


def test_a_change_of_the_material_is_sent_at_once_and_told_for_two_seconds() -> None:
    pressing = Pressing(ContactMap(), {0: 400.0, 11_000: 1600.0})
    pressing.run(11_000)
    before = pressing.state.learner.estimator.changes
    models = []
    while pressing.state.learner.estimator.changes == before and pressing.tick < 13_000:
        models.append(pressing.step())
    assert pressing.tick < 12_500  # found within a press
    assert models[-1] is not None
    assert models[-1].reason.startswith("the material changed")
    later = pressing.run(1900)
    assert all("the material changed" in model.reason for model in later if model.valid)
    assert "the material changed" not in pressing.run(300)[-1].reason


@pytest.mark.parametrize("faults", [{"loss": 0.2}, pytest.param({"outage": 0.15}, marks=pytest.mark.long)])
@pytest.mark.long
def test_lost_models_are_made_good_within_200_ms(faults: dict[str, float], session: SessionLog) -> None:
    seconds = 12.0 if "outage" in faults else 5.0  # one outage in every 10 s
    log = simulated(seconds, material="foam-measured", **faults)
    sent = {model.sequence: model.time_ns for model in log.models}
    rows = log.leader[log.leader["model_sequence"] > 0]
    # The age that a model may have: its delay, 20 ms to the next one, and 200 ms; the outage is on top.
    longest = 300 + 20 + 200 + 1000 * faults.get("outage", 0.0)
    age = rows["time_ns"] - np.array([sent[sequence] for sequence in rows["model_sequence"].tolist()])
    assert log.counts["models_lost"] > 3
    assert age.max() <= longest * MS


def test_one_message_after_a_burst_of_losses_says_it_all(session: SessionLog) -> None:
    arrivals = {model.time_ns + 300 * MS: model for model in session.models}
    lost = range(5_000 * MS, 5_100 * MS)

    def forces(without: range) -> np.ndarray[Any, Any]:
        state, result = leader.start(), []
        for row in session.leader:
            now = int(row["time_ns"])
            models = [arrivals[now]] if now in arrivals and now not in without else []
            inputs = leader.Inputs(float(row["position"]), models, MS, 0)
            state, outputs = leader.step(state, inputs, now)
            result.append(outputs.record.predicted_force)
        return np.array(result)

    whole, holed = forces(range(0)), forces(lost)
    np.testing.assert_array_equal(whole, session.leader["predicted_force"])
    assert np.abs(whole - holed)[5000:5100].max() > 0.0
    np.testing.assert_allclose(holed[5121:], whole[5121:], rtol=0.0, atol=0.02)


def test_the_delay_that_the_estimator_is_told_is_the_round_trip_and_replay_tells_the_same() -> None:
    log = simulated(4.0, material="hunt-crossley", position_delay=0.03, force_delay=0.1)
    estimator = ContactMap()
    again = replay(log, Learner(estimator), delay=0.1)
    assert estimator.horizon == pytest.approx(0.131, abs=0.002)
    np.testing.assert_array_equal(again.predicted.force, log.leader["predicted_force"])


def test_a_leader_s_round_trip_is_the_smallest_of_a_second_by_one_clock_and_unknown_where_it_never_answers() -> None:
    trip, told = RoundTrip(), []
    for tick in range(2500):
        now = tick * MS
        trip.sent(tick + 1, now)
        late = 40 if tick % 3 else 60
        if tick >= late:
            trip.commanded(tick, tick + 1 - late)
        told.append(trip.applied(tick, now))
    assert np.flatnonzero([delay is not None for delay in told]).tolist() == [1000, 2000]
    assert told[1000] == told[2000] == pytest.approx(0.04)
    trip = RoundTrip()
    for tick in range(10_000):
        trip.sent(tick + 1, tick * MS)
        trip.commanded(2**40 + tick, 0)
        assert trip.applied(tick, tick * MS) is None


@given(st.lists(st.tuples(st.integers(1, 40), st.integers(0, 8), st.integers(0, 40)), max_size=60))
def test_the_newest_applied_command_says_what_the_leader_renders_from(ticks: list[tuple[int, int, int]]) -> None:
    """In whatever order commands come: as their definition says, told by all that came in time."""
    trip, told, known, current = RoundTrip(), dict[int, int](), 0, 0
    for tick, (command, model, applied) in enumerate(ticks):
        trip.commanded(command, model)
        if command > known:
            told[command] = model
        trip.applied(applied, tick * MS)
        known = max(known, applied)
        reached = [number for number in told if number <= applied]
        current = told[max(reached)] if reached else current
        told = {number: model for number, model in told.items() if number > applied}
        assert trip.current == current


@pytest.mark.long
@pytest.mark.parametrize("faults", [pytest.param({}, marks=pytest.mark.long), {"loss": 0.05, "jitter": 0.003}])
def test_a_state_is_that_of_the_command_that_its_message_names(faults: dict[str, float]) -> None:
    """What the material remembers by the leader's own motion up to that command, and up to no other."""
    log = simulated(16.0, material="hunt-crossley", seed=3, **faults)
    assert log.leader["sequence"][0] == 1
    periods = np.full(log.leader.size, 1e-3)

    def apart(model: ModelUpdate, shift: int) -> float:
        until = model.command_sequence + shift
        depths = log.leader["position"][:until] - model.surface
        result = make_model(model.law, model.parameters, model.map).remember((), depths, periods[:until])
        return float(np.abs(np.subtract(result, model.state)).max())

    models = [model for model in log.models if model.valid and model.time_ns > 12_000 * MS][::10]
    assert len(models) > 15
    assert max(apart(model, 0) for model in models) < STATE_TOLERANCE
    assert max(apart(model, -50) for model in models) > 2.0 * STATE_TOLERANCE


@pytest.mark.long
def test_while_sensors_are_faulty_the_state_of_the_material_keeps_the_command_that_it_belongs_to() -> None:
    settings = SessionSettings(position_delay=0.02, force_delay=0.02)
    arm = make_robot(settings.material, seed=0)
    operator = ScriptedOperator(arm.material.surface, arm.material.press_depth, 0)
    robot = FaultySensor(arm, SensorFault("dropout", 4.0, 4.6), seed=0)
    log = simulate(settings, duration=6.0, operator=operator, robot=robot).log
    telemetry, models = log.follower, log.models
    faulty = telemetry["validity"] > 0
    assert faulty.sum() > 500
    first = int(np.argmax(faulty))
    last_learnt = int(telemetry["command_sequence"][first - 1])
    meanwhile = [
        one for one in models if telemetry["time_ns"][first] <= one.time_ns <= telemetry["time_ns"][faulty][-1]
    ]
    assert len(meanwhile) > 10
    assert {one.command_sequence for one in meanwhile} == {last_learnt}
    assert len({one.state for one in meanwhile}) == 1
    assert "nothing is learnt" in meanwhile[-1].reason
    # Elsewhere it is the newest that was applied, as telemetry of the same tick says.
    for one in models[10:200]:
        assert one.command_sequence == telemetry["command_sequence"][telemetry["time_ns"] == one.time_ns][0]


def test_another_leader_is_told_no_command_of_the_one_before() -> None:
    pressing = Pressing(Flickering(), {0: 500.0})
    pressing.run(100)
    state = pressing.state
    assert (state.felt_count, state.records["felt"][0, 0]) == (1, 100)
    late = follower.Inputs([], RobotSample(0.0, math.nan, 0.0, 0.0, 0.0, 0.0, False), MS, 0)
    for tick in range(100, 1300):  # nothing is heard, and the sensor has failed
        follower.step(state, late, tick * MS)
    command = Command(VERSION, 1, 1300 * MS, 0.0, 0, False, "bert", 2)
    _, outputs = follower.step(state, late._replace(commands=[command]), 1300 * MS)
    assert outputs.telemetry.epoch == 2
    assert state.felt_count == 0
