"""Slower than it was: what fails, and that nothing does now."""

from __future__ import annotations

from pathlib import Path

import pytest

from foretouch.bench.check import (
    BAND,
    SHORT_BAND,
    STALE,
    Checked,
    check,
    compare,
    measure_ratios,
    read_baseline,
    try_to_write,
    write_baseline,
)
from foretouch.errors import RecordingError


@pytest.mark.long  # as `make bench-check` does
def test_nothing_is_slower_than_the_committed_baseline() -> None:
    checked = check(short=True)
    assert {one.band for one in checked} == {SHORT_BAND}
    assert all(one.passed for one in checked), [one.sentence for one in checked if not one.passed]


@pytest.mark.long
def test_a_new_baseline_has_the_ratios_of_the_committed_one() -> None:
    assert measure_ratios(short=True).keys() == read_baseline().keys()


@pytest.mark.long
def test_what_is_slower_than_it_was_fails_in_the_end(tmp_path: Path) -> None:
    was = read_baseline() | {"FPRLS update": read_baseline()["FPRLS update"] / (3.0 * SHORT_BAND)}
    write_baseline(tmp_path / "was.json", was)
    checked = {one.name: one for one in check(tmp_path / "was.json", short=True)}
    assert not checked["FPRLS update"].passed


def test_a_ratio_that_became_worse_than_the_band_fails_alone() -> None:
    measured = read_baseline()
    for name in measured:
        worse = measured | {name: measured[name] * SHORT_BAND * 1.01}
        failed = [one for one in compare(worse, measured, SHORT_BAND) if not one.passed]
        assert [one.name for one in failed] == [name]
        assert "BEYOND" in failed[0].sentence
    within = {name: ratio * SHORT_BAND * 0.99 for name, ratio in measured.items()}
    assert all(one.passed for one in compare(within, measured, SHORT_BAND))


def test_what_one_side_does_not_know_fails() -> None:
    new, old = compare({"new": 1.0}, {"old": 1.0}, BAND)
    assert not new.passed
    assert "not in the baseline" in new.sentence
    assert not old.passed
    assert "not measured any more" in old.sentence


def test_a_baseline_that_is_staler_than_the_code_passes_and_is_said() -> None:
    below, just = Checked("a", 2.0 * STALE - 0.01, 2.0, BAND), Checked("a", 2.0 * STALE + 0.01, 2.0, BAND)
    assert below.passed
    assert just.passed
    assert below.sentence == (
        "a: 1.59, 0.80 times the baseline of 2: below the baseline by more than the noise: write it anew"
    )
    assert just.sentence.endswith("within the band of 1.6")


def test_whether_a_baseline_can_be_kept_is_seen_before(tmp_path: Path) -> None:
    path = tmp_path / "baseline.json"
    try_to_write(path)
    assert not path.exists()
    path.write_text("{}")
    try_to_write(path)
    assert path.read_text() == "{}"
    for wrong in (tmp_path, tmp_path / "none" / "baseline.json"):
        with pytest.raises(RecordingError, match="cannot be written"):
            try_to_write(wrong)


def test_a_baseline_is_kept_and_read(tmp_path: Path) -> None:
    path = tmp_path / "baseline.json"
    write_baseline(path, {"a": 1.23456, "b": 100.0})
    assert read_baseline(path) == {"a": 1.23, "b": 100.0}
    path.write_text("{")
    with pytest.raises(RecordingError, match="no baseline of ratios"):
        read_baseline(path)
    with pytest.raises(RecordingError, match="no baseline of ratios"):
        check(tmp_path / "none.json")
    with pytest.raises(RecordingError, match="cannot be written"):
        write_baseline(tmp_path / "none" / "baseline.json", {})
