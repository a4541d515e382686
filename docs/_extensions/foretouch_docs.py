"""Directives that take their content from the package itself, so that the pages cannot drift from it.

- `room`: what one room may import, its folders, and its public names (its `__all__`), each with its docstring.
- `quantities`: the table of `foretouch.quantities.QUANTITIES`.
- `statuses`: the values of `status` that scoring can give; `robot-statuses`: those of a follower.
- `channels`: the channels of a session.
- `commands`: the help of every `foretouch` command.
- `layers`: the rooms and their order, from pyproject.toml.
- `figures`: every figure, with the text of the page that shows it.
- `examples`: the programs of the folder examples, each with its first line.
- `licences`: every package of the lock with its licence, from docs/list_licences.py.
- `public-names`: what `import foretouch` gives, and the room of each name.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import re
import runpy
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import get_origin

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[2]
FIGURE = re.compile(
    r"\{(?:image|figure)\} (?:\.\./)?images/(?P<name>\S+\.png)\n:alt: (?P<text>.+)"
    r"|!\[(?P<inline_text>[^]]+)\]\((?:\.\./)?images/(?P<inline_name>\S+\.png)\)"
)


class Generated(SphinxDirective):
    """A directive that writes reStructuredText; use it inside `eval-rst`."""

    required_arguments = 0

    def run(self) -> list[nodes.Node]:
        """Parse what `lines` gives."""
        self.env.note_dependency(__file__)
        return self.parse_text_to_nodes("\n".join(self.lines()), allow_section_headings=True)

    def lines(self) -> Iterator[str]:
        """The text, line by line."""
        raise NotImplementedError


class Room(Generated):
    """What a room may import, its folders, and its public names."""

    required_arguments = 1

    def lines(self) -> Iterator[str]:
        room = self.arguments[0]
        module = importlib.import_module(room)
        homes = _homes(module)
        yield from (*_imports(room.removeprefix("foretouch.")), "", *_folders(room), "", f".. py:module:: {room}", "")
        for name in sorted(module.__all__, key=lambda name: (_kind(getattr(module, name)), name.lower())):
            value = getattr(module, name)
            if get_origin(value) is not None:  # the name of a type of arrays
                yield from _data(name, value, homes[name])
            elif inspect.isclass(value):
                ours = any(base.__module__.startswith("foretouch.") for base in value.__bases__)
                yield from (
                    f".. autoclass:: {room}.{name}",
                    "   :members:",
                    "   :show-inheritance:" if ours else "",
                    "",
                )
            elif callable(value) and hasattr(value, "__doc__") and hasattr(value, "__module__"):
                yield from (f".. autofunction:: {room}.{name}", "")
            else:
                yield from _data(name, value, homes[name])


class Quantities(Generated):
    """The table of quantities."""

    def lines(self) -> Iterator[str]:
        from foretouch.quantities import QUANTITIES

        yield from (".. list-table::", "   :header-rows: 1", "   :widths: 20 10 20 50", "")
        yield from ("   * - Name", "     - Symbol", "     - Unit", "     - Meaning")
        for quantity in QUANTITIES:
            yield f"   * - ``{quantity.name}``"
            yield f"     - {quantity.symbol}"
            yield f"     - {quantity.unit}"
            yield f"     - {quantity.meaning}"


class Statuses(Generated):
    """What the status of scores can be."""

    def lines(self) -> Iterator[str]:
        from foretouch.report import STATUSES

        for name, meaning in STATUSES.items():
            yield from (f"``{name}``", f"   {meaning[0].upper()}{meaning[1:]}.", "")


class RobotStatuses(Generated):
    """What a follower does with the commands."""

    def lines(self) -> Iterator[str]:
        from foretouch.messages import STATUS_SENTENCES

        for status, sentence in STATUS_SENTENCES.items():
            yield from (f"``{status.name}``", f"   The robot {sentence}.", "")


class Channels(Generated):
    """Every channel: its message, who sends it, and how often."""

    def lines(self) -> Iterator[str]:
        from foretouch.messages import CHANNELS

        yield from (".. list-table::", "   :header-rows: 1", "   :widths: 15 50 15 20", "")
        yield from ("   * - Channel", "     - Message", "     - From", "     - A second")
        for channel in CHANNELS.values():
            meaning = (inspect.getdoc(channel.kind) or "").splitlines()[0]
            yield f"   * - ``{channel.name}``"
            yield f"     - ``{channel.kind.__name__}``: {meaning}"
            yield f"     - {channel.sender}"
            yield f"     - {f'{channel.rate:g}' if channel.rate else 'on an event'}"


class Commands(Generated):
    """The help of every command."""

    def lines(self) -> Iterator[str]:
        import typer.main
        from typer.testing import CliRunner

        from foretouch.cli.app import app

        os.environ["COLUMNS"] = "100"
        os.environ["TERMINAL_WIDTH"] = "100"
        group = typer.main.get_command(app)
        for words in _command_names(group):
            text = CliRunner().invoke(app, [*words, "--help"]).output
            title = f"``foretouch {' '.join(words)}``"
            yield from (title, "-" * len(title), "", ".. code-block:: text", "")
            yield from (f"   {line}" for line in text.splitlines())
            yield ""


class Layers(Generated):
    """The rooms, highest first."""

    def lines(self) -> Iterator[str]:
        yield from ("::", "")
        yield from (f"   {'  |  '.join(layer)}" for layer in _layers())


class Examples(Generated):
    """The example programs."""

    def lines(self) -> Iterator[str]:
        for path in sorted((ROOT / "examples").glob("*.py")):
            first = (ast.get_docstring(ast.parse(path.read_text())) or "").split("\n")[0]
            yield f"- ``{path.name}``: {first}"


class Figures(Generated):
    """Every figure, with the text of the page that shows it."""

    def lines(self) -> Iterator[str]:
        for name, (page, text) in shown_figures(ROOT / "docs").items():
            yield from (f".. figure:: /images/{name}", f"   :alt: {text}", "", f"   {text}: :doc:`/{page}`", "")


class Licences(Generated):
    """The packages of the lock and their licences."""

    def lines(self) -> Iterator[str]:
        self.env.note_dependency(str(ROOT / "requirements.lock"))
        listed = runpy.run_path(str(ROOT / "docs" / "list_licences.py"))["rows"]()
        yield from (".. list-table::", "   :header-rows: 1", "")
        for name, version, licence, by in [("Package", "Version", "Licence", "Brought by"), *listed]:
            yield from (f"   * - {name}", f"     - {version}", f"     - {licence}", f"     - {by}")


class PublicNames(Generated):
    """What `import foretouch` gives."""

    def lines(self) -> Iterator[str]:
        import foretouch

        yield from (".. list-table::", "   :header-rows: 1", "", "   * - Name", "     - Room", "     - What it is")
        for name in sorted(foretouch.__all__, key=str.lower):
            value = getattr(foretouch, name)
            room = foretouch._HOME.get(name)
            link = f":py:obj:`~foretouch.{room}.{name}`" if room else f"``{name}``"
            text = inspect.getdoc(value) if room else "The version."
            yield from (f"   * - {link}", f"     - {room or ''}", f"     - {(text or '').splitlines()[0]}")


def shown_figures(folder: Path) -> dict[str, tuple[str, str]]:
    """By the file's name, the first page that shows a figure and the text that it has there."""
    found: dict[str, tuple[str, str]] = {}
    for page in sorted([*folder.glob("*.md"), *folder.glob("rooms/*.md")]):
        for one in FIGURE.finditer(page.read_text()):
            name, text = one["name"] or one["inline_name"], one["text"] or one["inline_text"]
            found.setdefault(name, (str(page.relative_to(folder).with_suffix("")), text.strip()))
    return dict(sorted(found.items()))


