"""Sponge, foam, hand and bone: passivity, and what each is there to show."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.devices import ScriptedOperator
from foretouch.errors import SettingError
from foretouch.models import ContactModel, advance
from foretouch.robot import make_material, make_robot
from foretouch.robot.materials import LayeredContact, RelaxingContact
from foretouch.robot.materials.catalogue import ExponentialResponse, LinearResponse, PlateauResponse

NAMES = ("bone", "foam", "hand", "sponge")
FASTEST = 0.3


def follow(model: ContactModel, path: np.ndarray, period: float) -> np.ndarray:
    state, force = model.initial_state(), np.empty(path.size)
    for index, depth in enumerate(path.tolist()):
        state, force[index], _ = advance(model, state, depth, 0.0, period)
        assert all(map(math.isfinite, state))
        assert state == tuple(map(float, state))
    return force


def work(path: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Work put in from the untouched state until each step [J]: force at the end of a step times its way."""
    return np.cumsum(force * np.diff(path, prepend=0.0))


def ramp(start: float, end: float, speed: float, period: float) -> np.ndarray:
    count = math.ceil(abs(end - start) / (speed * period))
    return np.linspace(start, end, count + 1)[1:]


def there_and_back(depth: float, speed: float, period: float = 1e-3) -> np.ndarray:
    return np.concatenate([ramp(0.0, depth, speed, period), ramp(depth, 0.0, speed, period)])


@st.composite
def motions(draw: st.DrawFn, deepest: float) -> np.ndarray:
    """Motions from the surface in pieces of constant speed, with holds, reversals, and leaving contact."""
    path, here = [], 0.0
    for _ in range(draw(st.integers(1, 8))):
        goal = draw(st.one_of(st.floats(-0.3 * deepest, deepest), st.just(deepest)))
        speed = FASTEST * 10.0 ** draw(st.floats(-2.0, 0.0))
        path += [ramp(here, goal, speed, 1e-3) if goal != here else [], np.full(draw(st.integers(1, 80)), goal)]
        here = goal
    return np.concatenate(path)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=20, derandomize=True, deadline=None)
@given(data=st.data())
def test_material_never_gives_more_energy_than_it_took(name: str, data: st.DataObject) -> None:
    material = make_material(name)
    path = data.draw(motions(1.2 * material.press_depth))
    force = follow(material.model, path, 1e-3)
    assert np.isfinite(force).all()
    assert force.min(initial=0.0) >= 0.0
    assert (force[path <= 0.0] == 0.0).all()
    assert work(path, force).min(initial=0.0) >= -1e-12


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=25, derandomize=True, deadline=None)
@given(
    shares=st.lists(st.floats(-0.5, 1.2), min_size=1, max_size=150),
    period=st.sampled_from([1e-5, 5e-4, 1e-3, 0.1, 10.0]),
)
def test_material_is_passive_for_any_jumps_at_any_period(name: str, shares: list[float], period: float) -> None:
    material = make_material(name)
    path = material.press_depth * np.array(shares)
    force = follow(material.model, path, period)
    assert force.min() >= 0.0
    assert work(path, force).min() >= -1e-12


@settings(max_examples=20, derandomize=True, deadline=None)
@given(
    parts=st.lists(st.tuples(st.floats(0.01, 0.3), st.floats(1e-4, 5.0)), min_size=1, max_size=3),
    flow=st.one_of(st.just(math.inf), st.floats(1e-3, 10.0)),
    elastic=st.sampled_from(
        [
            LinearResponse(1e4),
            ExponentialResponse(1.0, 300.0, 0.010),
            PlateauResponse(3.0, 0.05, 0.8, 2.0, 0.015),
        ]
    ),
    path=motions(0.016),
)
def test_any_relaxing_law_is_passive(
    parts: list[tuple[float, float]], flow: float, elastic: LinearResponse, path: np.ndarray
) -> None:
    force = follow(RelaxingContact(elastic, tuple(parts), flow), path, 1e-3)
    assert work(path, force).min() >= -1e-12


LAYER = st.tuples(st.floats(1e-3, 0.01), st.floats(0.1, 100.0), st.floats(0.0, 0.95), st.floats(1e-4, 5.0))


@settings(max_examples=20, derandomize=True, deadline=None)
@given(layers=st.tuples(LAYER, LAYER, LAYER), base=st.floats(1e3, 1e6), path=motions(0.016))
def test_any_layered_law_is_passive(
    layers: tuple[tuple[float, float, float, float], ...], base: float, path: np.ndarray
) -> None:
    force = follow(LayeredContact(layers, base), path, 1e-3)
    assert work(path, force).min() >= -1e-10 * max(1.0, float(force.max()))


@pytest.mark.parametrize("name", NAMES)
def test_nonsense_and_great_depths_leave_finite_numbers(name: str) -> None:
    model = make_material(name).model
    path = np.array([0.001, math.nan, math.inf, -math.inf, 1e300, 5.0, 1.0, 0.001, -1.0, 0.002])
    assert np.isfinite(follow(model, path, 1e-3)).all()
    state = model.initial_state()
    for depth in (0.001, math.nan, math.inf):
        state, force, _ = model.advance(state, depth, math.nan, 1e-3)
        assert math.isfinite(force)


