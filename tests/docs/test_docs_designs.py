"""The designs that the page on the contact map compares are causal, and right where a formula says so."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from docs_pages import ROOT

from foretouch.comparison import simulate
from foretouch.identification.contact_map.prior import prior
from foretouch.models.contact_map.kernel import features, remember
from foretouch.models.contact_map.layout import COARSE, MEMORY, Map
from foretouch.quantities import Recording

PAGE = (ROOT / "docs" / "contact-map.md").read_text()


@pytest.fixture(scope="module")
def designs() -> Iterator[SimpleNamespace]:
    """The script and its modules, which are no part of the package."""
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        names = ("basis", "kernels", "maps", "presses", "shares")
        modules = {name: importlib.import_module(f"designs.{name}") for name in names}
        compare, blocks = importlib.import_module("compare_designs"), importlib.import_module("measured_blocks")
        yield SimpleNamespace(compare=compare, blocks=blocks, **modules)
    finally:
        sys.path.remove(str(ROOT / "docs"))


@pytest.fixture
def interpreted(designs: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of the designs is compiled, which takes longer than little computing. What computes more takes long."""
    for module in (designs.maps, designs.kernels):
        for name, one in vars(module).copy().items():
            monkeypatch.setattr(module, name, getattr(one, "py_func", one))


def recorded(seconds: float = 3.2, *, other_after: float | None = None) -> Recording:
    """The beginning of a simulated foam; from a time on, if one is given, with twice the force."""
    whole = simulate("foam").recording
    kept = whole.time <= seconds
    force = whole.force[kept].copy()
    if other_after is not None:
        force[whole.time[kept] > other_after] *= 2.0
    return Recording(whole.time[kept], whole.position[kept], force)


@pytest.fixture(scope="module")
def press(designs: SimpleNamespace) -> Any:
    return designs.presses.conditioned(recorded(), None, 0.3, False)


LEARNING: list[Any] = [
    pytest.param(lambda designs: designs.maps.Map(), marks=pytest.mark.long),
    pytest.param(lambda designs: designs.maps.Map(gain=True, beyond="tangent"), marks=pytest.mark.long),
    pytest.param(lambda designs: designs.kernels.Kernel(25), marks=pytest.mark.long),
    lambda designs: designs.shares.Shipped(("law", "coarse")),
    lambda designs: designs.shares.Shares(),
    pytest.param(lambda designs: designs.shares.Shares("stacked"), marks=pytest.mark.long),
    pytest.param(lambda designs: designs.shares.Shares(late=False), marks=pytest.mark.long),
]


@pytest.mark.long
@pytest.mark.parametrize("made", LEARNING)
def test_no_design_knows_forces_of_the_last_delay(
    designs: SimpleNamespace, press: Any, made: Callable[[SimpleNamespace], Any]
) -> None:
    design, other = made(designs), designs.presses.conditioned(recorded(other_after=2.5), None, 0.3, False)
    unknown = press.recording.time > 2.5 + press.delay
    one, two = design.predict(press)[0], design.predict(other)[0]
    assert np.isfinite(one).all()
    np.testing.assert_array_equal(one[~unknown], two[~unknown])
    assert np.abs(one - two)[unknown].max() > 0.03


@pytest.mark.long
def test_only_the_floor_knows_the_future(designs: SimpleNamespace, press: Any) -> None:
    other = designs.presses.conditioned(recorded(other_after=2.5), None, 0.3, False)
    floor = designs.maps.Map(whole=True, restart=False)
    assert np.abs(floor.predict(press)[0] - floor.predict(other)[0])[press.recording.time < 2.5].max() > 0.1


@pytest.mark.long
def test_features_and_prior_are_those_of_the_package(designs: SimpleNamespace, press: Any) -> None:
    place = press.recording.position - press.surface[press.begin]
    ours = designs.basis.Features().of(press, place)
    memory, values, nothing = np.full(MEMORY, np.nan), np.empty(ours.shape[0]), Map.new()[0]
    for index in range(place.size):
        remember(nothing, memory, place[index], press.period)
        features(memory, place[index], press.velocity[index], values)
        np.testing.assert_allclose(ours[:, index], values, atol=1e-9)
    assert ours.shape[0] == COARSE.features
    theirs = prior(0)
    assert theirs.shape[0] == COARSE.size
    np.testing.assert_allclose(designs.maps.Map()._prior(), theirs, atol=1e-9)


