"""What the console says of a model."""

from __future__ import annotations

import pytest

from foretouch.console.panels.figures import describe, numbers_html
from foretouch.console.sentences import INSECURE
from foretouch.console.watched import Watched
from foretouch.identification import Learner, make_estimator
from foretouch.messages import VERSION, LeaderState, ModelUpdate
from foretouch.models import ContactMapModel


def update(law: str, parameters: tuple[float, ...], content: bytes = b"", *, valid: bool = True) -> ModelUpdate:
    return ModelUpdate(VERSION, 1, 0, 0, law, parameters, (), 0.01, valid, "why it is so", "bank", content)


def learnt_map() -> ContactMapModel:
    """Of a spring of 500 N/m, pressed 4 mm deep."""
    learner = Learner(make_estimator("contact-map", "bank"), surface=0.0, force_offset=0.0)
    for tick in range(1000):
        depth = 0.004 * (1.0 - abs(1.0 - tick / 500))
        learner.update(tick * 1e-3, depth, 500.0 * depth)
    model = learner.learnt().model
    assert isinstance(model, ContactMapModel)
    return model


def test_a_map_is_described_beside_the_law() -> None:
    model = learnt_map()
    law, weights, stiffness, reason = describe(update("contact-map", model.parameters, model.map))
    assert law.startswith("law: k ")
    assert all(symbol in law for symbol in ("λ", "n", "α"))
    percent = [float(word.rstrip("%, ;")) for word in weights.split("; ")[0].split() if word[0].isdigit()]
    assert sum(percent) == pytest.approx(100.0, abs=1.5)
    assert "visited 4.0 mm, 8 mm/s" in weights
    assert "at 1.0, 2.0, 3.6 mm" in stiffness
    values = [float(word.rstrip(",")) for word in stiffness.split(" N/m")[0].removeprefix("stiffness: ").split()]
    assert values == [pytest.approx(500.0, rel=0.15)] * 3
    assert reason == "why it is so"


def test_a_law_without_a_map_has_its_numbers() -> None:
    assert describe(update("kelvin-voigt", (500.0, 2.0))) == ("law: k 500, λ 2.00", "why it is so")


@pytest.mark.parametrize(
    "message",
    [
        update("contact-map", (1.0, 1.0, 1.0, 1.0), b"no map"),
        update("jelly", (1.0,)),
        update("", (), valid=False),
    ],
)
def test_what_cannot_be_run_is_described_by_its_reason(message: ModelUpdate) -> None:
    assert describe(message) == ("why it is so",)


def test_the_predicted_force_stands_with_its_deviation() -> None:
    def written(predicted: float, deviation: float, *warnings: str) -> str:
        watched = Watched()
        numbers = (0.006, 0.0, predicted, 3.5, 3.0, 1, 1, 0.0, False, 1, 1)
        watched.take(LeaderState(VERSION, 1, 1, *numbers, standard_deviation=deviation), 0.0)
        return numbers_html(watched, watched.window(6.0), None, depth=0.0, status="", warnings=warnings)

    assert "3.51 ± 0.12 N" in written(3.512, 0.118)
    assert "±" not in written(3.512, float("nan"))
    assert "over 1000000 N" in written(1e7, 0.118)
    assert "INSECURE" not in written(3.512, 0.118)
    assert f">{INSECURE}</b>" in written(3.512, 0.118, INSECURE)
