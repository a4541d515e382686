"""The energy of a session, against accounts whose every number is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from foretouch.messages import LEADER_DTYPE
from foretouch.rendering import EnergyAccount
from foretouch.report import energy_figures, exact_energy

QUICK = settings(derandomize=True, deadline=None, max_examples=60)
COUNT = 1e-5
Rows = NDArray[np.void]


def kept(exact: list[float], wanted: list[float], *, ceiling: bool = True) -> Rows:
    """The leader's rows of an account that was kept with these hand positions and wanted forces."""
    account = EnergyAccount(COUNT)
    rows = np.zeros(len(exact), LEADER_DTYPE)
    for row, (tick, place, force) in zip(rows, zip(range(1, len(exact) + 1), exact, wanted, strict=True), strict=True):
        shown = COUNT * round(place / COUNT)
        account.observe(shown)
        row["energy"], row["energy_bound"] = account.energy, account.bound
        force = min(force, account.ceiling) if ceiling else force
        if force == 0.0:
            account.close()
        account.hold(force)
        row["sequence"], row["rendered_force"] = tick, force
        row["hand_position"], row["exact_hand_position"] = shown, place
    return rows


MOTIONS = st.lists(
    st.tuples(st.floats(-2e-3, 2e-3), st.sampled_from([0.0, 0.5, 2.0, 7.0])), min_size=2, max_size=60
).map(lambda pairs: (list(np.cumsum([step for step, _ in pairs])), [force for _, force in pairs]))


@QUICK
@given(MOTIONS)
def test_an_account_that_was_kept_holds(motion: tuple[list[float], list[float]]) -> None:
    rows = kept(*motion)
    figures = energy_figures(rows)
    assert figures["certificate_holds"]
    assert figures["energy_margin_J"] >= 0.0
    assert figures["energy_used_percent"] <= 100.0 + 1e-6
    assert figures["net_energy_J"] == min(float(rows["energy"].min()), 0.0)
    assert -figures["net_energy_J"] <= figures["energy_bound_J"] + 1e-12


@QUICK
@given(MOTIONS)
def test_exact_energy_is_the_work_since_contact_began(motion: tuple[list[float], list[float]]) -> None:
    """Summed up by hand, contact by contact; and as near to the account as the rounding of the encoder lets it be."""
    rows = kept(*motion)
    found, force, place = exact_energy(rows), rows["rendered_force"], rows["exact_hand_position"]
    energy, start = 0.0, 0
    for k in range(1, rows.size):
        if force[k - 1] == 0.0:
            energy, start = 0.0, k
        work = force[k - 1] * (place[k] - place[k - 1])
        energy += work
        if rows["energy"][k] == 0.0 and force[k - 1] > 0.0:
            return  # as good as none was carried over: where it begins anew cannot be told
        assert found[k] == pytest.approx(energy, abs=1e-12)
        held = np.append(force[start:k], 0.0) if start < k else np.zeros(1)
        ups_and_downs = float(held[0] + held[-1] + np.abs(np.diff(held)).sum())
        assert abs(found[k] - rows["energy"][k]) <= 0.5 * COUNT * ups_and_downs + 1e-12


def test_a_spring_that_gives_back_more_than_it_took() -> None:
    """Pushed in by 1 N over 10 mm, pushed out by 2 N over as much: 10 mJ too much."""
    place = list(np.concatenate((np.linspace(0.0, 0.01, 101), np.linspace(0.01, 0.0, 101)[1:])))
    rows = kept(place, [1.0] * 100 + [2.0] * 101, ceiling=False)
    figures = energy_figures(rows)
    assert figures["net_energy_J"] == pytest.approx(-0.01)
    assert figures["net_energy_exact_J"] == pytest.approx(-0.01)
    assert figures["energy_bound_J"] == pytest.approx(2.0 * (1e-4 + COUNT))
    assert figures["energy_margin_J"] == pytest.approx(-0.01 + 2.0 * (1e-4 + COUNT))
    assert figures["certificate_holds"] is False
    limited = energy_figures(kept(place, [1.0] * 100 + [2.0] * 101))
    assert limited["certificate_holds"] is True


def test_energy_that_was_never_negative_has_the_largest_bound() -> None:
    place = [0.0, 1e-3, 2e-3, 3e-3]
    figures = energy_figures(kept(place, [1.0, 2.0, 3.0, 3.0]))
    assert figures["net_energy_J"] == 0.0
    assert figures["energy_bound_J"] == pytest.approx(3.0 * (1e-3 + COUNT))
    assert figures["energy_used_percent"] == 0.0


def test_energy_that_is_no_number_holds_nothing() -> None:
    rows = kept([0.0, 1e-3, 2e-3], [1.0, 1.0, 1.0])
    rows["energy"][2] = np.nan
    figures = energy_figures(rows)
    assert figures["certificate_holds"] is False
    assert figures["energy_margin_J"] is None


def test_no_contact_takes_nothing_and_no_account_says_nothing() -> None:
    apart = energy_figures(kept([0.0, 1e-3, 2e-3], [0.0, 0.0, 0.0]))
    assert apart["certificate_holds"] is True
    assert apart["net_energy_J"] == apart["energy_margin_J"] == 0.0
    old = np.zeros(3, LEADER_DTYPE)
    old["rendered_force"] = 1.0
    for rows in (old, old[:0]):
        assert set(energy_figures(rows).values()) == {None}


def test_a_device_has_no_exact_energy() -> None:
    rows = kept([0.0, 1e-3, 0.0], [1.0, 1.0, 1.0])
    rows["exact_hand_position"] = np.nan
    assert energy_figures(rows)["net_energy_exact_J"] is None


def test_rows_that_were_lost_are_taken_from_the_account() -> None:
    place = list(np.arange(20) * 1e-4)
    rows = kept(place, [1.0] * 20)
    gap = np.delete(rows, [7, 8, 9])
    assert exact_energy(gap)[-1] == pytest.approx(rows["energy"][-1])
