"""A whole session, once compiled and once with nothing compiled: the same to nine digits."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from foretouch.messages import SessionLog
from foretouch.session import SessionSettings, simulate

pytest.importorskip("mujoco")

DIGITS = 1e-9
"""Of the largest number of a column: LLVM and Python may round a power or an exponential differently."""

SIMULATED: dict[str, tuple[float, dict[str, object]]] = {
    "open loop": (2.2, {}),
    "a hand feels it": (3.5, {"grip": "normal", "force_delay": 0.05, "position_delay": 0.02}),
    "in space": (7.0, {"scene": "plane", "first_touch": "follow", "fusion": "image"}),
}
"""How long [s], and what is set."""


def session(duration: float, changes: dict[str, object]) -> SessionLog:
    settings = SessionSettings(material="hunt-crossley", loss=0.02, jitter=0.005, **changes)  # type: ignore[arg-type]
    return simulate(settings, duration=duration).log


def everything(what: str) -> dict[str, np.ndarray]:
    """All numbers that one of `SIMULATED` says, in columns by name."""
    output, log = {}, session(*SIMULATED[what])
    spaces = ("leader in space", log.leader_space), ("follower in space", log.follower_space)
    for side, rows in (("leader", log.leader), ("follower", log.follower), *spaces):
        names = [name for name in rows.dtype.names or () if rows.dtype[name].kind in "fib" and name != "compute_ns"]
        output |= {f"{side}, {name}": rows[name].astype(float) for name in names}
    for name in ("parameters", "state"):
        numbers = [number for model in log.models for number in getattr(model, name)]
        output[f"models, {name}"] = np.array(numbers, dtype=float)
    return output


INTERPRETED = """
import sys, numba, numpy
sys.path.insert(0, {folder!r})
from test_session_interpreted import everything
assert numba.config.DISABLE_JIT
numpy.savez({path!r}, **everything({what!r}))
"""


@pytest.mark.long
@pytest.mark.parametrize("what", SIMULATED)
def test_compiled_and_interpreted_are_equal(what: str, tmp_path: Path) -> None:
    path = tmp_path / "said.npz"
    script = INTERPRETED.format(folder=str(Path(__file__).parent), path=str(path), what=what)
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    subprocess.run([sys.executable, "-c", script], env=environment, check=True, timeout=300)
    compiled = everything(what)
    with np.load(path) as interpreted:
        assert set(interpreted) == set(compiled)
        for name, column in compiled.items():
            finite = column[np.isfinite(column)]
            tolerance = DIGITS * np.abs(finite).max(initial=0.0)
            np.testing.assert_allclose(interpreted[name], column, rtol=0.0, atol=tolerance, err_msg=name)
    assert compiled["leader, predicted_force"].max() > 0.5
    assert compiled["leader, rendered_force"].max() > 0.01
    assert compiled["models, parameters"].size > 20
