"""A simulated hand in a loop that is late: what it does meanwhile counts for the time that it took."""

from __future__ import annotations

import math

import pytest

from foretouch.messages import VERSION, LeaderState, ModelUpdate, SessionLog, Telemetry
from foretouch.report import energy_figures
from foretouch.report.energy import BookedDevice
from foretouch.session import SessionSettings
from foretouch.session.steps import leader

MS = 1_000_000
SPEED = 0.05
LATE = 25
MODEL = ModelUpdate(VERSION, 1, 0, 0, "hunt-crossley", (400.0, 0.0, 1.0), (), 0.0, True, "", "fprls", b"")
SEEN = Telemetry(VERSION, 1, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, False, 0, MS, 0)


def pressed(*, simulated: bool) -> list[LeaderState]:
    settings = SessionSettings(grip="normal", first_touch="follow")
    state, records, begun = leader.start(settings, device=None if simulated else settings.device), [], 0
    for tick in (*range(100), *range(99 + LATE, 200)):
        begins = (tick + (LATE - 1 if tick == 99 else 0)) * MS
        position = SPEED * 1e-9 * (tick * MS if simulated else begins)
        inputs = leader.Inputs(
            position, [MODEL] if tick == 1 else [], [SEEN] if tick == 0 else [], begins - begun if tick else 0, 0
        )
        inputs = inputs._replace(exact_position=position if simulated else math.nan)
        state, output = leader.step(state, inputs, tick * MS)
        records.append(output.record)
        begun = begins
    return records


@pytest.mark.parametrize("simulated", [True, False])
def test_no_late_tick_widens_the_bound(simulated: bool) -> None:
    records = pressed(simulated=simulated)
    newest, device = records[-1], SessionSettings(grip="normal").device
    assert newest.rendered_force > 1.0
    farthest = SPEED * 1e-3 + device.resolution
    largest = max(record.rendered_force for record in records[:-1])
    allowed = (1.0 + 2.0 * device.delay / 1e-3) * largest * farthest
    assert newest.energy_bound == pytest.approx(allowed, rel=1e-6)


@pytest.mark.parametrize("simulated", [True, False])
def test_the_report_books_a_late_tick_as_the_leader_did(simulated: bool) -> None:
    records = pressed(simulated=simulated)
    device = SessionSettings(grip="normal").device
    log = SessionLog.from_messages(records)
    figures = energy_figures(log.leader, BookedDevice(device.resolution, device.delay, device.watchdog))
    assert figures["energy_agrees"] is True
    assert figures["certificate_holds"] is True