@pytest.mark.parametrize("name", NAMES)
def test_force_is_continuous_and_converges_with_the_step(name: str) -> None:
    material = make_material(name)
    coarse, fine = (
        follow(material.model, 0.5 * material.press_depth * (1.0 - np.cos(np.pi * np.arange(0.0, 3.0, h))), h)
        for h in (1e-3, 1e-4)
    )
    assert np.abs(np.diff(fine)).max() < 0.01 * fine.max()
    assert np.abs(coarse - fine[::10]).max() < 0.02 * fine.max()


@pytest.mark.parametrize(("name", "low", "high"), [("sponge", 0.6, 0.85), ("foam", 0.5, 0.8), ("hand", 0.5, 0.8)])
def test_a_press_loses_energy(name: str, low: float, high: float) -> None:
    material = make_material(name)
    path = there_and_back(material.press_depth, 0.03)
    power = follow(material.model, path, 1e-3) * np.diff(path, prepend=0.0)
    assert low < -power[power < 0.0].sum() / power[power > 0.0].sum() < high


def slope(path: np.ndarray, force: np.ndarray, index: int) -> float:
    """dF/dx [N/m] at a sample."""
    return float((force[index + 1] - force[index - 1]) / (path[index + 1] - path[index - 1]))


def test_sponge_is_stiffer_in_compression_and_recovers_late() -> None:
    model = make_material("sponge").model
    path = there_and_back(0.015, 0.03)
    force = follow(model, path, 1e-3)
    turn = path.size // 2
    inward, outward = force[: turn - 1], force[turn:][::-1][1:]
    held = inward > 0.2
    assert (inward[held] > outward[held]).all()
    secant = inward / path[: turn - 1]
    assert secant[300] > 1.3 * outward[300] / path[300]
    lost = path[turn:][force[turn:] == 0.0]
    assert lost.max() > 1e-3  # the surface is not yet back where the probe leaves it
    again = follow(model, np.concatenate([path, path[:turn]]), 1e-3)[path.size :]
    late = follow(model, np.concatenate([path, np.full(60000, -0.001), path[:turn]]), 1e-3)[path.size + 60000 :]
    assert int(np.argmax(again > 0.0)) > int(np.argmax(late > 0.0)) + 20
    assert late[-1] == pytest.approx(force[turn - 1], rel=1e-3)


def test_sponge_is_fungs_convolution_integral() -> None:
    """The law against its own definition: the integral over the history of the elastic response."""
    model = make_material("sponge").model
    assert isinstance(model, RelaxingContact)
    period = 1e-3
    time = np.arange(1, 2001) * period
    path = 0.006 * (1.0 - np.cos(4.0 * time)) + 0.002 * time
    elastic = np.array([model.elastic.force(depth) for depth in path.tolist()])
    growth = np.diff(elastic, prepend=0.0)
    reduced = np.ones(time.size)
    for share, relaxation in model.relaxation:
        reduced -= share * (1.0 - np.exp(-(time - period) / relaxation))
    expected = np.convolve(growth, reduced)[: time.size]
    force = follow(model, path, period)
    assert force.min() > 0.0
    assert np.abs(force - expected).max() < 1e-9


def test_foam_goes_from_stiff_to_plateau_to_stiff_and_back() -> None:
    material = make_material("foam")
    path = there_and_back(material.press_depth, 0.03)
    force = follow(material.model, path, 1e-3)
    turn = path.size // 2
    at = {depth: int(np.argmax(path >= depth)) for depth in (0.0005, 0.006, 0.0185)}
    first, plateau, dense = (slope(path, force, index) for index in at.values())
    assert first > 5.0 * plateau
    assert dense > 10.0 * plateau > 0.0
    back = slope(path, force, turn + 20), slope(path, force, path.size - at[0.006])
    assert back[0] > 3.0 * back[1] > 0.0
    assert force[at[0.006]] == pytest.approx(2.5, abs=0.6)  # collapse at 22.5 kPa under the tip


def test_foam_gets_a_little_stronger_with_each_tenfold_speed() -> None:
    material = make_material("foam")
    peaks = [
        follow(material.model, ramp(0.0, material.press_depth, speed, 1e-3), 1e-3)[-1] for speed in (0.003, 0.03, 0.3)
    ]
    for slow, quick in pairwise(peaks):
        assert 1.01 * slow < quick < 1.2 * slow


def test_hand_stiffness_lies_in_the_cited_interval_and_k_reaches_the_papers() -> None:
    """At 15 N 0.7 to 75 N/mm; k = F / x^s with s = x F' / F passes 150,000 N/m^s on the way there."""
    for speed in (0.002, 0.02, 0.05):
        path = ramp(0.0, 0.010, speed, 1e-3)
        force = follow(make_material("hand").model, path, 1e-3)
        index = int(np.argmax(force >= 15.0))
        stiffness = slope(path, force, index)
        assert 0.7e3 < stiffness < 75e3
        assert 4.0e3 < stiffness < 5.5e3
        exponent = path[index] * stiffness / 15.0
        assert 2.0 < exponent < 3.0
        assert 15.0 / path[index] ** exponent > 150e3


