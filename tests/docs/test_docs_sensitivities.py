"""The tuned numbers that the documentation halves and doubles are those of the modules, and change what they should."""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Iterator
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from docs_pages import ROOT

TUNED = ROOT / "docs" / "designs" / "tuned.py"
SCORES, LAYOUT = "foretouch.identification.contact_map.scores", "foretouch.models.contact_map.layout"


@pytest.fixture(scope="module")
def docs() -> Iterator[SimpleNamespace]:
    """The scripts of the documentation, which are no part of the package."""
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        names = ("beyond_files", "designs.tuned", "sensitivities")
        yield SimpleNamespace(**{name.rpartition(".")[2]: importlib.import_module(name) for name in names})
    finally:
        sys.path.remove(str(ROOT / "docs"))


def number(module: ModuleType, key: str) -> float:
    """What a module has under a key."""
    name, *place = key.split(":")[1:]
    value = getattr(module, name)
    return float(value[int(place[0])] if place else value)


def test_every_number_is_found_once_and_stands_in_its_module(docs: SimpleNamespace) -> None:
    keys = docs.tuned.keys()
    assert len(keys) == len(set(keys))
    assert 8 * len(keys) <= docs.tuned.PAGE
    for key in keys:
        if ":GRIDS:" not in key:
            assert number(importlib.import_module(key.split(":")[0]), key) > 0.0, key
    names = {key.split(":")[1] for key in keys}
    assert {
        "CLEAR",
        "NEEDED",
        "PENALTY",
        "SURE",
        "TIMES",
        "UNSURE",
        "RATE",
        "PEAK_SHARE",
    } <= names
    assert not {"LARGEST_FORCE", "EXPERTS", "CONTACT_FLOOR", "MEMORY"} & names
    assert set(docs.tuned.COMPILED) <= set(keys)


CHANGED = f"""
import ctypes, sys
sys.path.insert(0, {str(TUNED.parent)!r})
import tuned
tuned.install({{}})
import numba
from foretouch.identification.contact_map import learning, scores
from foretouch.models.contact_map import layout

@numba.njit
def compiled(index):
    return scores.PENALTY, layout.TIMES[index], scores.YOUNG

print(*compiled(1))
tuned.change("{SCORES}:PENALTY", 0.5)
tuned.change("{LAYOUT}:TIMES:1", 2.0)
tuned.change("foretouch.identification.exact.belief:YOUNG", 2.0)
print(*compiled(1))
print(scores.PENALTY, layout.TIMES[1], learning.YOUNG)
"""


@pytest.mark.long
def test_a_changed_number_is_changed_in_compiled_code_and_wherever_it_was_imported() -> None:
    done = subprocess.run([sys.executable, "-c", CHANGED], capture_output=True, text=True, check=True)
    assert [list(map(float, line.split())) for line in done.stdout.splitlines()] == [
        [1.2, 0.3, 0.1],
        [0.6, 0.6, 0.2],
        [0.6, 0.6, 0.2],
    ]


def test_what_is_chosen_by_some_files_is_scored_on_others(
    docs: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = {"tue/a-foam": 10.0, "tue/b-foam": 8.0, "tue/d-foam": 6.0, "tue/e-foam": 4.0, "tue/m1-d-foam": 20.0}
    better = {"tue/a-foam": 8.0, "tue/b-foam": 8.0, "tue/d-foam": 7.0, "tue/e-foam": 5.0, "tue/m1-d-foam": 10.0}

    def variant(key: str, factor: float) -> dict[str, float]:
        return better if key.endswith(":PENALTY") and factor == 2.0 else shipped

    monkeypatch.setattr(docs.sensitivities, "variant", variant)
    text = docs.sensitivities.leave_rig_out()
    assert text.startswith(f"1 of {len(docs.tuned.keys())} numbers would be others.")
    assert "| `scores.PENALTY` | doubled | 0.889 | 1.200 | 0.500 |" in text
    assert text.count("\n| `") == 1


def test_only_what_moves_is_bold(docs: SimpleNamespace) -> None:
    assert docs.sensitivities.pair(10.1, 10.3, 10.0) == "10.1 / **10.3**"
    base, one = {"tue/a-foam": 10.0, "foam, seed 100": 4.0}, {"tue/a-foam": 15.0, "foam, seed 100": 3.0}
    assert docs.sensitivities.loser((base, one), base) == "`tue/a-foam`, times 1.5"
    assert docs.sensitivities.loser((base, base), base) == "none"


def test_the_true_force_has_no_error_and_none_has_all_of_it(docs: SimpleNamespace) -> None:
    for what, (_, made) in docs.beyond_files.CASES.items():
        case = made(100)
        assert case.error(np.zeros(len(case.recording))) == pytest.approx(100.0), what
    force = np.array([1.0, 2.0, -3.0, 9.0])
    where = np.array([True, True, True, False])
    assert docs.beyond_files.relative(1.1 * force, force, where) == pytest.approx(10.0)


def test_a_row_says_what_is_met(docs: SimpleNamespace) -> None:
    asked = docs.beyond_files.Asked("x", "%", 4.0, 7.0, lambda _: [])
    rows = [docs.beyond_files.row(asked, found)[2:] for found in ([1.0, 2.0, 7.0], [1.0, 2.0, 8.0], [5.0, 5.0, 6.0])]
    assert [row[-1] for row in rows] == ["yes", "in the median", "no"]
    assert rows[0][:3] == ["4 / 7", "2", "7"]
    never = docs.beyond_files.row(asked._replace(middle=0.3, most=0.3), [0.1, 0.2, float("inf")])
    assert never[2:] == ["0.3", "0.2", "never", "in the median"]
    assert docs.beyond_files.counted([[1.0, 3.0]] * 2 + [[1.0, 1.0]] * 18)[3:] == ["19", "18", "no"]
