"""Numbers as people read them: units, as many digits as the error allows, and what is undetermined."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest
from report_sessions import make_session

from foretouch.errors import plural
from foretouch.quantities import measured, parameter_unit
from foretouch.report import IDLE_LAW, render_text, session_figures
from foretouch.report.numbers import parameter_text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (2414.37, 37.9, "2,414 ± 38"),
        (14355.2, 310.4, "14,360 ± 310"),
        (1.20311, 0.00299, "1.2031 ± 0.0030"),
        (0.0101003, 6.1e-5, "0.010100 ± 0.000061"),
        (5.0, 99.6, "0 ± 100"),
        (803913.0, None, "804,000"),
        (0.1128, None, "0.113"),
        (0.0, None, "0"),
        (-2760.2, 0.0, "-2,760"),
        (1.5, float("nan"), "1.50"),
        (None, 3.0, "undetermined"),
        (None, None, "undetermined"),
    ],
)
def test_a_number_has_as_many_digits_as_its_error_allows(value: float | None, error: float | None, text: str) -> None:
    assert measured(value, error) == text
    assert measured(value, error, "N") == (text if value is None else f"{text} N")


def test_parameters_have_their_units() -> None:
    power = ("stiffness", "damping", "exponent", "switching")
    assert [parameter_unit(name, power) for name in power] == ["N/m^s", "N s/m^(n+1)", "", ""]
    assert [parameter_unit(name, ("stiffness", "damping")) for name in ("stiffness", "damping")] == ["N/m", "N s/m"]
    quadratic = ("stiffness", "stiffening", "damping")
    assert [parameter_unit(name, quadratic) for name in quadratic] == ["N/m", "N/m^2", "N s/m^2"]
    both = ("kelvin_voigt_stiffness", "hunt_crossley_stiffness", "hunt_crossley_exponent", "threshold")
    assert [parameter_unit(name, both) for name in both] == ["N/m", "N/m^n", "", "N/m"]
    assert parameter_unit("anything", power) == ""
    text = parameter_text({"stiffness": 4500.4, "damping": None}, {"stiffness": 38.0, "damping": None})
    assert text == "stiffness 4,500 ± 38 N/m, damping undetermined"


def test_what_a_session_could_not_determine_is_undetermined() -> None:
    log = make_session(3.0)
    errors = (38.0, float("nan"), 0.003)
    changed = replace(log, models=tuple(msgspec.structs.replace(model, standard_errors=errors) for model in log.models))
    report = session_figures(changed)
    assert report["parameters"] == {"stiffness": 3000.0, "damping": None, "exponent": 1.4}
    assert report["standard_errors"] == {"stiffness": 38.0, "damping": None, "exponent": 0.003}
    text = render_text(report)
    assert "law        stiffness 3,000 ± 38 N/m^n, damping undetermined, exponent 1.4000 ± 0.0030" in text
    assert "None" not in text
    for weight, idle in ((0.004, True), (0.006, False)):
        weights = {"law": weight, "coarse": 1.0 - weight, "fine": 0.0}
        empty = dict.fromkeys(("depths_m", "local_stiffness_N_per_m", "forces_N"), ())
        figures = {"depth_visited_m": 0.0, "speed_visited_m_per_s": 0.0, "standard_deviation_N": None}
        assert (IDLE_LAW in render_text({**report, "map": {"shares": weights, **empty, **figures}})) == idle
    plain = session_figures(log)  # a session of old tells no errors
    assert plain["standard_errors"] is None
    assert plain["parameters"]["damping"] == 1500.0


def test_one_is_singular() -> None:
    assert [plural(count, "tick") for count in (0, 1, 2, 1234)] == ["0 ticks", "1 tick", "2 ticks", "1,234 ticks"]
