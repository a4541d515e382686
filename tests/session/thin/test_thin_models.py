"""Models over a thin link: what is felt arrives, in few bytes, whatever is lost; and hostile bytes do nothing."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.messages import VERSION, ModelUpdate, SessionLog, Stop, decode, encode
from foretouch.models import ContactModel, make_model
from foretouch.robot import MATERIALS
from foretouch.session import SessionSettings, simulate
from foretouch.session.thin.models.heard import ModelsHeard
from foretouch.session.thin.models.said import LONGEST_NS, ModelsSaid

MS = 1_000_000
ROUND_TRIP_NS = 380 * MS
STEP = 4  # Rows of a session from one sample to the next, at which forces are compared


@cache
def pressed(material: str = "foam-measured", seconds: float = 8.0) -> tuple[SessionLog, list[ModelUpdate]]:
    """A session and its models."""
    models: list[ModelUpdate] = []

    def keep(message: Any, now_ns: int) -> None:
        if isinstance(message, ModelUpdate):
            models.append(message)

    settings = SessionSettings(material=material, grip="normal", seed=5)
    return simulate(settings, duration=seconds, record=keep).log, models


def cross(
    models: list[ModelUpdate], *, lost: float = 0.0, trip_ns: int = ROUND_TRIP_NS
) -> tuple[list[tuple[ModelUpdate, ModelUpdate]], list[int], ModelsHeard]:
    """Let models cross, and lose some: those that arrived beside what they were, the sizes of all, and the receiver."""
    said, heard, random = ModelsSaid(), ModelsHeard(), np.random.default_rng(3)
    arrived, sizes, known, asked = [], [], 0, -1
    on_the_way: list[tuple[int, int]] = []  # when a leader's answer comes, and the model that it has
    for update in models:
        now = update.time_ns
        while on_the_way and on_the_way[0][0] <= now:
            known = max(known, on_the_way.pop(0)[1])
        if 0 <= asked <= now - trip_ns:
            said.ask_whole()
            asked = -1
        data = said.offer(update, known, now)
        if data is None:
            continue
        sizes.append(len(data))
        if random.uniform() < lost:
            continue
        seen = heard.take(data)
        if seen is not None:
            arrived.append((update, seen))
            on_the_way.append((now + trip_ns, seen.sequence))
        if heard.wants_whole and asked < 0:
            asked = now
    return arrived, sizes, heard


def model_of(update: ModelUpdate) -> ContactModel:
    return make_model(update.law, update.parameters, update.map)


def forces(update: ModelUpdate, log: SessionLog, until_ns: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Forces of a model along the motion of a session up to a time, that of its last eight seconds [N]."""
    model, found = model_of(update), []
    state: tuple[float, ...] = ()
    rows = log.follower[log.follower["time_ns"] <= until_ns][-8000::STEP]
    for position, velocity in zip(rows["position"].tolist(), rows["velocity"].tolist(), strict=True):
        state, force, _ = model.advance(state, position - update.surface, velocity, STEP * 1e-3)
        found.append(force)
    return np.array(found)


