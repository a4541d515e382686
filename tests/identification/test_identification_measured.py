"""All estimators on measured foam, and what each robust option brings alone: tables, to be quoted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foretouch.errors import RecordingError
from foretouch.identification import (
    ESTIMATORS,
    ROBUST,
    Estimator,
    FPRLSOptions,
    HuntCrossleyLogOptions,
    HuntCrossleyLogRLS,
    HuntCrossleyTwoStage,
    KelvinVoigtOptions,
    KelvinVoigtRLS,
    Learner,
    RobustFPRLS,
    RobustOptions,
    TwoStageOptions,
    identify,
    make_estimator,
    predict,
)
from foretouch.quantities import Recording
from foretouch.recordings import list_datasets, read_recording
from foretouch.report import delayed_force, score_prediction

pytestmark = pytest.mark.long
FOAM = [dataset.name for dataset in list_datasets("foam") if dataset.seen]
DELAY = 0.3


@pytest.fixture(scope="module")
def foam(measured: Callable[[str], Path]) -> list[Recording]:
    return [read_recording(measured(name)) for name in FOAM]


def errors(recording: Recording, make: Callable[[], Estimator]) -> tuple[float, float]:
    """One-step residual, and error of the prediction at 300 ms, both in % of the contact force RMS."""
    try:
        result = identify(recording, Learner(make()))
        one_step = 100.0 * result.residual_rms / result.contact_force_rms
    except RecordingError:
        one_step = math.nan  # no model at the end
    late = delayed_force(recording.time, recording.force, DELAY)
    predicted = predict(recording, Learner(make()), delay=DELAY).force
    scores = score_prediction(
        recording.time,
        recording.force,
        predicted,
        late,
        contact_floor=recording.contact_floor,
        score_from=1.5,
        score_to=None,
        position=recording.position,
    )
    percent = scores.prediction_error_percent
    return one_step, math.nan if percent is None else percent


def table(
    title: str, rows: Iterator[tuple[str, Callable[[], Estimator]]], foam: list[Recording], capsys: Any
) -> dict[str, np.ndarray]:
    """Print a line per row: one step / 300 ms, on each file; returns the figures by name, shape (files, 2)."""
    figures: dict[str, np.ndarray] = {}
    with capsys.disabled():
        print(f"\n{title}: % of the contact force RMS, one step / {DELAY:g} s")  # noqa: T201
        print(" " * 44 + "".join(f"{name:>19}" for name in FOAM))  # noqa: T201
        for name, make in rows:
            figures[name] = np.array([errors(recording, make) for recording in foam])
            cells = "".join(f"{now:9.3g} /{late:8.3g}" for now, late in figures[name])
            print(f"{name:44}{cells}", flush=True)  # noqa: T201
    return figures


def test_all_estimators(foam: list[Recording], capsys: pytest.CaptureFixture[str]) -> None:
    rows = (
        (f"{model} {name}", lambda model=model, name=name: make_estimator(model, name))
        for model, names in ESTIMATORS.items()
        for name in names
    )
    figures = table("estimators", rows, foam, capsys)
    printed, robust = figures["continuous-switching fprls"], figures["continuous-switching robust-fprls"]
    assert np.median(robust[:, 1]) < 25.0 < 100.0 < np.median(printed[:, 1])
    assert (robust[:, 0] < 20.0).all()


ALONE: dict[str, dict[str, Any]] = {
    "gate on force": {"gate_force": ROBUST.gate_force},
    "gate on depth": {"gate_depth": ROBUST.gate_depth},
    "clamp on v / x": {"largest_rate": ROBUST.largest_rate},
    "weights F^2": {"weight_force": ROBUST.weight_force},
    "scaled regressors": {"scaled": True},
    "scaled, covariance bound": {"scaled": True, "covariance_limit": ROBUST.covariance_limit},
}
"""Each part of ROBUST; a bound on P means something only of scaled regressors."""


def test_what_each_robust_option_brings(foam: list[Recording], capsys: pytest.CaptureFixture[str]) -> None:
    off = {"gate_force": 0.0, "gate_depth": 0.0, "scaled": False}
    variants = {"as printed": RobustOptions()}
    variants |= {f"with {name}": RobustOptions(**values) for name, values in ALONE.items()}
    variants["with all"] = ROBUST
    for name, values in ALONE.items():
        if name != "scaled regressors":
            lost = {key: off.get(key) for key in values if not (key == "scaled" and len(values) > 1)}
            variants[f"all without {name.removeprefix('scaled, ')}"] = replace(ROBUST, **lost)
    rows = ((name, lambda robust=robust: RobustFPRLS(FPRLSOptions(robust=robust))) for name, robust in variants.items())
    figures = table("fprls", rows, foam, capsys)
    printed = np.median(figures["as printed"], axis=0)
    assert np.median(figures["with scaled, covariance bound"], axis=0)[1] < 0.01 * printed[1]
    assert (np.median(figures["with all"], axis=0) < printed).all()


def test_what_robust_options_bring_to_the_classic_estimators(
    foam: list[Recording], capsys: pytest.CaptureFixture[str]
) -> None:
    def rows() -> Iterator[tuple[str, Callable[[], Estimator]]]:
        for label, robust in (("as printed", RobustOptions()), ("all", ROBUST)):
            yield f"kelvin-voigt rls, {label}", lambda r=robust: KelvinVoigtRLS(KelvinVoigtOptions(robust=r))
            yield (
                f"hunt-crossley log-rls, {label}",
                lambda r=robust: HuntCrossleyLogRLS(HuntCrossleyLogOptions(robust=r)),
            )
            yield f"hunt-crossley two-stage, {label}", lambda r=robust: HuntCrossleyTwoStage(TwoStageOptions(robust=r))

    figures = table("classic", rows(), foam, capsys)
    before, after = (figures[f"hunt-crossley log-rls, {label}"] for label in ("as printed", "all"))
    assert np.median(after, axis=0)[0] < np.median(before, axis=0)[0]  # weights count errors as newtons do
