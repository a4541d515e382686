"""The energy of a session, against accounts whose every number is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from foretouch.messages import LEADER_DTYPE
from foretouch.rendering import EnergyAccount
from foretouch.report import energy_figures, exact_energy
from foretouch.report.energy import BookedDevice, has_account

QUICK = settings(derandomize=True, deadline=None, max_examples=60)
COUNT = 1e-5
DEVICE = BookedDevice(COUNT, 5e-4, 0.02)
Rows = NDArray[np.void]


def kept(exact: list[float], wanted: list[float], *, ceiling: bool = True, late: bool = False) -> Rows:
    """The leader's rows of an account that was kept with these hand positions and wanted forces, some ticks late."""
    account = EnergyAccount.of(DEVICE)
    rows = np.zeros(len(exact), LEADER_DTYPE)
    for row, (tick, true, force) in zip(rows, zip(range(1, len(exact) + 1), exact, wanted, strict=True), strict=True):
        shown = COUNT * round(true / COUNT)
        row["period_ns"] = 50_000_000 if tick % 17 == 0 and late else 1_000_000
        account.observe(shown, 1e-9 * row["period_ns"])
        row["energy"], row["energy_bound"], row["late_energy"] = account.energy, account.bound, account.late_energy
        force = min(force, account.ceiling) if ceiling else force
        if force == 0.0:
            account.close()
        account.hold(force)
        row["sequence"], row["rendered_force"] = tick, force
        row["hand_position"], row["exact_hand_position"] = shown, true
    return rows


MOTIONS = st.lists(
    st.tuples(st.floats(-2e-3, 2e-3), st.sampled_from([0.0, 0.5, 2.0, 7.0])), min_size=2, max_size=60
).map(lambda pairs: (list(np.cumsum([step for step, _ in pairs])), [force for _, force in pairs]))


@QUICK
@given(MOTIONS, st.booleans())
def test_an_account_that_was_kept_holds(motion: tuple[list[float], list[float]], late: bool) -> None:
    rows = kept(*motion, late=late)
    figures = energy_figures(rows, DEVICE)
    assert figures["certificate_holds"]
    assert figures["energy_agrees"]
    assert figures["energy_margin_J"] >= 0.0
    assert figures["energy_used_percent"] <= 100.0 + 1e-6
    assert figures["net_energy_J"] == pytest.approx(min(float(rows["energy"].min()), 0.0), abs=1e-15)
    assert -figures["net_energy_J"] <= figures["energy_bound_J"] + 1e-12


@QUICK
@given(MOTIONS)
def test_exact_energy_is_as_near_as_the_rounding_of_the_encoder_lets_it_be(
    motion: tuple[list[float], list[float]],
) -> None:
    rows = kept(*motion)
    exact_sum, force = exact_energy(rows, DEVICE), np.concatenate(([0.0, 0.0], rows["rendered_force"]))
    acted = 0.5 * (force[1:-1] + force[:-2])
    ups_and_downs = acted + np.cumsum(np.abs(np.diff(acted, prepend=0.0)))
    assert (np.abs(exact_sum - rows["energy"]) <= 0.5 * COUNT * ups_and_downs + 1e-12).all()


def test_energy_of_late_ticks_is_reported_and_no_part_of_the_verdict() -> None:
    position = [*(np.arange(17) * 1e-4), -0.01, *([-0.01] * 5)]
    rows = kept(position, [2.0] * 17 + [0.0] * 6)
    rows["period_ns"][17] = 120_000_000
    account = EnergyAccount.of(DEVICE)
    for row in rows:
        account.observe(float(row["hand_position"]), 1e-9 * float(row["period_ns"]))
        row["energy"], row["energy_bound"], row["late_energy"] = account.energy, account.bound, account.late_energy
        account.hold(float(row["rendered_force"]))
    figures = energy_figures(rows, DEVICE)
    assert figures["certificate_holds"] is True
    # 2 N as far as the hand gets in the 19.5 ms beyond the tick: the watchdog's 20 ms begin with the force, at 0.5.
    assert figures["late_energy_J"] == pytest.approx(-2.0 * 0.0116 * 19.5 / 120.0, rel=1e-6)
    assert figures["energy_bound_J"] < 2.0 * 2.0 * 1.2e-4
    rows["late_energy"] = 0.0
    assert energy_figures(rows, DEVICE)["energy_agrees"] is False


