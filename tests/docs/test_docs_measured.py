"""Measured tables know of which code they are: the sources that a table depends on, and what the pages say of it."""

from __future__ import annotations

import importlib
import math
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from docs_pages import ROOT

from foretouch.recordings import list_datasets

KERNEL = "src/foretouch/identification/conditioning/watch.py"
PAGE = "docs/rooms/identification.md"


@pytest.fixture(scope="module")
def docs() -> Iterator[SimpleNamespace]:
    """The scripts of the documentation, which are no part of the package."""
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        names = ("sources", "measured_sources", "measured_blocks", "measuring", "measure_results")
        yield SimpleNamespace(**{name: importlib.import_module(name) for name in names})
    finally:
        sys.path.remove(str(ROOT / "docs"))


# What a definition reaches


SMALL = {
    "pack/__init__.py": "from pack.laws import Law, spare\n",
    "pack/laws.py": '''"""Laws."""
import math
from typing import TYPE_CHECKING
from pack import numbers, shown

if TYPE_CHECKING:
    from pack.never import Never

class Law:
    """A law."""

    def force(self, depth: "Never") -> float:
        """Its force."""
        from pack import late

        return late.scale(depth) * numbers.STIFFNESS * math.pi  # as always

def spare() -> int:
    return shown.WIDTH
''',
    "pack/late.py": "from pack import numbers as given\n\ndef scale(x):\n    return x * given.FACTOR\n",
    "pack/numbers.py": "STIFFNESS = 3.0\nFACTOR = 2.0\nUNUSED = 1.0\nFITTED = read('fit.json')\n",
    "pack/registry.py": "from pack.laws import spare\n\nLAWS = {}\nfor kind in (spare,):\n    LAWS[kind] = kind\n",
    "pack/shown.py": "WIDTH = 80\n",
    "pack/never.py": "Never = 1\n",
    "pack/named.py": "def load():\n    return module_of('pack.numbers')\n",
    "pack/fit.json": "[1]",
}


@pytest.fixture
def small(tmp_path: Path) -> Path:
    for name, text in SMALL.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return tmp_path


def reached(docs: SimpleNamespace, folder: Path, *roots: str, ignored: tuple[str, ...] = ()) -> set[str]:
    result = docs.sources.Sources([folder]).reached(roots, ignored)
    return {f"{module.removeprefix('pack.')}:{name}" for module, name in result if name}


def test_names_are_followed_through_packages_modules_and_imports_inside_functions(
    docs: SimpleNamespace, small: Path
) -> None:
    expected = {"laws:Law", "late:scale", "numbers:STIFFNESS", "numbers:FACTOR"}
    assert reached(docs, small, "pack:Law") == expected
    assert reached(docs, small, "pack:spare") == {"laws:spare", "shown:WIDTH"}
    assert reached(docs, small, "pack:spare", ignored=("pack.shown",)) == {"laws:spare"}


def test_what_an_import_does_and_what_a_string_names_is_followed(docs: SimpleNamespace, small: Path) -> None:
    assert {"registry:LAWS", "laws:spare"} <= reached(docs, small, "pack.registry:LAWS")
    assert {"numbers:STIFFNESS", "numbers:UNUSED"} <= reached(docs, small, "pack.named:load")
    assert {"numbers:UNUSED", "shown:WIDTH", "never:Never"} <= reached(docs, small, "pack.*")
    assert reached(docs, small, "pack.shown", ignored=("pack.shown",)) == {"shown:*", "shown:WIDTH"}


def test_a_root_that_is_not_there_is_said(docs: SimpleNamespace, small: Path) -> None:
    with pytest.raises(LookupError, match=r"there is no pack\.laws:Flaw in the sources"):
        docs.sources.Sources([small]).reached(["pack.laws:Flaw"])


