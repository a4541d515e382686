"""Records of named fields: first values, and the same bits compiled and interpreted."""

from __future__ import annotations

import copy
from typing import Annotated, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from foretouch.core import Held, Record, compiled
from foretouch.core.compiling import interpreted


class Peak(Record):
    force: float = -np.inf
    recent: Annotated[NDArray[Any], float, 3]
    count: int


class Both(Record):
    touched: bool
    peak: Peak
    fingers: Annotated[NDArray[Any], Peak, 2]


@compiled
def higher(peak: Peak, force: float) -> None:
    peak.force = max(peak.force, force)
    peak.recent[peak.count % 3] = force
    peak.count += 1


@compiled
def touch(states: NDArray[Any], force: float) -> float:
    both = states[0]
    both.touched = True
    higher(both.peak, force)
    higher(both.fingers[1], 0.1 * force)
    return float(both.peak.force)


def test_a_new_record_has_the_values_of_its_class_and_of_the_records_in_it() -> None:
    state = Both.new(2)[1]
    assert (state.touched, state.peak.force, state.fingers[1].force) == (False, -np.inf, -np.inf)
    assert str(Peak.new(recent=(1, 2, 3), count=7)) == "[(-inf, [1., 2., 3.], 7)]"
    state.peak.force = 4.0
    assert (state.peak.force, Both.new()[0].peak.force) == (4.0, -np.inf)


def test_compiled_and_interpreted_leave_the_same_bits() -> None:
    states = Both.new(), Both.new()
    for function, state in zip((touch, interpreted(touch)), states, strict=True):
        assert [function(state, force) for force in (1.0, 3.0, 2.0, 0.1)] == [1.0, 3.0, 3.0, 3.0]
    assert states[0].tobytes() == states[1].tobytes()
    assert states[0][0].peak.recent.tolist() == [0.1, 3.0, 2.0]


@pytest.mark.parametrize("wrong", ["forse", "fingers[0].recentt"])
def test_a_name_that_is_no_field_is_refused(wrong: str) -> None:
    with pytest.raises(AttributeError):
        eval(f"state.{wrong}", {"state": Both.new()[0]})
    with pytest.raises(ValueError, match="no field"):
        Both.new(forse=1.0)


def test_what_holds_a_record_can_be_copied() -> None:
    held = Held(Peak.new(force=2.0))
    for made in (copy.copy(held), copy.deepcopy(held)):
        assert made.force == 2.0
    made.force = 3.0
    assert held.force == 2.0  # the deep copy has a record of its own
