"""The page of the grippers says what is computed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from foretouch.devices import DeviceSpecification
from foretouch.grippers.handle import TICK, felt_over_bus
from foretouch.grippers.servo import PERIODS

PAGE = (Path(__file__).parents[2] / "docs" / "grippers.md").read_text()


def test_the_table_of_rates_is_what_is_computed() -> None:
    rows = re.findall(r"^\| ([\d,]+) \| (\d+) N/m \| (\d+) N/m \|$", PAGE, re.MULTILINE)
    assert [1.0 / float(rate.replace(",", "")) for rate, _, _ in rows] == pytest.approx(list(PERIODS))
    for rate, *cells in rows:
        for damping, cell in zip((0.1, 1.0), cells, strict=True):
            felt = felt_over_bus(DeviceSpecification(damping=damping), 1.0 / float(rate.replace(",", "")))
            assert felt.largest_stiffness(TICK) == pytest.approx(float(cell), abs=0.51)