@pytest.mark.parametrize(
    ("file", "old", "new", "changes"),
    [
        ("pack/laws.py", "  # as always", "  # or never", False),
        ("pack/laws.py", '"""Its force."""', '"""The force, in newtons."""', False),
        ("pack/laws.py", '        """Its force."""\n', "", False),
        ("pack/laws.py", 'depth: "Never"', "depth: float", True),  # an annotation leads nowhere, but it is syntax
        ("pack/laws.py", "return late", "return  (late", None),
        ("pack/laws.py", "math.pi", "math.tau", True),
        ("pack/numbers.py", "UNUSED = 1.0", "UNUSED = 9.0", False),
        ("pack/numbers.py", "STIFFNESS = 3.0", "STIFFNESS = 3.1", True),
        ("pack/late.py", "return x *", "return x +", True),
        (
            "pack/late.py",
            "    return",
            "    if x < 0.0:\n        why = 'below 0'\n        raise ValueError(why)\n    return",
            False,
        ),
        ("pack/late.py", "    return", "    if x < 0.0:\n        x = 0.0\n    return", True),
        ("pack/shown.py", "80", "81", False),
        ("pack/never.py", "1", "2", False),
    ],
)
def test_only_what_can_move_a_figure_changes_the_digest(
    docs: SimpleNamespace, small: Path, file: str, old: str, new: str, changes: bool | None
) -> None:
    def digest() -> str:
        return str(docs.sources.digest_of(docs.sources.Sources([small]).reached(["pack:Law"])))

    before = digest()
    text = (small / file).read_text()
    assert text.count(old) == 1
    (small / file).write_text(text.replace(old, new))
    if changes is None:
        with pytest.raises(SyntaxError):
            digest()
        return
    assert (digest() != before) == changes


def test_what_is_moved_to_another_module_has_the_same_digest(docs: SimpleNamespace, small: Path) -> None:
    def digest() -> str:
        return str(docs.sources.digest_of(docs.sources.Sources([small]).reached(["pack:Law"])))

    before = digest()
    (small / "pack" / "room").mkdir()
    (small / "pack" / "room" / "__init__.py").touch()
    for name in ("late", "numbers"):
        (small / "pack" / f"{name}.py").rename(small / "pack" / "room" / f"{name}.py")
    for path in small.rglob("*.py"):
        path.write_text(re.sub(r"from pack import (late|numbers)", r"from pack.room import \1", path.read_text()))
    laws = small / "pack" / "laws.py"
    laws.write_text(
        laws.read_text().replace("pack import numbers, shown", "pack import shown\nfrom pack.room import numbers")
    )
    assert digest() == before


def test_data_beside_a_module_counts(docs: SimpleNamespace, small: Path) -> None:
    def digest(root: str) -> str:
        return str(docs.sources.digest_of(docs.sources.Sources([small]).reached([root])))

    before = digest("pack.numbers:FITTED"), digest("pack.numbers:FACTOR")
    (small / "pack" / "fit.json").write_text("[2]")
    after = digest("pack.numbers:FITTED"), digest("pack.numbers:FACTOR")
    assert [one != other for one, other in zip(before, after, strict=True)] == [True, False]


def test_syntax_is_alike_on_newer_versions_of_python(docs: SimpleNamespace) -> None:
    """Newer ones have fields that older ones do not, empty where nothing new is used."""
    import ast

    function = ast.parse("def f(x): return -x").body[0]
    before = docs.sources.syntax(function)
    for name in ("type_params", "field_of_the_future"):
        function._fields = (*function._fields, name)  # type: ignore[misc]
        setattr(function, name, [])
    assert docs.sources.syntax(function) == before


# The blocks of the pages


@pytest.fixture(scope="module")
def depends(docs: SimpleNamespace) -> dict[tuple[str, str], set[str]]:
    """The modules that each block depends on."""
    sources = docs.measured_sources.sources_of()
    keys = docs.measured_sources.BLOCKS
    return {key: {module for module, _ in docs.measured_sources.reached_by(key, sources)} for key in keys}