def _imports(room: str) -> Iterator[str]:
    """Which rooms a room may import, and which not."""
    layers = _layers()
    height = next(index for index, layer in enumerate(layers) if room in layer)
    below = [f"``{name}``" for layer in layers[height + 1 :] for name in layer]
    other = [f"``{name}``" for layer in layers[: height + 1] for name in layer if name != room]
    yield f"| **May import** {', '.join(below) or 'nothing of foretouch'}."
    if other:
        yield f"| **Must not import** {', '.join(other)}."


def _folders(room: str) -> Iterator[str]:
    """What belongs in each folder of a room, by the docstring of its package; imports go down this list, too."""
    names = [name for layer in _layers(room) for name in layer]
    paths = (ROOT / "src").joinpath(*room.split(".")).glob("*/__init__.py")
    for path in sorted(paths, key=lambda path: names.index(path.parent.name) if names else path):
        text = ast.get_docstring(ast.parse(path.read_text())) or ""
        yield f"- ``{path.parent.name}/``: {text.splitlines()[0]}"


def _layers(container: str = "foretouch") -> list[list[str]]:
    """The rooms of the package, or the folders of a room, by layer, highest first; none where no rule holds them."""
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next((rule["layers"] for rule in rules if rule["containers"] == [container]), [])
    return [[name.strip() for name in layer.split("|")] for layer in layers]


