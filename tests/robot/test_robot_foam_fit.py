"""The foam's coefficients: what is shipped is what the fit gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from foretouch.errors import RecordingError, SettingError
from foretouch.quantities import Recording
from foretouch.recordings import read_recording
from foretouch.robot import FOAM_DATASETS, fit_foam, foam_fit_json
from foretouch.robot.materials import FoamFit, shipped_foam_fit
from foretouch.robot.materials.foam_fit import replay


def test_shipped_fit_says_where_it_comes_from() -> None:
    fit = shipped_foam_fit()
    assert len(fit.files) == len(FOAM_DATASETS)
    for part in ("TU/e", "commit 2ae23ed4", "MIT", "foretouch materials fit"):
        assert part in fit.provenance
    assert all(0.0 < file.residual_percent < 12.0 for file in fit.files)


def test_a_known_law_is_found_again() -> None:
    """Presses made with the shipped law are fitted to a few percent, with surface and offset."""
    law = shipped_foam_fit().model()
    time = np.arange(0.0, 4.0, 1e-3)
    position = (
        0.02 + 0.0035 - 0.0055 * np.cos(2.0 * np.pi * 1.3 * time) * (0.7 + 0.3 * np.cos(2.0 * np.pi * 0.2 * time))
    )
    made = Recording(time, position, np.zeros_like(time))
    times, force = replay(law, made, 0.02)
    recording = Recording(times, np.interp(times + 1e-3, time, position), force + 3.0, contact_floor=0.3)
    (result,) = fit_foam([recording], provenance="made").files
    assert result.residual_percent < 3.0
    assert result.force_offset == pytest.approx(3.0, abs=0.15)


def test_bad_recordings_are_refused() -> None:
    with pytest.raises(SettingError, match="at least one recording"):
        fit_foam([])
    time = np.arange(0.0, 1.0, 1e-3)
    with pytest.raises(RecordingError, match="never rises past 2 N"):
        fit_foam([Recording(time, 0.01 * time, np.sin(time), name="light.csv")])


def test_fit_is_written_whole(tmp_path: Path) -> None:
    fit = shipped_foam_fit()
    (tmp_path / "foam.json").write_bytes(foam_fit_json(fit))
    assert msgspec.json.decode((tmp_path / "foam.json").read_bytes(), type=FoamFit) == fit
    assert [path.name for path in tmp_path.iterdir()] == ["foam.json"]


@pytest.mark.long
def test_fit_gives_the_shipped_coefficients(measured: Callable[[str], Path]) -> None:
    shipped = shipped_foam_fit()
    fit = fit_foam([replace(read_recording(measured(name)), name=name) for name in FOAM_DATASETS])
    assert [file.name for file in fit.files] == [file.name for file in shipped.files]
    assert [file.surface for file in fit.files] == pytest.approx([file.surface for file in shipped.files], abs=1e-6)
    assert np.array(fit.springs) == pytest.approx(np.array(shipped.springs), rel=1e-3)
    assert [row[:3] for row in fit.branches] == [pytest.approx(row[:3], rel=1e-3) for row in shipped.branches]
    residuals = [file.residual_percent for file in fit.files]
    assert residuals == pytest.approx([file.residual_percent for file in shipped.files], abs=0.05)
    assert max(residuals) < 12.0
