"""Parts of single benchmarks: lateness and its causes, what an hour is foretold to take, growth, steps, memory."""

from __future__ import annotations

import mmap
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.bench.benchmarks import commands
from foretouch.bench.benchmarks.commands import (
    HOUR,
    LONG,
    OFFSET,
    SHORT,
    SURFACE,
    foretold,
    recorded_press,
    write_recording,
    write_recordings,
)
from foretouch.bench.benchmarks.loops import CAUSES, LATE_NS, PERIOD_NS, causes, read_notes, side, ticks_of
from foretouch.bench.benchmarks.steps import TapedSession
from foretouch.bench.benchmarks.streams import Streamed, slope
from foretouch.bench.benchmarks.updates import CALLED, SIDES, memory_growth, sheet, slide
from foretouch.bench.peers import press, samples
from foretouch.bench.timing import Scope
from foretouch.files.children import measure_process
from foretouch.identification import ContactSample, Estimator, Status
from foretouch.messages.session_log import FOLLOWER_DTYPE
from foretouch.recordings import read_recording
from foretouch.recordings.session.reader import LARGE


def rows(late_ns: list[int], compute_ns: list[int] | None = None) -> np.ndarray:
    """Rows of a loop at 1 kHz whose ticks woke so late after the first deadline that each missed."""
    result, woke, deadline = np.zeros(len(late_ns), FOLLOWER_DTYPE), 0, 10**12
    for place, late in enumerate(late_ns):
        if place:
            deadline += PERIOD_NS
        now = deadline + late
        deadline += late // PERIOD_NS * PERIOD_NS  # as the loop passes over what is gone
        result[place]["sequence"], result[place]["time_ns"] = place + 1, deadline
        result[place]["period_ns"], woke = now - woke if woke else 0, now
        result[place]["compute_ns"] = compute_ns[place] if compute_ns else 0
    return result


@given(st.lists(st.integers(0, 5_000_000), min_size=2, max_size=50))
def test_lateness_follows_from_what_a_loop_says(late: list[int]) -> None:
    late[0] = 0
    assert ticks_of(rows(late)).late_ns.tolist() == late


def test_rows_that_are_missing_begin_anew() -> None:
    late = [0, 100, 0, 700_000, 0, 0, 200]
    kept = np.delete(rows(late), 3)
    assert ticks_of(kept).late_ns.tolist() == [0, 100, 0, 0, 0, 200]
    assert ticks_of(kept[:1]).late_ns.size == 0


def test_every_late_tick_has_one_cause() -> None:
    late, compute = [0] * 10, [50_000] * 10
    late[2], late[5], late[8] = 900_000, 2_700_000, 600_000
    compute[5] = 3_600_000  # the tick before computed for so long
    ticks = ticks_of(rows(late, compute))
    deadline = int(ticks.deadline_ns[8])
    result = causes(ticks, [(deadline - 100_000, deadline + 300_000)])
    assert result == {"scheduler": 1, "garbage collection": 1, "us": 1}
    assert sum(result.values()) == int((ticks.late_ns > LATE_NS).sum())
    assert tuple(result) == CAUSES


def test_a_side_notes_its_collections(tmp_path: Path) -> None:
    import gc

    from foretouch.bench.benchmarks.loops import _noting

    with _noting(tmp_path / "notes.json"):
        before = time.monotonic_ns()
        gc.collect()
    notes = read_notes(tmp_path / "notes.json")
    assert any(before <= begin <= end for begin, end in notes.collections)
    side(str(tmp_path / "bare.json"), "bare", "0.05")
    assert len(read_notes(tmp_path / "bare.json").late_ns) == 50


def test_an_hour_is_foretold_from_a_line() -> None:
    short, long = (SHORT, 2.0 + 0.01 * SHORT), (LONG, 2.0 + 0.01 * LONG)
    assert foretold(short, long) == pytest.approx(2.0 + 0.01 * HOUR)
    assert foretold((SHORT, 2.1), (LONG, 2.0)) == 2.0


