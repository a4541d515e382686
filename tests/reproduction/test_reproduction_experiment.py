"""Figs. 10 and 11: the operator, the sessions, learning again from them, and what is said of the course."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.errors import SettingError, UnknownNameError
from foretouch.identification import FPRLS, ContactSample, Learner
from foretouch.models import LinearisedContinuousSwitching
from foretouch.reproduction import make_section
from foretouch.reproduction.experiment import (
    FORCE_DELAY,
    FURTHER_BACK,
    MATERIALS,
    PRESS_PERIOD,
    Experiment,
    SlowPresses,
    in_deep_half,
    jump,
    local_stiffness,
    make_script,
    peak,
    run_experiment,
    settled_at,
    stiffness_at_force,
    stiffness_in_phases,
    swing,
)
from foretouch.reproduction.figures.fig11 import tripped
from foretouch.reproduction.relearning import (
    AS_PRINTED,
    CHOICES,
    FIELDS,
    ROBUST,
    Watched,
    learn_again,
    predict_again,
    without_perturbation,
)
from foretouch.reproduction.section import Outcome, judge
from foretouch.session import replay


@pytest.fixture(scope="module")
def sponge() -> Experiment:
    return run_experiment("sponge", 2)


@pytest.mark.parametrize("material", MATERIALS)
def test_the_hand_is_smooth_and_goes_where_the_script_says(material: str) -> None:
    surface, script = 0.010, make_script(material)
    operator = SlowPresses(surface, script)
    time = np.arange(0, 14_200)
    position = np.array([operator.read(int(tick) * 1_000_000) for tick in time])
    for when, depth in script:
        assert position[round(1e3 * when)] == pytest.approx(surface + depth, abs=1e-9)
    assert position[0] == 0.0
    assert (position[:1500] < surface).all()
    assert np.abs(np.diff(position)).max() < 4e-5  # 40 mm/s
    assert np.abs(np.diff(position, n=2)).max() < 2e-7  # 0.2 m/s^2: nothing jumps
    assert (position[-100:] == surface + script[-1][1]).all()
    again = SlowPresses(surface, script)
    assert [again.read(int(tick) * 1_000_000) for tick in time[::-1][:50]] == position[::-1][:50].tolist()


def test_scripts_are_what_they_are_for() -> None:
    for material, deepest in (("sponge", 0.015), ("foam", 0.019)):
        depths = [depth for _, depth in make_script(material)]
        assert depths == [deepest, 0.5 * deepest] * 5
        assert min(depth for _, depth in make_script(material, back=FURTHER_BACK)) == pytest.approx(deepest / 3.0)
    deep = [depth for _, depth in make_script("hand") if depth > 0.0]
    assert len(deep) == 3
    assert max(deep) == deep[1]
    with pytest.raises(UnknownNameError, match="steel"):
        make_script("steel")


def test_an_operator_is_refused_what_it_cannot_do() -> None:
    with pytest.raises(SettingError, match="surface"):
        SlowPresses(0.002, make_script("foam"))
    with pytest.raises(SettingError, match="increase"):
        SlowPresses(0.01, ((1.0, 0.01),))
    assert SlowPresses(0.01, ()).render(50.0) == 10.0


def test_the_session_is_the_papers_experiment(sponge: Experiment) -> None:
    rows = sponge.log.rows()
    assert set((rows.follower["time_ns"] - rows.leader["time_ns"]).tolist()) == {80_000_000}
    assert sponge.log.settings["force_delay"] == str(FORCE_DELAY) == "0.3"
    assert sponge.deepest == (2.75, 5.25)
    assert not sponge.log.follower["clipped"].any()
    touched = sponge.log.follower["exact_force"][sponge.log.follower["time_ns"] > 2.3e9]
    assert touched.min() > 0.5  # never left
    assert run_experiment("sponge", 2) is sponge


def test_learning_again_gives_the_models_that_were_sent(sponge: Experiment) -> None:
    prediction = predict_again(sponge.log, AS_PRINTED)
    np.testing.assert_array_equal(prediction.log.leader["predicted_force"], sponge.log.leader["predicted_force"])
    course = learn_again(sponge.log, AS_PRINTED)
    parts = np.stack([course[name] for name in ("ln_k", "s", "b1", "b2")], axis=1)
    sent = [model for model in sponge.log.models if model.valid]
    assert len(sent) > 150
    for model in sent[1:]:
        at = np.searchsorted(course["time"], (model.time_ns - 80_000_000) * 1e-9 + 1e-6) - 1
        np.testing.assert_array_equal(parts[at], model.parameters)
    for name in FIELDS:  # prediction needs only the beginning
        np.testing.assert_array_equal(prediction.history[name], course[name][: prediction.history[name].size])


def test_watching_changes_nothing(sponge: Experiment) -> None:
    watched = replay(sponge.log, Learner(Watched(FPRLS())), delay=0.2)
    bare = replay(sponge.log, Learner(FPRLS()), delay=0.2)
    np.testing.assert_array_equal(watched.predicted.force, bare.predicted.force)


def test_fewer_samples_are_every_tenth() -> None:
    samples = [ContactSample(1e-3 * i, 5e-3 + 1e-5 * i, 0.01, 2.0 + 1e-2 * i, True) for i in range(600)]
    watched, bare = Watched(FPRLS(), 10), FPRLS()
    for index, sample in enumerate(samples):
        watched.update(sample)
        if index % 10 == 0:
            bare.update(sample)
    assert watched.updates == bare.updates == 60
    assert watched.model == bare.model
    history = watched.history
    assert history["iteration"].tolist() == list(range(20, 61))
    assert history["time"][0] == pytest.approx(0.19)
    watched.reset()
    assert watched.history["time"].size == watched.updates == 0
    assert watched.model is None


def test_choices_are_all_and_the_printed_one_is_first() -> None:
    names = [choice.name for choice in CHOICES]
    assert len(set(names)) == len(names) == 18
    assert CHOICES[0] is AS_PRINTED
    assert AS_PRINTED.make().options == FPRLS().options  # type: ignore[attr-defined]
    assert AS_PRINTED.every == 1
    for choice, other in zip(CHOICES, without_perturbation(), strict=True):
        assert other.every == choice.every
        assert other.make().options.perturbation == 0.0  # type: ignore[attr-defined]


def test_a_claim_is_judged_by_the_printed_choice_first() -> None:
    def outcomes(*held: bool) -> list[Outcome]:
        return [Outcome(f"choice {index}", holds, f"{index} N") for index, holds in enumerate(held)]

    printed = judge("c", "p", outcomes(True, False), "s")
    assert (printed.verdict, printed.measured) == ("holds", "as printed 0 N")
    assert printed.setting == "choice 0; s; holds under 1 of 2 choices"
    given = judge("c", "p", outcomes(True), "s", given=True)
    assert given.verdict == "holds under stated choice"
    assert judge("c", "p", outcomes(False), "s", given=True).verdict == "does not hold"
    stated = judge("c", "p", outcomes(False, False, True, True), "s", beside=outcomes(False)[:1])
    assert (stated.verdict, stated.measured) == (
        "holds under stated choice",
        "as printed 0 N; under the choice 2 N",
    )
    assert stated.setting.startswith("choice 2; ")
    never = judge("c", "p", outcomes(False, False), "s", beside=[Outcome("exact", True, "7 N")])
    assert (never.verdict, never.measured) == ("does not hold", "as printed 0 N; exact 7 N")


def course(s: np.ndarray, ln_k: np.ndarray | None = None) -> dict[str, np.ndarray]:
    time = 0.01 * np.arange(s.size) + 2.0
    return {"time": time, "iteration": np.arange(20, 20 + s.size), "s": s, "ln_k": 4.6 * s if ln_k is None else ln_k}


def test_when_something_settles() -> None:
    swinging = 1.5 + 0.1 * np.sin(2.0 * math.pi * np.arange(1000) / 250.0)
    assert settled_at(course(swinging), 2.5, 0.25) == 20
    late = swinging.copy()
    late[:130] = 3.0
    assert settled_at(course(late), 2.5, 0.25) == 150
    assert settled_at(course(late), 2.5, None) == 150
    late[130:200] -= 0.11  # within the band, outside of the range
    assert settled_at(course(late), 2.5, 0.25) == 150
    assert settled_at(course(late), 2.5, None) > 150
    late[-10] = 3.0
    assert settled_at(course(late), 2.5, 0.25) is None
    assert settled_at(course(np.empty(0)), 2.5, 0.25) is None


@pytest.mark.parametrize("period", [1.25, 2.5])
def test_the_period_of_a_sawtooth_is_found_over_a_drift(period: float) -> None:
    time = 0.01 * np.arange(1200)
    values = 8.0 + 0.2 * time - 0.01 * time**2 + (time % period) / period
    result, share = swing(course(values, values), 2.5)
    assert result == pytest.approx(period, rel=0.03)
    assert 0.5 < share < 0.9  # a sawtooth is no sine
    assert swing(course(np.ones(1200)), 2.5)[1] == 0.0


def test_jumps_and_peaks() -> None:
    ramp = np.linspace(0.0, 1.0, 1001)  # 0.1 a second
    assert jump(course(ramp, ramp), 1.0) == pytest.approx(0.01, rel=1e-6)
    stepped = ramp + 3.0 * (np.arange(1001) > 500)
    assert jump(course(stepped, stepped), 1.0) == pytest.approx(3.01, rel=1e-2)
    history = course(ramp) | {"depth": 0.01 * np.sin(np.linspace(0.0, math.pi, 1001))}
    inside = in_deep_half(history, 7.0, 0.01)
    assert history["time"][inside].min() == pytest.approx(5.51)
    assert peak(-np.abs(history["time"] - 6.3), inside) == 430
    assert peak(ramp, inside[:2]) is None


def test_stiffness_is_the_slope_of_the_law() -> None:
    law = LinearisedContinuousSwitching(8.7, 1.7, 0.0, 0.0)
    depth = (15.0 / math.exp(8.7)) ** (1.0 / 1.7)
    slope = (law.advance((), depth + 1e-6, 0.0, 1e-3)[1] - law.advance((), depth - 1e-6, 0.0, 1e-3)[1]) / 2e-6
    assert stiffness_at_force(8.7, 1.7, 15.0) == pytest.approx(slope, rel=1e-6)
    assert local_stiffness(np.array([8.7]), np.array([1.7]), depth)[0] == pytest.approx(slope, rel=1e-6)


def test_phases_are_told_apart() -> None:
    history = course(np.full(800, 2.0), np.log(np.where((np.arange(800) // 100) % 2 == 0, 500.0, 300.0)))
    k, slope = stiffness_in_phases(history, [2.0, 3.0, 4.0, 5.0, 6.0], 0.01)
    assert k == pytest.approx((500.0, 300.0))
    assert slope == pytest.approx((10.0, 6.0))


def test_the_perturbations_are_counted() -> None:
    """The paper's test in newtons trips where the force leaves what was learnt by more than 1 N."""
    newtons = next(choice for choice in CHOICES if choice.test == "newton" and choice.every == 1)
    watched = Watched(newtons.make())
    for i in range(400):
        depth = 5e-3 + 2e-5 * i
        force = 300.0 * depth * (1.0 if i < 300 else 2.0)  # 3.3 N become 6.6 N
        watched.update(ContactSample(1e-3 * i, depth, 0.02 + 1e-5 * i, force, True))

    assert tripped(newtons, watched.history) >= 1
    still = Watched(newtons.make())
    for i in range(300):
        depth = 5e-3 + 2e-5 * i
        still.update(ContactSample(1e-3 * i, depth, 0.02 + 1e-5 * i, 300.0 * depth, True))
    assert tripped(newtons, still.history) == 0