@pytest.mark.parametrize("material", sorted(MATERIALS))
@pytest.mark.long
def test_the_force_is_that_of_the_model_as_it_is(material: str) -> None:
    log, models = pressed(material)
    arrived, _, _ = cross(models)
    valid = [(was, seen) for was, seen in arrived if seen.valid]
    assert len(valid) > 5
    wrong = []
    for was, seen in valid[:: max(len(valid) // 8, 1)]:
        exact, rounded = (forces(one, log, was.time_ns) for one in (was, seen))
        wrong.append(np.abs(rounded - exact) > np.maximum(0.02, 0.02 * np.abs(exact)))
    assert np.mean(np.concatenate(wrong)) < 0.01


@pytest.mark.parametrize("material", sorted(MATERIALS))
@pytest.mark.first
def test_models_take_few_bytes(material: str) -> None:
    _, models = pressed(material)
    _, sizes, _ = cross(models)
    assert sum(sizes) < 8 * 450
    assert sum(sizes) < sum(len(encode(update)) for update in models) / 50


@pytest.mark.long
def test_all_that_is_no_force_arrives_too() -> None:
    _, models = pressed()
    arrived, _, _ = cross(models)
    for was, seen in arrived:
        same = "sequence", "command_sequence", "law", "valid", "reason", "estimator", "epoch", "run"
        assert [getattr(seen, name) for name in same] == [getattr(was, name) for name in same]
        assert abs(seen.time_ns - was.time_ns) <= MS
        assert len(seen.standard_errors) == len(was.standard_errors)
        assert len(seen.state) == len(was.state)
        assert np.allclose(seen.state, was.state, atol=2e-5)
        assert encode(decode(encode(seen), ModelUpdate)) == encode(seen)


@pytest.mark.parametrize("lost", [0.1, 0.5])
@pytest.mark.first
def test_what_is_lost_is_made_good(lost: float) -> None:
    log, models = pressed()
    arrived, _, heard = cross(models, lost=lost)
    gaps = np.diff([was.time_ns for was, _ in arrived])
    assert gaps.max() < 6 * LONGEST_NS
    was, seen = arrived[-1]
    exact, rounded = (forces(one, log, was.time_ns) for one in (was, seen))
    assert np.mean(np.abs(rounded - exact) > np.maximum(0.02, 0.02 * np.abs(exact))) < 0.01
    assert not heard.wants_whole


def test_a_leader_that_begins_asks_for_a_whole_one() -> None:
    _, models = pressed()
    said, first, second = ModelsSaid(), ModelsHeard(), ModelsHeard()
    acknowledged, answered = 0, None
    for update in models:
        data = said.offer(update, acknowledged, update.time_ns)
        if data is None:
            continue
        if update.time_ns < 5000 * MS:
            seen = first.take(data)
            acknowledged = acknowledged if seen is None else seen.sequence
            continue
        answered = second.take(data)
        if answered is not None:
            break
        assert second.wants_whole
        said.ask_whole()
    assert answered is not None
    assert answered.valid
    assert not second.wants_whole


def valid_model() -> ModelUpdate:
    return pressed()[1][-1]


def said_once(update: ModelUpdate) -> ModelsSaid:
    """A sender whose receiver has this model."""
    said = ModelsSaid()
    assert said.offer(update, 0, update.time_ns) is not None
    assert said.offer(later(update, 1), update.sequence, update.time_ns + 20 * MS) is None
    return said


def later(update: ModelUpdate, ticks: int, **changes: Any) -> ModelUpdate:
    """The same model, so many periods later."""
    times = {"sequence": update.sequence + ticks, "time_ns": update.time_ns + 20 * MS * ticks}
    commands = update.command_sequence + 20 * ticks
    return msgspec.structs.replace(update, **times, command_sequence=commands, **changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"valid": False},
        {"run": 7},
        {"epoch": 9},
        {"surface": 0.02},
        {"reason": "the material changed 0.0 s ago: it is learnt anew"},
        {"reason": "nothing is learnt: the force is stuck"},
        {"law": "kelvin-voigt", "parameters": (800.0, 2.0), "map": b"", "state": ()},
    ],
)
def test_some_changes_are_said_at_once(changes: dict[str, Any]) -> None:
    update = valid_model()
    said = said_once(update)
    assert said.offer(later(update, 2, **changes), update.sequence, update.time_ns + 40 * MS) is not None


@pytest.mark.parametrize(("stiffness", "said_now"), [(900.0, True), (803.0, False)])
def test_a_law_without_memory_is_said_where_it_is_felt(stiffness: float, said_now: bool) -> None:
    law: dict[str, Any] = {"law": "kelvin-voigt", "map": b"", "state": (), "standard_errors": ()}
    update = later(valid_model(), 0, parameters=(800.0, 2.0), **law)
    said, heard = said_once(update), ModelsHeard()
    data = said.offer(later(update, 2, parameters=(stiffness, 2.0)), update.sequence, update.time_ns + 160 * MS)
    assert (data is not None) == said_now
    whole = ModelsSaid().offer(update, 0, update.time_ns)
    assert whole is not None
    seen = heard.take(whole)
    assert seen is not None
    assert np.allclose(seen.parameters, update.parameters, rtol=1e-3)


