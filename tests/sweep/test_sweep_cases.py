import shlex
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.main import get_command

from foretouch.cli.app import app
from foretouch.errors import SettingError
from foretouch.robot import MATERIALS, make_material
from foretouch.session import SessionSettings, make_operator
from foretouch.sweep import NETWORKS, Plan, baseline_numbers, draw_case
from foretouch.sweep.cases import CLEAN, is_plain

CASES = [draw_case(number) for number in range(400)]


@settings(max_examples=30, deadline=None, derandomize=True)
@given(number=st.integers(0, 10**6), seed=st.integers(0, 10**6))
def test_every_number_is_a_session_and_always_the_same_one(number: int, seed: int) -> None:
    case = draw_case(number, seed=seed)
    assert case == draw_case(number, seed=seed)
    assert 0.0 <= case.round_trip <= 5.0 + 1e-9
    assert case.duration == pytest.approx(30.0 + 4.0 * case.round_trip, abs=1e-2)
    assert round(case.duration * 1e3) == pytest.approx(case.duration * 1e3)
    chosen = case.settings()
    assert chosen.grip != "none"
    assert chosen.baseline == "none"
    assert case.rendering("delayed").settings().baseline == "delayed"


@pytest.mark.parametrize("seed", [0, 3])
def test_all_that_is_varied_is_there_in_its_share(seed: int) -> None:
    cases = [draw_case(number, seed=seed) for number in range(400)]
    networks = Counter(case.network for case in cases)
    for name, fraction in NETWORKS.items():
        assert networks[name] == pytest.approx(400 * fraction, abs=5)
    for name, choices in (("material", MATERIALS), ("grip", ("soft", "normal", "stiff"))):
        counts = Counter(case.options[name] for case in cases)
        assert set(counts) == set(choices)
        assert max(counts.values()) - min(counts.values()) < 10
    trips = np.array([case.round_trip for case in cases])
    assert np.mean(trips == 0.0) == pytest.approx(0.1, abs=0.01)
    assert np.histogram(trips[trips > 0.0], [0.0, 0.03, 0.1, 0.3, 1.0, 2.0, 3.0, 4.0, 5.01])[0].min() > 20
    rates = np.array([case.options["model_rate"] for case in cases])
    assert rates.min() >= 2.0
    assert rates.max() <= 200.0
    assert np.histogram(np.log(rates), 8)[0].min() > 40


def test_every_operator_reaches_its_material() -> None:
    scaled = [case for case in CASES if "position_scale" in case.options]
    assert len(scaled) == pytest.approx(80, abs=25)
    assert {case.options["material"] for case in scaled} == set(MATERIALS)
    for case in scaled:
        material = make_material(str(case.options["material"]))
        reach = {"surface": material.surface, "press_depth": material.press_depth}
        assert make_operator(case.settings(), say=pytest.fail, **reach).closed_loop


def test_a_run_of_numbers_is_spread_over_the_clean_round_trips_too() -> None:
    trips = np.array([case.round_trip for case in CASES[:100] if case.network == CLEAN])
    assert np.histogram(trips, [0.0, 1e-6, 0.1, 1.0, 2.5, 5.01])[0].min() >= 2


def test_only_what_a_network_is_named_for_is_in_it() -> None:
    faults = {"jitter", "loss", "burst", "reorder", "duplicate", "stall", "outage"}
    names = {"jitter": {"jitter"}, "burst loss": {"loss", "burst"}, "reordered": {"reorder"}, "doubled": {"duplicate"}}
    names |= {"stalls": {"stall"}, "outages": {"outage"}, CLEAN: set()}
    mixed = set()
    for case in CASES:
        inside = faults & set(case.options)
        if case.network in names:
            assert inside == names[case.network]
        mixed |= inside
        assert case.options.get("loss", 0.0) <= 0.3
        if "stall" in case.options:
            assert case.options["stall"] >= min(0.999 * max(case.round_trip, 0.05), 9.5)
            assert case.options["stall"] <= max(4.001 * case.round_trip, 0.05)
        assert case.options.get("outage", 0.0) <= 9.5
    assert mixed == faults


def test_two_thirds_of_what_baselines_are_compared_on_are_plain() -> None:
    numbers = baseline_numbers(CASES, 60)
    assert len(set(numbers)) == 60
    assert sum(is_plain(CASES[number].network, CASES[number].options) for number in numbers) == 40
    assert {CASES[number].network for number in numbers} == set(NETWORKS)
    assert baseline_numbers(CASES[:4], 4) == [0, 1, 2, 3]
    assert baseline_numbers(CASES, 0) == []


def test_the_command_is_the_session() -> None:
    command = get_command(app).commands["simulate"]  # type: ignore[attr-defined]
    for case in CASES[:60:4]:
        for one in (case, case.rendering("delayed-tdpa")):
            words = shlex.split(one.command)
            assert words[:2] == ["foretouch", "simulate"]
            parsed = command.make_context("simulate", words[2:]).params
            assert parsed.pop("duration") == one.duration
            names = {name for name in parsed if name in SessionSettings.__dataclass_fields__}
            assert SessionSettings(**{name: parsed[name] for name in names}) == one.settings()


def test_a_plan_runs_each_session_once_and_some_three_times() -> None:
    cases = Plan(20, 5).cases()
    assert Counter(case.baseline for case in cases) == {"none": 20, "delayed": 5, "delayed-tdpa": 5}
    assert len({(case.number, case.baseline) for case in cases}) == 30


@pytest.mark.parametrize(
    ("name", "plan"),
    [
        ("sessions", {"sessions": 0}),
        ("baselines", {"sessions": 5, "baselines": 6}),
        ("duration", {"duration": 1.0}),
        ("duration", {"duration": float("nan")}),
        ("seed", {"seed": -1}),
    ],
)
def test_a_bad_plan_is_refused(name: str, plan: dict[str, float]) -> None:
    with pytest.raises(SettingError, match=name):
        Plan(**plan)  # type: ignore[arg-type]


def test_another_robot_changes_nothing_else() -> None:
    for number in range(40):
        plain, arm = draw_case(number), draw_case(number, robot="fr3")
        assert arm.options == plain.options | {"robot": "fr3"}
        assert (arm.duration, arm.network) == (plain.duration, plain.network)
        assert "--robot fr3" in arm.command
        assert "robot" not in plain.options
    assert {case.settings().robot for case in Plan(5, 2, robot="ur5e").cases()} == {"ur5e"}
    with pytest.raises(SettingError, match="robot = 'kuka'"):
        Plan(robot="kuka")