@pytest.mark.long
@pytest.mark.usefixtures("interpreted")
def test_recursive_weights_are_those_of_one_solution(designs: SimpleNamespace) -> None:
    random = np.random.default_rng(1)
    rows, force, prior = random.normal(size=(30, 6)), random.normal(size=30), np.diag([4.0, 1.0, 1.0, 0.5, 2.0, 1.0])
    weights, begun = designs.maps._learn(rows, force, np.zeros(30), np.zeros(30, np.bool_), prior, 0.5, 1.0, 0.0, True)
    at_once = np.linalg.solve(rows.T @ rows + 0.25 * np.linalg.inv(prior), rows.T @ force)
    np.testing.assert_allclose(weights[-1], at_once, rtol=1e-8)
    assert not begun.any()


@pytest.mark.usefixtures("interpreted")
def test_a_gaussian_process_within_its_budget_is_the_exact_one(designs: SimpleNamespace) -> None:
    random = np.random.default_rng(2)
    count = 25
    inputs = np.column_stack((random.uniform(0.0, 8.0, count), random.normal(size=(count, 3))))
    force = random.normal(size=count)
    kernels = designs.kernels
    basis, weights, _ = kernels._learn(inputs, force, np.zeros(count, np.bool_), 60, 1.0, 1e-9)
    covariance = np.array([[kernels._covariance(a, b) for b in inputs] for a in inputs])
    asked = np.column_stack((random.uniform(0.0, 8.0, 5), random.normal(size=(5, 3))))
    output = kernels._ask(asked, inputs, basis, weights, np.full(5, count - 1))
    across = np.array([[kernels._covariance(a, b) for b in inputs] for a in asked])
    exact = across @ np.linalg.solve(covariance + np.eye(count), force)
    np.testing.assert_allclose(output, exact, rtol=1e-6, atol=1e-8)


@pytest.mark.usefixtures("interpreted")
def test_a_full_budget_is_kept(designs: SimpleNamespace) -> None:
    random = np.random.default_rng(3)
    inputs, force = np.column_stack((random.uniform(0.0, 8.0, 80), random.normal(size=80))), np.ones(80)
    basis, weights, _ = designs.kernels._learn(inputs, force, np.zeros(80, np.bool_), 10, 1.0, 1e-3)
    kept = (basis >= 0).sum(axis=1)
    assert kept.max() == 10
    assert kept[-1] == 10
    assert len(set(basis[-1])) == 10
    output = designs.kernels._ask(inputs, inputs, basis, weights, np.full(80, 79))
    assert np.abs(output - force).mean() < 0.3  # the process forgot samples, not what they said


@pytest.mark.long
def test_the_memory_lowers_the_error_on_foam(designs: SimpleNamespace) -> None:
    whole = simulate("foam")
    press = designs.presses.conditioned(whole.recording, whole.truth, 0.3, False)
    with_memory, without = designs.maps.Map(), designs.maps.Map(designs.compare.ALONE)
    assert press.error(with_memory.predict(press)[0]) < 0.7 * press.error(without.predict(press)[0])


def test_the_page_shows_the_designs_that_the_script_chooses(designs: SimpleNamespace) -> None:
    [table] = [block[0] for block in designs.blocks.BLOCK.finditer(PAGE) if block["name"] == "designs"]
    compare = designs.compare
    assert re.findall(r"^\| ([^|]+?) \| +\d", table, re.MULTILINE) == list(compare.ON_PAGE)
    assert {name for name, _ in compare.ON_PAGE.values()} == set(compare.TABLES)
    assert [key for key in compare.ON_PAGE.values() if key[1] not in compare.TABLES[key[0]]] == []
    assert f"| Design | {' | '.join(compare.SHOWN)} |" in table


def test_the_lines_of_the_page_are_those_of_the_tables(designs: SimpleNamespace) -> None:
    compare = designs.compare
    heads = [*compare.SHOWN, "Cost [us]"]
    result = {
        table: {design: {head: f"{design} {head}" for head in heads} for design in lines}
        for table, lines in compare.TABLES.items()
    }
    lines = compare.shown(result).splitlines()
    assert len(lines) == 2 + len(compare.ON_PAGE)
    assert lines[3].startswith(
        "| zero of the springs not given | the same, zero of the springs not given Foam, median |"
    )
    assert "Cost" not in lines[0] + lines[-1]


def test_an_unknown_table_is_refused(designs: SimpleNamespace) -> None:
    with pytest.raises(SystemExit, match="nothing to measure is called nonsense: choose from experts"):
        designs.compare.main(["nonsense"])