def test_time_in_a_reason_is_no_news() -> None:
    update = valid_model()
    said = said_once(update)
    first, second = (f"the material changed {since} s ago: it is learnt anew" for since in (0.0, 0.1))
    assert said.offer(later(update, 2, reason=first), update.sequence, update.time_ns + 40 * MS) is not None
    assert said.offer(later(update, 3, reason=second), update.sequence, update.time_ns + 60 * MS) is None


def test_nothing_is_said_while_nothing_changes_but_every_two_seconds() -> None:
    update = valid_model()
    said = said_once(update)
    times = [
        tick * 20
        for tick in range(2, 300)
        if said.offer(later(update, tick), update.sequence, update.time_ns + 20 * MS * tick) is not None
    ]
    assert times == [2000, 4000]


def test_what_nobody_acknowledges_is_said_again() -> None:
    update = valid_model()
    said = said_once(update)  # acknowledged after 20 ms
    moved = update.surface + 0.002
    said_at = [
        tick * 20
        for tick in range(2, 50)
        if said.offer(later(update, tick, surface=moved), update.sequence, update.time_ns + 20 * MS * tick) is not None
    ]
    assert said_at[0] == 40
    assert said_at[1] <= 120


def test_a_session_in_space_has_its_fixture_and_friction() -> None:
    fixture, friction = (0.1, 0.2, -0.3, 0.01, -0.02, 1.5), (0.3, 0.5, 0.02, math.nan, 900.0, 50.0, 0.1, 0.05)
    space: dict[str, Any] = {
        "fixture": fixture,
        "fixture_deviation": (1e-4,) * 6,
        "fixture_age": 0.4,
        "friction": friction,
    }
    update = later(valid_model(), 0, **space)
    said, heard = ModelsSaid(), ModelsHeard()
    data = said.offer(update, 0, update.time_ns)
    assert data is not None
    seen = heard.take(data)
    assert seen is not None
    assert np.allclose(seen.fixture, fixture, atol=5e-5)
    assert np.allclose(seen.friction, friction, rtol=0.02, equal_nan=True)
    assert np.allclose(seen.fixture_deviation, 1e-4, rtol=0.2)
    assert seen.fixture_age == pytest.approx(0.4, abs=0.1)
    turned = (*fixture[:5], 1.51)
    data = said.offer(later(update, 1, **space | {"fixture": turned}), update.sequence, update.time_ns + 20 * MS)
    assert data is not None
    assert len(data) < 40
    seen = heard.take(data)
    assert seen is not None
    assert np.allclose(seen.fixture, turned, atol=1e-4)


def test_a_model_of_another_form_crosses_as_it_is() -> None:
    update = later(valid_model(), 0, law="another", parameters=tuple(map(float, range(40))), state=(1.0,) * 9, map=b"")
    said, heard = ModelsSaid(), ModelsHeard()
    data = said.offer(update, 0, update.time_ns)
    assert data is not None
    assert heard.take(data) == update


@cache
def messages() -> tuple[bytes, ...]:
    said, found, known = ModelsSaid(), [], 0
    for update in pressed()[1]:
        data = said.offer(update, known, update.time_ns)
        if data is not None:
            found.append(data)
            known = update.sequence
    return tuple(found)


def is_proper(update: ModelUpdate | None) -> bool:
    return update is None or encode(decode(encode(update), ModelUpdate)) == encode(update)


@given(st.binary(max_size=600))
def test_random_bytes_do_nothing(data: bytes) -> None:
    heard = ModelsHeard()
    assert is_proper(heard.take(data))


@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 10**6),
    st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), max_size=8),
    st.integers(0, 10**6),
    st.booleans(),
)
@pytest.mark.long
def test_bytes_that_were_changed_do_no_harm(which: int, changes: list[tuple[int, int]], end: int, cut: bool) -> None:
    heard, known = ModelsHeard(), messages()
    at = which % len(known)
    for data in known[:at]:
        heard.take(data)
    bad = bytearray(known[at])
    for place, value in changes:
        bad[place % len(bad)] = value
    update = heard.take(bytes(bad[: end % (len(bad) + 1)] if cut else bad))
    assert is_proper(update)
    for data in known[at:]:
        heard.take(data)


def test_another_message_is_no_model() -> None:
    assert ModelsHeard().take(b"\0" + encode(Stop(VERSION, 1, 1, "the end"))) is None
