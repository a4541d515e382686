"""Results of a comparison as rows, as pandas, as NumPy and as a picture."""

from __future__ import annotations

import math

import numpy as np

from foretouch.comparison import Prediction, Result, Results


def prediction(delay: float, error: float | None) -> Prediction:
    return Prediction(delay, error, 90.0, 50.0, "converged")


def results() -> Results:
    return Results(
        [
            Result("a", "kelvin-voigt", "rls", "ok", predictions=(prediction(0.1, 5.0), prediction(0.3, 8.0))),
            Result("b", "kelvin-voigt", "rls", "failed", "no such file"),
            Result("b", "hunt-crossley", "exact", "ok", predictions=(prediction(0.1, None), prediction(0.3, 2.0))),
        ]
    )


def test_each_result_has_a_row_for_each_delay_and_one_where_it_failed() -> None:
    frame = results().to_pandas()
    assert frame["recording"].tolist() == ["a", "a", "b", "b", "b"]
    assert frame["status"].tolist() == ["ok", "ok", "failed", "ok", "ok"]
    np.testing.assert_array_equal(frame["prediction_error_percent"], [5.0, 8.0, math.nan, math.nan, 2.0])
    assert frame["delay_s"].dropna().tolist() == [0.1, 0.3, 0.1, 0.3]


def test_numpy_has_the_errors_by_result_and_delay() -> None:
    nan = math.nan
    np.testing.assert_array_equal(results().to_numpy(), [[5.0, 8.0], [nan, nan], [nan, 2.0]])
    assert Results().to_numpy().shape == (0, 0)


def test_the_picture_shows_the_error_under_the_longest_delay() -> None:
    figure = results().plot()
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert sorted(texts) == sorted(["8", "-", "failed", "2"])
    assert "0.3 s" in figure.axes[0].get_title()