def test_a_spring_that_gives_back_more_than_it_took() -> None:
    """Pushed in by 1 N over 10 mm, pushed out by 2 N over as much: 10 mJ too much."""
    position = list(np.concatenate((np.linspace(0.0, 0.01, 101), np.linspace(0.01, 0.0, 101)[1:])))
    rows = kept(position, [1.0] * 100 + [2.0] * 101, ceiling=False)
    figures = energy_figures(rows, DEVICE)
    assert figures["net_energy_J"] == pytest.approx(-0.01, rel=0.01)
    assert figures["net_energy_exact_J"] == pytest.approx(-0.01, rel=0.01)
    assert figures["energy_bound_J"] == pytest.approx(2.0 * 2.0 * (1e-4 + COUNT))
    assert figures["energy_margin_J"] == pytest.approx(-0.01 + 2.0 * 2.0 * (1e-4 + COUNT), rel=0.02)
    assert figures["certificate_holds"] is False
    assert figures["energy_agrees"] is True
    limited = energy_figures(kept(position, [1.0] * 100 + [2.0] * 101), DEVICE)
    assert limited["certificate_holds"] is True


def test_energy_that_was_never_negative_has_the_largest_bound() -> None:
    position = [0.0, 1e-3, 2e-3, 3e-3]
    figures = energy_figures(kept(position, [1.0, 2.0, 3.0, 3.0]), DEVICE)
    assert figures["net_energy_J"] == 0.0
    assert figures["energy_bound_J"] == pytest.approx(2.0 * 3.0 * (1e-3 + COUNT))
    assert figures["energy_used_percent"] == 0.0


def test_energy_that_is_no_number_holds_nothing() -> None:
    rows = kept([0.0, 1e-3, 2e-3], [1.0, 1.0, 1.0])
    rows["rendered_force"][1] = np.nan
    figures = energy_figures(rows, DEVICE)
    assert figures["certificate_holds"] is False
    assert figures["energy_margin_J"] is None


def test_no_contact_takes_nothing_and_no_account_says_nothing() -> None:
    apart = energy_figures(kept([0.0, 1e-3, 2e-3], [0.0, 0.0, 0.0]), DEVICE)
    assert apart["certificate_holds"] is True
    assert apart["net_energy_J"] == apart["energy_margin_J"] == 0.0
    old = np.zeros(3, LEADER_DTYPE)
    old["rendered_force"] = 1.0
    for rows in (old, old[:0]):
        assert set(energy_figures(rows).values()) == {None}


def test_a_device_has_no_exact_energy() -> None:
    rows = kept([0.0, 1e-3, 0.0], [1.0, 1.0, 1.0])
    rows["exact_hand_position"] = np.nan
    assert energy_figures(rows, DEVICE)["net_energy_exact_J"] is None


def test_rows_that_were_lost_are_taken_from_the_account() -> None:
    position = list(np.arange(20) * 1e-4)
    rows = kept(position, [1.0] * 20)
    gap = np.delete(rows, [7, 8, 9])
    assert exact_energy(gap, DEVICE)[-1] == pytest.approx(rows["energy"][-1])


@QUICK
@given(MOTIONS, st.sets(st.integers(0, 59), max_size=20))
def test_lost_rows_are_no_false_alarm(motion: tuple[list[float], list[float]], lost: set[int]) -> None:
    rows = kept(*motion)
    left = np.delete(rows, [row for row in lost if row < rows.size])
    if has_account(left):
        figures = energy_figures(left, DEVICE)
        assert figures["energy_agrees"]
        assert figures["certificate_holds"]


THERE_AND_BACK = list(np.concatenate((np.linspace(0.0, 0.01, 101), np.linspace(0.01, 0.0, 101)[1:])))