@pytest.mark.long  # `make check` looks at every block
def test_every_block_has_its_sources_and_the_other_way_round(
    docs: SimpleNamespace, depends: dict[tuple[str, str], set[str]]
) -> None:
    there = [block.key for block in docs.measured_blocks.blocks()]
    assert len(there) == len(set(there))
    assert set(there) == set(depends)
    assert all(len(modules) > 1 for key, modules in depends.items() if key[1] not in ("machine", "bounds"))


@pytest.mark.long
def test_blocks_depend_on_what_moves_their_figures(depends: dict[tuple[str, str], set[str]]) -> None:
    reach, sessions = depends["docs/results.md", "reach"], depends["docs/results.md", "sessions"]
    kernel = "foretouch.identification.contact_map.scores"
    assert kernel in reach & sessions & depends["docs/contact-map.md", "designs"]
    assert "foretouch.session.safety.kernel" in sessions & depends["docs/safety.md", "impacts"]
    assert "foretouch.session.safety.kernel" not in reach
    assert "foretouch.rendering.renderer" in depends["docs/stability.md", "first-touch"]
    assert "foretouch.reproduction.figures.fig8" in depends["docs/results.md", "claims"]
    assert not any(kernel in depends["docs/identifiability.md", name] for name in ("bounds", "twins"))
    impedance = "foretouch.robot.arms.control.impedance"
    assert {page for (page, _), modules in depends.items() if impedance in modules} == {"docs/arms.md"}
    for modules in depends.values():
        assert not any("drawing" in module or module.startswith("foretouch.plugins") for module in modules)


def test_every_script_that_fills_a_page_is_in_the_table(docs: SimpleNamespace) -> None:
    roots = {root.split(":")[0] for roots in docs.measured_sources.BLOCKS.values() for root in roots}
    filling = {
        path.stem for path in (ROOT / "docs").glob("*.py") if re.search(r"^ +fill\(", path.read_text(), re.MULTILINE)
    }
    assert filling - {"measured_blocks"} <= roots


