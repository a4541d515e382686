"""The public interface: what a module exports exists and is described, and its arguments are those it has."""

from __future__ import annotations

import ast
import dataclasses
import functools
import importlib
import inspect
import itertools
import pkgutil
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from docs_pages import ROOT

import foretouch

MODULES = ["foretouch"] + [
    name
    for _, name, _ in pkgutil.walk_packages(foretouch.__path__, "foretouch.")
    if name not in ("foretouch.__main__",)  # importing it runs the command
]
ROOMS = sorted(f"foretouch.{path.parent.name}" for path in (ROOT / "src" / "foretouch").glob("*/__init__.py"))
SECTION = re.compile(r"^(Args|Attributes):\n((?:(?: {4}.*)?\n?)*)", re.MULTILINE)
NAME = re.compile(r"^ {4}(\*{0,2}\w+)(?: \([^)]*\))?:", re.MULTILINE)


@functools.cache
def public_callables() -> dict[str, Any]:
    """Every public function, class and method, once, by its full name."""
    return dict(_callables())


def _callables() -> Iterator[tuple[str, Any]]:
    seen: set[int] = set()
    for name in MODULES:
        module = importlib.import_module(name)
        for value in [value for public, value in vars(module).items() if not public.startswith("_")]:
            if id(value) in seen or not getattr(value, "__module__", "").startswith("foretouch"):
                continue
            seen.add(id(value))
            if inspect.isfunction(value):
                yield f"{value.__module__}.{value.__qualname__}", value
            elif inspect.isclass(value):
                yield f"{value.__module__}.{value.__qualname__}", value
                for attribute, member in vars(value).items():
                    inner = member.__func__ if isinstance(member, classmethod | staticmethod) else member
                    inner = inner.fget if isinstance(inner, property) else inner
                    if not attribute.startswith("_") and inspect.isfunction(inner):
                        yield f"{value.__module__}.{value.__qualname__}.{attribute}", inner


def sections(value: Any) -> dict[str, set[str]]:
    """Names in the sections `Args` and `Attributes` of a docstring."""
    text = inspect.cleandoc(value.__doc__ or "")
    return {title: set(NAME.findall(body)) for title, body in SECTION.findall(text + "\n")}


def parameters(value: Any) -> set[str]:
    """Names of the arguments, stars included, without the instance."""
    names = set()
    for parameter in inspect.signature(value).parameters.values():
        stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
        names.add(stars + parameter.name)
    return names - {"self", "cls"}


@pytest.mark.parametrize("name", MODULES)
def test_what_a_module_exports_is_there(name: str) -> None:
    module = importlib.import_module(name)
    assert (module.__doc__ or "").strip(), "a module says what it is"
    exported = getattr(module, "__all__", [])
    assert not exported or hasattr(module, "__path__"), f"only a door exports, and {name} is none"
    assert [entry for entry in exported if not hasattr(module, entry)] == []
    assert len(exported) == len(set(exported))


def test_every_public_function_class_and_method_is_described() -> None:
    silent = []
    for name, value in public_callables().items():
        text = (value.__doc__ or "").strip()
        if not text or text.startswith(f"{value.__name__}("):  # the text that a dataclass makes of its own signature
            silent.append(name)
    assert silent == []


def test_the_arguments_that_are_described_are_those_that_there_are() -> None:
    wrong = []
    for name, value in public_callables().items():
        described = sections(value).get("Args")
        if described is not None and described != parameters(value):
            wrong.append(f"{name}: {sorted(described ^ parameters(value))}")
    assert wrong == []


def test_the_check_of_arguments_can_fail() -> None:
    def example(depth: float, *rest: float, velocity: float = 0.0, **more: float) -> None:
        """Do nothing.

        Args:
            depth: [m],
                in two lines.
            *rest: More.
            speed: A name that is not there.

        Returns:
            nothing: Nothing.
        """

    assert sections(example)["Args"] == {"depth", "*rest", "speed"}
    assert parameters(example) == {"depth", "*rest", "velocity", "**more"}


def fields(kind: type) -> set[str] | None:
    """Public fields that a record is made from, or None where it is no record."""
    if dataclasses.is_dataclass(kind):
        return {field.name for field in dataclasses.fields(kind) if field.init and not field.name.startswith("_")}
    names = getattr(kind, "_fields", None) or getattr(kind, "__struct_fields__", None)
    return None if names is None else set(names)


def test_every_field_of_a_record_is_described() -> None:
    wrong = []
    exported = {room: importlib.import_module(room) for room in ROOMS}
    records = {f"{room}.{name}": getattr(module, name) for room, module in exported.items() for name in module.__all__}
    for name, value in records.items():
        if not inspect.isclass(value) or (own := fields(value)) is None:
            continue
        described: set[str] = set()
        for kind in value.__mro__:
            if kind.__module__.startswith("foretouch"):
                described |= set().union(*sections(kind).values())
        if own - described:
            wrong.append(f"{name}: {sorted(own - described)}")
    assert wrong == []


def test_every_public_constant_of_a_room_is_described() -> None:
    """A constant has a docstring below it, in the module that makes it."""
    documented: set[str] = set()
    for path in (ROOT / "src" / "foretouch").rglob("*.py"):
        body = ast.parse(path.read_text()).body
        for statement, after in itertools.pairwise(body):
            targets = getattr(statement, "targets", None) or [getattr(statement, "target", None)]
            described = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            documented |= {target.id for target in targets if isinstance(target, ast.Name) and described}
    silent = []
    for room in ROOMS:
        module = importlib.import_module(room)
        for name in module.__all__:
            value = getattr(module, name)
            if name.isupper() and not callable(value) and name not in documented:
                silent.append(f"{room}.{name}")
    assert sorted(set(silent)) == []


def test_the_public_names_come_from_their_rooms() -> None:
    for name in foretouch.__all__:
        if name == "__version__":
            continue
        room = importlib.import_module(f"foretouch.{foretouch._HOME[name]}")
        assert name in room.__all__
        assert getattr(foretouch, name) is getattr(room, name)
        assert f"`{name}`" in (foretouch.__doc__ or ""), f"{name} is not named in the docstring of foretouch"
    assert set(foretouch._HOME) == set(foretouch.__all__) - {"__version__"}
    assert dir(foretouch) == sorted(foretouch.__all__)
    with pytest.raises(AttributeError, match="no attribute 'touch'"):
        _ = foretouch.touch  # type: ignore[attr-defined]


def test_the_pages_of_the_rooms_show_every_public_name() -> None:
    """`docs/_extensions/foretouch_docs.py` writes what `__all__` of a room says; nothing may have no text."""
    sys.path.insert(0, str(ROOT / "docs" / "_extensions"))
    try:
        extension = pytest.importorskip("foretouch_docs", reason="Sphinx is not installed")
    finally:
        sys.path.pop(0)
    for room in ROOMS:
        module = importlib.import_module(room)
        homes = extension._homes(module)
        for name in module.__all__:
            value = getattr(module, name)
            if not callable(value):
                lines = list(extension._data(name, value, homes[name]))
                assert any(line.strip() and not line.strip().startswith((".. ", ":value:")) for line in lines), name


def test_importing_foretouch_imports_nothing_heavy() -> None:
    heavy = ("numpy", "numba", "scipy", "mujoco", "zenoh", "viser", "pyarrow", "matplotlib", "typer", "cv2")
    script = f"import sys, foretouch; print([name for name in {heavy!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=Path.home())
    assert done.stdout.strip() == "[]"
