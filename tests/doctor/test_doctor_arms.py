"""An arm as the doctor looks at it: really made and timed, and refused where it cannot be."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from foretouch.doctor import Verdict
from foretouch.doctor.arms import check_arm, judge
from foretouch.errors import install_command

FAST = {"rate": 1000, "mean_s": 1e-4, "p50_s": 1e-4, "p99_s": 3e-4}


@pytest.mark.parametrize(("name", "rate", "later"), [("fr3", 1000, ""), ("so101", 200, "up to 4 ms later")])
@pytest.mark.first
def test_an_arm_is_really_made_and_timed(name: str, rate: int, later: str) -> None:
    pytest.importorskip("mink")
    finding = check_arm(name)
    assert finding.name == f"arm {name}"
    assert finding.verdict is not Verdict.UNKNOWN
    assert finding.figures["rate"] == rate
    assert 1e-6 < finding.figures["p50_s"] <= finding.figures["p99_s"] < 0.1
    assert later in finding.summary
    assert ("later than" in finding.summary) == bool(later)


def test_how_fast_is_fast_enough() -> None:
    assert judge("arm", FAST).verdict is Verdict.GOOD
    assert judge("arm", FAST | {"p99_s": 0.9e-3}).verdict is Verdict.WARNING
    slow = judge("arm", FAST | {"mean_s": 1.1e-3, "p99_s": 2e-3})
    assert slow.verdict is Verdict.BAD
    assert "falls behind" in slow.summary
    assert "later than" not in slow.summary
    assert "up to 1 ms later than at 1 kHz" in judge("arm", FAST | {"rate": 500}).summary


def test_a_description_that_breaks_a_rule_is_bad_in_one_line(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    path = tmp_path / "mine.xml"
    path.write_text("<mujoco><worldbody/></mujoco>")
    finding = check_arm(str(path))
    assert finding.verdict is Verdict.BAD
    assert 'it has no site "base"' in finding.summary
    assert "\n" not in finding.summary


def test_an_extra_that_is_missing_is_bad_and_the_command_brings_it() -> None:
    """In a process in which mink cannot be imported."""
    script = "import sys; sys.modules['mink'] = None; from foretouch.doctor.arms import main; main('fr3')"
    output = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert install_command("arms") in output
    assert "problem" in output