# One page from the beginning to the end


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two pages, their scripts and the package, kept by Git; the real table of sources, of these two pages."""
    root = tmp_path_factory.mktemp("copy")
    kept = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "src", root / "src", ignore=kept)
    (root / PAGE).parent.mkdir(parents=True)
    names = ("sources", "measured_sources", "measured_blocks", "measure_sensor_faults", "draw_identifiability")
    for name in (*(f"{name}.py" for name in names), "identifiability.md", "rooms/identification.md"):
        shutil.copy(ROOT / "docs" / name, root / "docs" / name)
    (root / "README.md").write_text("")
    with (root / "docs" / "measured_sources.py").open("a") as file:
        file.write("\nBLOCKS = {key: BLOCKS[key] for key in BLOCKS if 'identif' in key[0]}\n")
    run(root, "git", "init", "--quiet")
    return root


def run(root: Path, *command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=60)


def check(root: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return run(root, sys.executable, "docs/measured_blocks.py", *options)


def fill(root: Path, name: str, text: str, meanwhile: str = "") -> None:
    """Fill a block of a page as a script does, and do something to the sources meanwhile."""
    script = f"import sys; sys.path[:0] = ['docs']; from pathlib import Path; import measured_blocks; {meanwhile}\n"
    done = run(root, sys.executable, "-c", f"{script}measured_blocks.fill(Path({PAGE!r}), {{{name!r}: {text!r}}})")
    assert done.returncode == 0, done.stderr


def commit(root: Path) -> None:
    run(root, "git", "add", "--all")
    options = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    done = run(root, "git", *options, "commit", "--quiet", "--message", "filled")
    assert done.returncode == 0, done.stderr


def change(root: Path, old: str, new: str) -> None:
    text = (root / KERNEL).read_text()
    assert old in text
    (root / KERNEL).write_text(text.replace(old, new, 1))


@pytest.mark.long  # `make check` names what is stale
@pytest.mark.skipif(shutil.which("git") is None, reason="what changed is known by Git")
def test_a_table_that_is_made_stale_is_named_and_marked_and_filled_again(docs: SimpleNamespace, copy: Path) -> None:
    earlier = docs.measured_blocks.EARLIER
    constant = re.search(r"^([A-Z_]+)(?:: \w+)? = ([\d.]+)$", (copy / KERNEL).read_text(), re.MULTILINE)
    assert constant is not None

    def block() -> re.Match[str]:
        result = list(docs.measured_blocks.BLOCK.finditer((copy / PAGE).read_text()))
        assert [one["name"] for one in result] == ["sensor-faults"]
        return result[0]

    assert check(copy, "--mark").returncode == 0
    fill(copy, "sensor-faults", "| new \\1 |\n")
    assert block()["text"] == "| new \\1 |\n"
    commit(copy)
    done = check(copy)
    assert done.returncode == 0, done.stderr

    change(copy, '"""', '"""Said otherwise. ')
    change(copy, constant[0], f"{constant[0]}  # as good as any")
    done = check(copy)
    assert done.returncode == 0, done.stderr

    change(copy, constant[0], constant[0].replace(constant[2], f"1{constant[2]}"))
    done = check(copy)
    assert done.returncode == 1
    lines = done.stderr.splitlines()
    assert re.fullmatch(
        rf"{re.escape(PAGE)}: sensor-faults was measured on earlier code: since \w+ {re.escape(KERNEL)}", lines[0]
    )
    assert lines[1].startswith("1 measured blocks do not say truly of which code they are")

    assert check(copy, "--mark").returncode == 0
    assert block()["text"] == f"{earlier}| new \\1 |\n"
    assert check(copy).returncode == 0

    change(copy, f"1{constant[2]}", constant[2])
    done = check(copy)
    assert done.returncode == 1
    assert "sensor-faults is of the code as it is, and says that it is not" in done.stderr
    assert check(copy, "--mark").returncode == 0
    assert block()["text"] == "| new \\1 |\n"

    other = constant[0].replace(constant[2], f"2{constant[2]}")
    meanwhile = f"p = Path({KERNEL!r}); p.write_text(p.read_text().replace({constant[0]!r}, {other!r}, 1))"
    fill(copy, "sensor-faults", "| mixed |\n", meanwhile)
    assert block()["digest"] == "unknown"
    assert block()["text"] == f"{earlier}| mixed |\n"
    fill(copy, "sensor-faults", "| newest |\n")
    assert block()["text"] == "| newest |\n"
    assert check(copy).returncode == 0


def test_a_block_without_sources_is_refused(copy: Path) -> None:
    page = copy / "docs" / "identifiability.md"
    text = page.read_text()
    page.write_text(f"{text}\n<!-- measured: nobody-knows -->\n<!-- end -->\n")
    done = check(copy)
    page.write_text(text)
    assert done.returncode == 1
    assert "docs/measured_sources.py does not say what the block nobody-knows depends on" in done.stderr


# What the text beside a table says of it


def table(docs: ModuleType, page: str, name: str) -> list[dict[str, str]]:
    """Rows of a table by their heads."""
    text = next(one["text"] for one in docs.BLOCK.finditer((ROOT / page).read_text()) if one["name"] == name)
    lines = [line.strip().strip("|").split("|") for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line] for line in lines]
    return [dict(zip(cells[0], row, strict=True)) for row in cells[2:]]


def test_what_is_said_of_the_foams_is_in_the_table(docs: SimpleNamespace) -> None:
    rows = [row for row in table(docs.measured_blocks, "docs/results.md", "reach") if row["File"].startswith("`tue")]
    foams = [row for row in rows if row["Touched"] == "foam"]
    text = " ".join((ROOT / "docs" / "results.md").read_text().split())
    errors, within = ([float(row[name]) for row in foams] for name in ("Error [%]", "Within JND [%]"))
    counts = [sum(error < 10.0 for error in errors), sum(error >= 10.0 for error in errors)]
    words = {2: "two", 3: "three", 5: "five", 6: "six", 11: "eleven"}
    assert f"on {words[counts[0]]} of the foams the error is below 10 %, on {words[counts[1]]} above" in text
    said = f"the force of {words[len(foams)]} measured foams 0.3 s ahead to {np.median(errors):.0f} % in the median"
    assert f"{said} and {max(errors):.0f} % at worst" in text
    assert f"on all but {words[sum(share >= 75.0 for share in within)]} more than a quarter of the samples" in text
    rigid = [float(row["Error [%]"]) for row in rows if row["Touched"] == "rigid"]
    assert f"Of four rigid objects the error is {min(rigid):.0f} to {max(rigid):.0f} %" in text
    by_kind = table(docs.measured_blocks, "docs/results.md", "reach-by-kind")
    assert sum(int(row["Files"]) for row in by_kind) == len(list_datasets()) - 1  # all but the free motion


def test_what_a_hand_would_feel_follows_from_the_errors(docs: SimpleNamespace) -> None:
    felt, rows = docs.measure_results.felt, table(docs.measured_blocks, "docs/results.md", "reach")
    assert [felt(error) for error in (7.0, 7.1, 10.0, 10.1, None)] == ["no", "perhaps", "perhaps", "yes", "–"]
    pressed = [row for row in rows if row["Error [%]"] != "–"]
    assert len(pressed) == 27
    for row in pressed:
        assert row["Felt"] == felt(float(row["Error [%]"])), row["File"]


def test_whether_what_is_asked_is_met_follows_from_the_figures(docs: SimpleNamespace) -> None:
    rows = table(docs.measured_blocks, "docs/results.md", "reach-simulated")
    for row in rows[:-1]:
        asked = [float(word) for word in row["Asked"].split(" / ") if word != "–"]
        middle, worst = (math.inf if row[name] == "never" else float(row[name]) for name in ("Median", "Worst"))
        kept = [middle <= asked[0], worst <= asked[-1]] if asked else []
        met = "not asked" if not kept else "yes" if all(kept) else "in the median" if kept[0] else "no"
        assert row["Met"] == met, row["Beyond the files"]
    assert (rows[-1]["Asked"], rows[-1]["Met"]) == ("at least 19", "yes" if int(rows[-1]["Worst"]) >= 19 else "no")


def test_failures_count_as_worse_than_every_number(docs: SimpleNamespace) -> None:
    middle = docs.measuring.middle
    assert middle([1.0, None, 3.0, 2.0]) == 2.5
    assert middle([1.0, None, None]) is None
    assert middle([1.0, 2.0, None, None]) is None


def test_blocks_of_earlier_code_are_counted_by_page(
    docs: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocks, output = docs.measured_blocks, docs.measured_blocks.EARLIER
    there = [
        blocks.Block(tmp_path, (page, "x"), None, text)
        for page, text in (("a.md", output), ("b.md", "1"), ("a.md", output))
    ]
    monkeypatch.setattr(blocks, "blocks", lambda: iter(there))
    assert blocks.earlier() == "2 measured blocks say that they are of earlier code: a.md 2"
    monkeypatch.setattr(blocks, "problems", lambda sources: iter(()))
    done: list[str] = []
    monkeypatch.setattr("builtins.print", lambda line, **_: done.append(line))
    blocks.main([])
    assert done == ["2 measured blocks say that they are of earlier code: a.md 2"]
    monkeypatch.setattr(blocks, "blocks", lambda: iter(there[1:2]))
    assert blocks.earlier() == ""


def test_where_the_prediction_loses_is_said(docs: SimpleNamespace) -> None:
    rows = table(docs.measured_blocks, "docs/results.md", "sessions")
    worse = {row["Material"] for row in rows if float(row["Prediction error [%]"]) > float(row["Delayed error [%]"])}
    text = (ROOT / "docs" / "results.md").read_text()
    assert worse == {"`bone`"}
    assert "**On bone the prediction is worse than the delayed force**" in text
