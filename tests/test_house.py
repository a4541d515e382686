"""The house keeps its rules. Where one fails, move or merge what it names. A number here only falls, but for
a new variant (a law, an estimator, a device), which brings a file and its lines, or a panel or a material, its lines.
"""

from __future__ import annotations

import ast
import copy
import functools
import statistics
from pathlib import Path

import grimp

SOURCE = Path(__file__).resolve().parents[1] / "src" / "foretouch"
FILES, LINES = 475, 91_086
RAISE = "a new law, estimator or device raises FILES and LINES: see the rules in CONTRIBUTING.md"
FLAT, LARGEST, MEDIAN = 12, 400, range(120, 226)
PARAMETERS, LONG_SIGNATURES = 8, 1
COMPILED = ("compiled", "inlined", "kernel")
"""Decorators of compiled functions."""
FIELDS, LARGE_CLASSES = 20, 3
RECORDS = ("sweep.outcome.Outcome", "report.writing.session_report.SessionReport")
"""One row of a table and one JSON object: like a message, each is as large as what it says."""
ONLY_NEIGHBOURS = 0
"""Modules that one neighbour alone imports, beside kernels and these folders, of which each file is one of many:"""
ALTERNATIVES = ("cli.commands", "doctor", "reproduction.figures", "reproduction.questions", "bench.benchmarks")


@functools.cache
def texts() -> dict[str, str]:
    """Source of each module that is not a door, by its name below the package."""
    paths = [path for path in sorted(SOURCE.rglob("*.py")) if path.name != "__init__.py"]
    return {".".join(path.relative_to(SOURCE).with_suffix("").parts): path.read_text() for path in paths}


@functools.cache
def imports() -> grimp.ImportGraph:
    """Who imports whom when it runs, lazily or not."""
    return grimp.build_graph("foretouch", exclude_type_checking_imports=True)


def test_files_are_few_and_of_a_size_to_read() -> None:
    every = sorted(SOURCE.rglob("*.py"))
    lengths = {name: len(text.splitlines()) for name, text in texts().items()}
    lines = sum(len(path.read_text().splitlines()) for path in every)
    assert len(every) <= FILES, RAISE
    assert lines <= LINES, RAISE
    assert int(statistics.median(lengths.values())) in MEDIAN
    assert {name: length for name, length in lengths.items() if length > LARGEST} == {}


def test_a_folder_holds_a_dozen_and_says_its_rule() -> None:
    for door in SOURCE.rglob("__init__.py"):
        flat = [path for path in door.parent.glob("*.py") if path.name != "__init__.py"]
        assert len(flat) <= FLAT, f"{door.parent}: put what belongs together into a folder"
        output = ast.get_docstring(ast.parse(door.read_text())) or ""
        assert output.partition("\n\n")[0].rstrip().endswith("."), f"{door}: say in one sentence what belongs here"


def test_no_file_and_no_folder_imports_one_that_imports_it() -> None:
    folders = copy.deepcopy(imports())
    for door in SOURCE.glob("*/*/__init__.py"):
        folders.squash_module(".".join(("foretouch", *door.parent.relative_to(SOURCE).parts)))
    for graph in (imports(), folders):
        circles = []
        for module in graph.modules:
            above = graph.find_downstream_modules(module)
            circles += [(module, below) for below in graph.find_modules_directly_imported_by(module) if below in above]
        assert circles == [], "move what both need into one of them, or below both"


def test_what_one_neighbour_alone_imports_is_part_of_it() -> None:
    alone = []
    for name, text in texts().items():
        importers = imports().find_modules_that_directly_import(f"foretouch.{name}")
        room = name.rpartition(".")[0]
        kernel = any(f"@{decorator}" in text for decorator in COMPILED)
        if len(importers) == 1 and not kernel and room not in ALTERNATIVES:
            (importer,) = importers
            alone += [name] if importer.rpartition(".")[0] == f"foretouch.{room}" else []
    assert len(alone) <= ONLY_NEIGHBOURS, alone


def sizes() -> tuple[dict[str, int], dict[str, int]]:
    """How many parameters each function takes that is not compiled, and how many fields each class lists."""
    functions, classes = {}, {}
    for name, text in texts().items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ClassDef):
                classes[f"{name}.{node.name}"] = sum(isinstance(one, ast.AnnAssign) for one in node.body)
            elif isinstance(node, ast.FunctionDef):
                every = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
                compiled = any(ast.unparse(one).startswith(COMPILED) for one in node.decorator_list)
                functions[f"{name}.{node.name}"] = 0 if compiled else len({one.arg for one in every} - {"self", "cls"})
    return functions, classes


def test_signatures_and_classes_are_small() -> None:
    functions, classes = sizes()
    long = [name for name, count in functions.items() if count > PARAMETERS]
    classes = {name: count for name, count in classes.items() if name not in RECORDS}
    large = [name for name, count in classes.items() if count > FIELDS and not name.startswith("messages.")]
    assert len(long) <= LONG_SIGNATURES, long
    assert len(large) <= LARGE_CLASSES, large