@pytest.mark.long
@pytest.mark.parametrize(("material", "delayed"), [("sponge", 49.9), ("foam", 49.7), ("hand", 54.0)])
def test_predicted_force_is_closer_than_delayed_force(material: str, delayed: float) -> None:
    """With robust-fprls; as printed it hangs on the noise."""
    for seed in (0, 3):
        experiment = run_experiment(material, seed=seed)
        prediction = predict_again(experiment.log, ROBUST)
        assert prediction.delayed_error == pytest.approx(delayed, abs=1.0)
        assert prediction.error < 0.8 * prediction.delayed_error
        assert experiment.log.follower["exact_force"].max() < 15.0
    if material == "hand":
        assert experiment.deepest == (3.2, 7.4, 11.5)
    if material == "sponge":
        assert prediction.error_from(4.0) < 10.0


@pytest.mark.long
def test_the_sponge_swings_once_a_press_unless_it_is_nearly_left() -> None:
    period, share = swing(learn_again(run_experiment("sponge").log, AS_PRINTED), PRESS_PERIOD)
    assert period == pytest.approx(PRESS_PERIOD, rel=0.05)
    assert share > 0.5
    _, further = swing(learn_again(run_experiment("sponge", back=FURTHER_BACK).log, AS_PRINTED), PRESS_PERIOD)
    assert further < 0.5


@pytest.mark.long
@pytest.mark.parametrize("name", ["fig10", "fig11"])
def test_the_verdicts(name: str) -> None:
    section = make_section(name)
    verdicts = {claim.claim: claim.verdict for claim in section.claims}
    if name == "fig10":
        result = list(verdicts.values())
        # Local stiffness in compression and restitution: 612 and 611 N/m as printed, so either verdict is one of noise.
        assert result.pop(4) in ("holds", "holds under stated choice")
        assert result == [
            "holds under stated choice",
            "does not hold",
            "holds under stated choice",
            "does not hold",
            "holds under stated choice",
            "holds under stated choice",
            "does not hold",
            "holds",
        ]
    else:
        assert verdicts.pop("Hand: it is pressed with less than 15 N") == "holds"
        closer = [verdict for says, verdict in verdicts.items() if "delayed" in says]
        assert closer[-1] == "holds"  # as printed, with each of four seeds
        assert "does not hold" not in closer
        rest = [verdict for says, verdict in verdicts.items() if "delayed" not in says]
        assert rest == ["does not hold", "holds under stated choice", "does not hold"]
    for table in section.data.values():
        assert len({len(column) for column in table.values()}) == 1
