from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from foretouch.quantities import Pose
from foretouch.vision import ContactSeen, Fixture, FixtureFilter, FusionSettings, ImageSeen, Verdict

COVARIANCE = np.diag([2e-4, 2e-4, 8e-4, 4e-3, 4e-3, 2e-3]) ** 2
S = FusionSettings()


def image(random: np.random.Generator, true: Pose, time: float, bias: np.ndarray | None = None) -> ImageSeen:
    error = random.multivariate_normal(np.zeros(6), COVARIANCE)
    shared = np.zeros(6) if bias is None else bias
    return ImageSeen(time, true @ Pose.exp(shared + error), COVARIANCE)


def contact(random: np.random.Generator, true: Pose, time: float) -> ContactSeen:
    x, y = random.uniform(-0.05, 0.05, 2)
    return ContactSeen(time, tuple(true.apply((x, y, random.normal(0.0, 2e-4)))), 2e-4)


def settled(random: np.random.Generator, bias: np.ndarray | None = None, images: int = 29) -> FixtureFilter:
    """After as many images of a fixture that stands where it is believed."""
    known = FixtureFilter(Fixture(), Pose.identity())
    for tick in range(1, images + 1):
        known.update(image(random, Pose.identity(), 0.033 * tick, bias))
    return known


def displaced(random: np.random.Generator) -> Pose:
    return Pose.exp(random.normal(size=6) * np.repeat([S.start_position, S.start_angle], 3))


@pytest.mark.long  # many draws
def test_the_error_is_as_large_as_the_filter_says() -> None:
    random, scores = np.random.default_rng(5), []
    for _ in range(60):
        true = displaced(random)
        bias = random.normal(size=6) * np.repeat([S.bias_position, S.bias_angle], 3)
        known = FixtureFilter(Fixture(), Pose.identity())
        for tick in range(1, 20):
            drift = np.repeat([S.drift_position, S.drift_angle], 3) * math.sqrt(0.1)
            true = true @ Pose.exp(random.normal(size=6) * drift)
            known.update(image(random, true, 0.1 * tick, bias))
            if tick % 5 == 0:
                known.update(contact(random, true, 0.1 * tick))
        state = known.state(1.9)
        error = (state.pose.inverse() @ true).log()
        scores.append(error @ np.linalg.solve(state.pose_covariance, error))
    assert 6.0 - 4.0 * math.sqrt(12 / 60) < np.mean(scores) < 6.0 + 4.0 * math.sqrt(12 / 60)


def test_the_order_of_arrival_makes_no_difference() -> None:
    random = np.random.default_rng(1)
    true = Pose.exp([0.01, -0.01, 0.005, 0.1, 0.0, -0.1])
    seen = [image(random, true, 0.1), image(random, true, 0.2), contact(random, true, 0.25), image(random, true, 0.3)]
    states = []
    for order in itertools.permutations(seen):
        known = FixtureFilter(Fixture(), Pose.identity())
        for one in order:
            known.update(one)
        states.append(known.state(0.5))
    for state in states[1:]:
        assert state.pose.translation == pytest.approx(states[0].pose.translation, abs=1e-12)
        assert state.covariance == pytest.approx(states[0].covariance, abs=1e-15)


def test_contacts_take_away_along_the_normal_what_all_images_share() -> None:
    random = np.random.default_rng(2)
    bias = np.array([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0])
    known = settled(random, bias, 39)
    before = abs(known.state(1.4).pose.translation[2])
    for tick in range(10):
        assert known.update(contact(random, Pose.identity(), 1.4 + 0.05 * tick)) is Verdict.USED
    assert before > 6e-4
    assert abs(known.state(1.9).pose.translation[2]) < 2e-4


def test_one_wrong_image_is_refused_and_a_bump_opens_the_filter() -> None:
    random = np.random.default_rng(4)
    known = settled(random)
    moved = Pose.exp([0.012, -0.008, 0.0, 0.0, 0.0, 0.12])
    before = known.state(1.0).pose
    assert known.update(image(random, moved, 1.0)) is Verdict.REFUSED
    assert known.state(1.0).pose.distance(before)[0] == 0.0
    assert known.update(image(random, Pose.identity(), 1.033)) is Verdict.USED
    verdicts = [known.update(image(random, moved, 1.1 + 0.033 * tick)) for tick in range(8)]
    assert verdicts[:4] == [Verdict.REFUSED] * 3 + [Verdict.REOPENED]
    assert verdicts[4:] == [Verdict.USED] * 4
    distance, angle = known.state(1.4).pose.distance(moved)
    assert distance < 1.5e-3
    assert angle < 0.01


def test_wrong_images_that_do_not_agree_never_open_it() -> None:
    random = np.random.default_rng(6)
    known = settled(random)
    for tick in range(30, 60):
        wrong = Pose.exp(random.uniform(0.02, 0.3, 6) * random.choice([-1, 1], 6))
        assert known.update(image(random, wrong, 0.033 * tick)) is Verdict.REFUSED


def test_the_uncertainty_grows_while_nothing_is_seen_and_stays_bounded() -> None:
    random = np.random.default_rng(7)
    known = FixtureFilter(Fixture(), Pose.identity())
    assert "has not been seen" in known.state(0.0).sentence(0.0)
    known.update(image(random, Pose.identity(), 0.1))
    uncertainties = [np.diag(known.state(now).pose_covariance)[0] for now in (0.1, 1.0, 10.0, 1e12)]
    assert uncertainties == sorted(uncertainties)
    assert uncertainties[0] < uncertainties[1] < uncertainties[2] < uncertainties[3] <= 0.25 + 1e-9
    assert "4.9 s ago" in known.state(5.0).sentence(5.0)


def test_what_is_not_finite_changes_nothing() -> None:
    known = FixtureFilter(Fixture(), Pose.identity())
    for seen in (
        ContactSeen(math.nan, (0.0, 0.0, 0.0), 1e-3),
        ContactSeen(0.1, (math.inf, 0.0, 0.0), 1e-3),
        ContactSeen(0.1, (0.0, 0.0, 0.0), 0.0),
        ImageSeen(0.1, Pose.identity(), np.full((6, 6), np.nan)),
        ImageSeen(0.1, Pose.identity(), -np.eye(6)),
    ):
        assert known.update(seen) is Verdict.NOT_FINITE
    assert np.array_equal(known.state(0.0).covariance, FixtureFilter(Fixture(), Pose.identity()).state(0.0).covariance)
    assert known.update(ContactSeen(10.0, (0.0, 0.0, 0.0), 1e-3)) is Verdict.USED
    assert known.update(ContactSeen(1.0, (0.0, 0.0, 0.0), 1e-3)) is Verdict.TOO_LATE
