"""The recording checks what it is given; the table of quantities has one row each."""

from __future__ import annotations

import numpy as np
import pytest

from foretouch.errors import RecordingError
from foretouch.quantities import QUANTITIES, Recording

TIME = np.array([0.0, 0.1, 0.2])


def test_quantities_are_named_once() -> None:
    names = [quantity.name for quantity in QUANTITIES]
    assert len(set(names)) == len(names)
    assert all(quantity.unit and quantity.meaning for quantity in QUANTITIES)


def test_columns_are_copied_and_read_only() -> None:
    position = np.zeros(3)
    recording = Recording(TIME, position, np.ones(3))
    position[0] = 5.0
    assert recording.position[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        recording.force[0] = 2.0
    assert len(recording) == 3


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"force": [0.0, np.nan, 0.0]}, r"press, row 3: force is nan: every value must be finite"),
        ({"position": [0.0, 0.0, np.inf]}, r"press, row 4: position is inf"),
        ({"time": [0.0, 0.1, 0.1]}, r"press, row 4: time 0.1 s does not come after the row before"),
        ({"position": [0.0, 12.0, 0.0]}, r"press, row 3: position 12 m is beyond 1 m: .*--position-unit"),
        ({"force": [0.0, 0.0]}, r"press: force has shape \(2,\), time has 3 samples"),
        ({"velocity": [0.0, np.nan, 0.0]}, r"press, row 3: velocity is nan"),
    ],
)
def test_what_breaks_a_rule_is_refused_by_row(columns: dict[str, list[float]], message: str) -> None:
    arguments = {"time": TIME, "position": np.zeros(3), "force": np.zeros(3), **columns}
    with pytest.raises(RecordingError, match=message):
        Recording(**arguments, name="press", first_row=2)


def test_one_sample_is_no_recording() -> None:
    with pytest.raises(RecordingError, match="1 sample: at least 2 are needed"):
        Recording(np.zeros(1), np.zeros(1), np.zeros(1))