def _command_names(group: object, before: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for name, command in group.commands.items():  # type: ignore[attr-defined]
        if hasattr(command, "commands"):
            yield from _command_names(command, (*before, name))
        else:
            yield (*before, name)


def _kind(value: object) -> int:
    """Classes first, then functions, then data."""
    return 0 if inspect.isclass(value) else 1 if callable(value) else 2


def _homes(module: object) -> dict[str, str]:
    """The module that each name of a room comes from."""
    tree = ast.parse(inspect.getsource(module))  # type: ignore[arg-type]
    homes: dict[str, str] = {}
    for statement in tree.body:
        if isinstance(statement, ast.ImportFrom) and statement.module:
            homes |= {alias.asname or alias.name: statement.module for alias in statement.names}
    return {name: homes.get(name, module.__name__) for name in module.__all__}  # type: ignore[attr-defined]


def _data(name: str, value: object, home: str) -> Iterator[str]:
    """A constant with the docstring below it in its own module."""
    while True:  # a room may hand on what an inner package hands on
        documented = ModuleAnalyzer.for_module(home)
        documented.analyze()
        text = documented.attr_docs.get(("", name))
        inner = _homes_or_nothing(home).get(name)
        if text is not None or inner in (None, home):
            break
        home = inner
    yield f".. py:data:: {name}"
    shown = repr(value)
    if isinstance(value, int | float | str | tuple) and len(shown) < 70:
        yield f"   :value: {shown}"
    yield ""
    yield from (f"   {line}" for line in text or ())
    yield ""


def _homes_or_nothing(home: str) -> dict[str, str]:
    module = importlib.import_module(home)
    return _homes(module) if hasattr(module, "__path__") else {}


def skip_plain_fields(app: Sphinx, what: str, name: str, member: object, skip: bool, options: object) -> bool | None:
    """Leave out what the class docstring already says: the fields of named tuples and of structs."""
    if type(member).__name__ in ("_tuplegetter", "member_descriptor"):
        return True
    return None


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    directives = {
        "room": Room,
        "quantities": Quantities,
        "statuses": Statuses,
        "robot-statuses": RobotStatuses,
        "channels": Channels,
        "commands": Commands,
        "layers": Layers,
        "examples": Examples,
        "figures": Figures,
        "licences": Licences,
        "public-names": PublicNames,
    }
    for name, directive in directives.items():
        app.add_directive(name, directive)
    app.connect("autodoc-skip-member", skip_plain_fields)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