@pytest.mark.parametrize(
    ("column", "change"),
    [
        ("energy", lambda rows: np.maximum(rows["energy"], -rows["energy_bound"])),
        ("energy", lambda rows: 0.0 * rows["energy"]),
        ("energy", lambda rows: np.diff(rows["energy"], prepend=0.0)),  # as if every tick began a contact
        ("energy", lambda rows: np.where(rows["sequence"] == 150, np.nan, rows["energy"])),
        ("energy_bound", lambda rows: 100.0 * rows["energy_bound"]),
    ],
)
def test_an_account_that_is_not_true_is_found_out(column: str, change: Callable[[Rows], Rows]) -> None:
    """Whatever the leader says: 10 mJ too much are found by the forces and positions themselves."""
    rows = kept(THERE_AND_BACK, [1.0] * 100 + [2.0] * 101, ceiling=False)
    rows[column] = change(rows)
    figures = energy_figures(rows, DEVICE)
    assert figures["energy_agrees"] is False
    assert figures["certificate_holds"] is False
    assert figures["net_energy_J"] == pytest.approx(-0.01, rel=0.01)
    assert figures["energy_margin_J"] == pytest.approx(-0.01 + 2.0 * 2.0 * (1e-4 + COUNT), rel=0.02)


def test_a_device_that_nobody_knows_leaves_the_account_to_the_leader() -> None:
    rows = kept(THERE_AND_BACK, [1.0] * 201)
    assert energy_figures(rows, DEVICE._replace(resolution=10.0 * COUNT))["energy_agrees"] is False
    assert energy_figures(rows, DEVICE._replace(delay=0.0))["energy_agrees"] is False
    assert energy_figures(rows, None)["energy_agrees"] is True


def test_positions_that_are_none_are_left_out() -> None:
    rows = kept(THERE_AND_BACK, [1.0] * 201)
    account = EnergyAccount.of(DEVICE)
    for row in rows:
        row["hand_position"] = np.nan if row["sequence"] in (1, 41, 42) else row["hand_position"]
        account.observe(float(row["hand_position"]))
        row["energy"], row["energy_bound"], row["late_energy"] = account.energy, account.bound, account.late_energy
        account.hold(float(row["rendered_force"]))
    assert energy_figures(rows, DEVICE)["energy_agrees"]


def test_what_the_ceiling_cut() -> None:
    """The model's force falls by 0.1 N a tick, the rendered one once by 0.5 N; that it rises slowly is no cut."""
    mediated = [0.0, 3.0, 3.0, 2.9, 2.8, 2.7]
    rendered = [0.0, 0.2, 2.7, 2.6, 2.1, 2.1]
    rows = kept([0.0] * 6, rendered)
    rows["mediated_force"] = mediated
    assert energy_figures(rows, DEVICE)["largest_energy_cut_N"] == pytest.approx(0.4)
    rows["sequence"][4:] += 1  # a row was lost: nobody knows over how many ticks it fell
    assert energy_figures(rows, DEVICE)["largest_energy_cut_N"] == 0.0
    rows["mediated_force"] = 0.0  # a force that comes down as slowly as its limit lets it
    assert energy_figures(rows, DEVICE)["largest_energy_cut_N"] == 0.0


def test_no_more_is_cut_than_what_the_force_fell_by() -> None:
    """The model's force rises from 3 to 12 N while the ceiling takes the rendered one from 3 to 1 N."""
    rows = kept([0.0] * 4, [3.0, 3.0, 1.0, 1.0])
    rows["mediated_force"] = [3.0, 3.0, 12.0, 12.0]
    assert energy_figures(rows, DEVICE)["largest_energy_cut_N"] == 2.0


def test_a_force_that_grows_from_next_to_nothing_begins_one_contact() -> None:
    """Its first tick goes three counts and all others one, while the energy is too small to tell from none."""
    positions = [1e-3 + COUNT * (tick + 2 * (tick > 0)) for tick in range(40)]
    forces = [1e-18 * 1.4**tick for tick in range(30)] + [0.04] * 10
    rows = kept(positions, forces)
    assert rows["energy_bound"][-1] == pytest.approx(2.0 * 0.04 * 4 * COUNT)
    figures = energy_figures(rows, DEVICE)
    assert figures["energy_agrees"]
    assert figures["certificate_holds"]
