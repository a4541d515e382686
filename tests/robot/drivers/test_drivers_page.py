"""The page of the drivers says what there is."""

from __future__ import annotations

import importlib
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "drivers.md").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_every_driver_is_on_it_and_each_entry_point_is_a_function() -> None:
    points = PROJECT["entry-points"]["foretouch.robots"]
    assert {"franka", "udp", "ur"} <= set(points)
    for name, target in points.items():
        module, _, function = target.partition(":")
        assert callable(getattr(importlib.import_module(module), function))
        if name in ("ros2", "dynamixel"):  # which have pages of their own
            continue
        assert f"`foretouch teleop --robot {name}@HOST`" in PAGE
        assert name == "udp" or f"`pip install 'foretouch[{name}]'`" in PAGE
        assert name == "udp" or name in PROJECT["optional-dependencies"]


def test_a_driver_of_ones_own_has_forty_lines() -> None:
    (block,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    assert len(block.splitlines()) <= 40