def test_hand_is_layered() -> None:
    """Skin, fat and muscle lock one after the other, and bone is felt beneath them."""
    model = make_material("hand").model
    assert isinstance(model, LayeredContact)
    total = sum(thickness for thickness, *_ in model.layers)
    path = ramp(0.0, total + 0.002, 0.02, 1e-4)
    force = follow(model, path, 1e-4)
    assert slope(path, force, path.size - 2) == pytest.approx(model.base_stiffness, rel=0.15)
    assert (np.diff(force, 2) > -1e-6 * force[1:-1]).all()
    elastic = replace(model, layers=tuple((h, p, 0.0, tau) for h, p, _, tau in model.layers))
    force = follow(elastic, path, 1e-4)
    for index in (2000, 4000):  # the force is the one at which layers and base add up to the depth
        press = force[index]
        depth = press / model.base_stiffness + sum(h * press / (press + p) for h, p, *_ in model.layers)
        assert depth == pytest.approx(path[index], rel=1e-9)


def test_hand_relaxes_layer_by_layer() -> None:
    """Held for long, each layer bears F = (1 - g) E; on the way, each relaxes with its own time."""
    model = make_material("hand").model
    assert isinstance(model, LayeredContact)
    held = follow(model, np.full(40000, 0.007), 1e-3)
    depth = held[-1] / model.base_stiffness
    depth += sum(h * held[-1] / (held[-1] + p * (1.0 - g)) for h, p, g, _ in model.layers)
    assert depth == pytest.approx(0.007, rel=1e-6)
    one = replace(model, layers=((0.015, 20.0, 0.5, 0.2), (1e-6, 1e3, 0.0, 1.0), (1e-6, 1e3, 0.0, 1.0)))
    held = follow(one, np.full(201, 0.007), 1e-3)  # one soft layer: E stands, half of it goes as e^(-t / tau)
    assert held[200] / held[0] == pytest.approx(0.5 + 0.5 * math.exp(-1.0), rel=5e-3)


def test_a_quick_press_of_the_hand_meets_twice_the_force() -> None:
    quick, slow = (
        follow(make_material("hand").model, ramp(0.0, 0.006, speed, period), period)[-1]
        for speed, period in ((0.3, 1e-3), (2e-4, 1e-2))
    )
    assert 1.8 < quick / slow < 2.75


@pytest.mark.parametrize("name", NAMES)
def test_arm_presses_the_material_by_script(name: str) -> None:
    robot = make_robot(name, seed=0)
    material = robot.material
    script = ScriptedOperator(material.surface, material.press_depth, 0)
    samples = [robot.exchange(script.read(tick * 1_000_000)) for tick in range(6000)]
    force = np.array([sample.exact_force for sample in samples])
    assert np.isfinite(force).all()
    assert 3.0 < force.max() < (20.0 if name == "bone" else 15.5)
    assert (force == 0.0).any()
    position = np.array([sample.exact_position for sample in samples])
    assert np.abs(np.diff(position)).max() < 1e-4


@pytest.mark.parametrize("speed", [0.002, 0.02])
def test_arm_holds_bone_at_its_limit(speed: float) -> None:
    robot = make_robot("bone", seed=3)
    path = np.minimum(robot.surface + 0.01, robot.surface - 0.0005 + speed * 1e-3 * np.arange(1500))
    force = np.array([robot.exchange(position).exact_force for position in path.tolist()])
    assert force.max() < 18.0
    assert 14.8 < force[-300:].min() < force[-300:].max() < 15.1


@pytest.mark.parametrize(
    "make",
    [
        lambda: RelaxingContact(LinearResponse(1.0), ((0.5, 1.0), (0.5, 1.0))),
        lambda: RelaxingContact(LinearResponse(1.0), ((0.0, 1.0),)),
        lambda: RelaxingContact(LinearResponse(1.0), ((0.5, math.nan),)),
        lambda: RelaxingContact(LinearResponse(1.0), ((0.5, 1.0),), flow_force=0.0),
        lambda: LinearResponse(-1.0),
        lambda: ExponentialResponse(0.0, 1.0, 0.01),
        lambda: PlateauResponse(1.0, 0.05, 1.5, 2.0, 0.02),
        lambda: LayeredContact(((0.001, 1.0, 1.0, 1.0),) * 3, 1e5),
        lambda: LayeredContact(((0.001, 1.0, 0.5, 1.0),) * 2, 1e5),  # type: ignore[arg-type]
        lambda: LayeredContact(((0.001, 1.0, 0.5, 1.0),) * 3, 0.0),
    ],
)
def test_bad_numbers_are_refused(make: object) -> None:
    with pytest.raises(SettingError, match=r"must be|below 1"):
        make()  # type: ignore[operator]