def test_the_recording_from_which_a_cache_is_foretold_has_one(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    path, seconds = tmp_path / "press.mcap", 5.0
    write_recording(path, seconds)
    byte_rate = path.stat().st_size / seconds
    assert byte_rate * SHORT < LARGE < byte_rate * LONG


@pytest.mark.long
def test_an_hour_is_foretold_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mcap")
    monkeypatch.setattr(commands, "REACHES", {"MCAP": commands.REACHES["MCAP"]})
    for name, value in {"RUNS": 1, "SHORT": 4.0, "LONG": 8.0}.items():
        monkeypatch.setattr(commands, name, value)
    rows = commands.measure_identify(Scope(False, pytest.fail))
    assert [row.what.partition("MCAP")[2] for row in rows] == [
        ": memory over that of the columns (of 10 min)",
        " (foretold from 1 and 10 min, the least of 1 runs)",
        ", read again by the samples kept beside it (foretold from 1 s and 10 min, the least of 1 runs)",
    ]
    assert all(row.figure > 0.5 for row in rows[1:])  # a process starts


@pytest.mark.long
def test_a_missing_package_leaves_out_the_rows_of_its_format_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyarrow")
    monkeypatch.setattr(commands, "HOUR", 20.0)
    monkeypatch.setattr(commands, "REACHES", {name: commands.REACHES[name] for name in ("MCAP", "CSV")})
    for module in [name for name in sys.modules if name.partition(".")[0] == "mcap"] + ["mcap"]:
        monkeypatch.setitem(sys.modules, module, None)  # as where it is not installed
    output: list[str] = []
    rows = commands.measure_identify(Scope(False, output.append))
    assert [row.what.split(", ")[1].partition(":")[0] for row in rows] == ["CSV", "CSV"]
    assert len(output) == 1
    assert output[0].startswith("the rows of MCAP are left out: mcap is not installed")


def test_a_slope_tells_linear_from_quadratic() -> None:
    sizes = [10**power for power in range(3, 8)]
    assert slope([Streamed(size, 3e-9 * size, 0) for size in sizes]) == pytest.approx(1.0)
    assert slope([Streamed(size, 3e-9 * size**2, 0) for size in sizes]) == pytest.approx(2.0)


class Hoarder(Estimator):
    """Keeps every sample: what the measure of memory is to find."""

    name, model_name, model, standard_errors = "hoarder", "none", None, None

    def __init__(self) -> None:
        self.kept: list[object] = []

    def update(self, sample: ContactSample) -> Status:
        page = mmap.mmap(-1, 12_288)  # straight from the kernel: the heap of a long run may have room of its own
        page.write(b"1" * 12_288)
        self.kept.append(page)
        return Status.LEARNT

    def reset(self) -> None:
        self.kept.clear()


@pytest.mark.parametrize("name", CALLED)
@pytest.mark.long
def test_memory_does_not_grow_with_calls_and_growth_is_found(name: str) -> None:
    pressed = samples(press(6_000))
    assert memory_growth(CALLED[name][0](), pressed) < 100_000  # some pages of 4,096 bytes, in 3,000 calls
    assert memory_growth(Hoarder(), pressed) > 5_000 * 3_000


@pytest.mark.long
def test_a_session_on_tape_is_the_same_again() -> None:
    session = TapedSession(1.6)
    first, second = session.times(), session.times()
    assert np.array_equal(first["contact"], second["contact"])
    assert first["contact"].any()
    assert all((first[side] > 0.0).all() for side in ("leader", "follower"))


def test_processes_are_timed_and_failures_said() -> None:
    held = b"1" * 300_000_000  # by whoever starts it: not to be counted as its own
    hog = measure_process(["-c", "x = b'1' * 200_000_000; print(len(x))"])
    slim = measure_process(["-c", "print(1)"])
    assert hog.peak - slim.peak == pytest.approx(200e6, rel=0.1)
    assert hog.output == "200000000\n"
    assert slim.peak < 100e6 < len(held)
    failing = "import sys; sys.stderr.write('no luck\\n'); sys.exit(3)"
    with pytest.raises(RuntimeError, match=r"x1 x2 and 38 arguments more: exit code 3: no luck$"):
        measure_process(["-c", failing, *(f"x{number}" for number in range(1, 41))])


@pytest.mark.parametrize("ending", [".csv", ".parquet", ".mcap"])
@pytest.mark.first
def test_a_recording_is_the_same_in_every_format(ending: str, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    path = tmp_path / f"press{ending}"
    write_recording(path, 2.0)
    columns, read = recorded_press(2.0), read_recording(path)
    assert read.time - read.time[0] == pytest.approx(columns["time_s"])
    assert read.position == pytest.approx(columns["position_m"])
    assert read.force == pytest.approx(columns["force_N"])
    air = columns["position_m"] < SURFACE
    assert columns["force_N"][air].mean() == pytest.approx(OFFSET, abs=0.01)


def test_many_recordings_are_files_of_their_own(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    paths = write_recordings(tmp_path, 3, 1.0)
    assert len({path.resolve() for path in paths}) == 3
    assert all(len(read_recording(path)) == 1000 for path in paths)


def test_the_probe_slides_below_the_sheet() -> None:
    few, many = (sheet(side) for side in SIDES[:2])
    assert len(few.faces) == 2 * SIDES[0] ** 2
    for surface, tolerance in ((few, 1e-3), (many, 2e-4)):
        memory = surface.initial_memory()
        contacts = [surface.follow(memory, *place) for place in slide()]
        assert contacts[0].depth <= 0.0
        deep = np.array([contact.depth for contact in contacts[100:]])
        assert (deep > 0.0).mean() > 0.9
        assert np.median(deep) == pytest.approx(1e-3, abs=tolerance)
