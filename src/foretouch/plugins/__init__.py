"""What other packages bring: robots, devices, materials and estimators, by entry points.

A package names what it brings in its own ``pyproject.toml``; nothing is imported, and no package looked through, before
a name is asked for that is not built in.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Self, TypeVar

from foretouch.errors import ForetouchError, InputError, SettingError
from foretouch.errors.checks import require

__all__ = [
    "GROUPS",
    "Address",
    "Plugin",
    "PluginError",
    "all_plugins",
    "load_plugin",
    "make_plugin",
    "named_at",
    "plugin_names",
    "plugins_named",
    "problem_of",
]

GROUPS = {
    "robot": "foretouch.robots",
    "device": "foretouch.devices",
    "material": "foretouch.materials",
    "estimator": "foretouch.estimators",
}
"""Entry-point group of each kind of plug-in."""


@dataclass(frozen=True, slots=True)
class Plugin:
    """One entry point; nothing of it has been imported.

    Attributes:
        kind: One of `GROUPS`.
        name: Name by which it is asked for.
        target: ``module:attribute``.
        package: Package that brings it.
        version: Version of that package.
    """

    kind: str
    name: str
    target: str
    package: str
    version: str

    @property
    def place(self) -> str:
        """Origin of the plugin, for people: package, version, group and entry point."""
        return f"{self.package} {self.version}, entry point {self.name} = {self.target!r} of {GROUPS[self.kind]}"

    def import_target(self) -> object:
        """What the entry point names, imported; raises whatever that raises."""
        from importlib.metadata import EntryPoint

        return EntryPoint(self.name, self.target, GROUPS[self.kind]).load()


@functools.cache
def all_plugins() -> tuple[Plugin, ...]:
    """Every entry point of `GROUPS`, by kind and name; the packages are looked through once in a process."""
    from importlib.metadata import entry_points  # costs start-up, and most sessions never come here

    results = []
    for kind, group in GROUPS.items():
        for point in entry_points(group=group):
            package = "an unknown package" if point.dist is None else point.dist.name
            version = "" if point.dist is None else point.dist.version
            results.append(Plugin(kind, point.name, point.value, package, version))
    return tuple(sorted(results, key=lambda one: (list(GROUPS).index(one.kind), one.name, one.package, one.target)))


def plugins_named(kind: str, name: str) -> tuple[Plugin, ...]:
    """Those of a kind that have this name: none, one, or by mistake more.

    Args:
        kind: One of `GROUPS`.
        name: As on the command line, also with an address: ``NAME@ADDRESS``.
    """
    own, _ = named_at(name)
    return tuple(one for one in all_plugins() if (one.kind, one.name) == (kind, own))


def named_at(name: str) -> tuple[str, str]:
    """A plug-in's name and the address behind it, from ``NAME@ADDRESS``; without one, the address is empty."""
    own, _, address = name.partition("@")
    return own, address


@dataclass(frozen=True)
class Address:
    """What stands behind the name of a plug-in in a setting, ``NAME@PLACE,KEY=VALUE,...``.

    Attributes:
        setting: Name of the setting.
        text: As given.
        place: Where the machine is; "" where that is not said.
        options: All options by name.
    """

    setting: str
    text: str
    place: str
    options: Mapping[str, str]

    @classmethod
    def read(cls, setting: str, text: str, usual: Mapping[str, str], place: str = "PLACE") -> Self:
        """The address in a setting.

        Args:
            setting: Name of the setting.
            text: Its value, each part of which may be missing.
            usual: All options with their usual values.
            place: What the place is, for people.

        Raises:
            SettingError: A key that is none, or is there twice.
        """
        found, options = "", dict[str, str]()
        name, rest = named_at(text)
        for part in filter(None, rest.split(",")):
            key, sign, value = part.partition("=")
            if not sign and not found:
                found = part
            elif not sign or key not in usual or key in options:
                rule = f"write it as {name}@{place},KEY=VALUE,..., each KEY once, of {', '.join(usual)}"
                raise SettingError(setting, text, f"{part!r} is not understood: {rule}")
            else:
                options[key] = value
        return cls(setting, text, found, {**usual, **options})

    def refuse(self, rule: str) -> SettingError:
        """The error of this setting that says a rule which it breaks."""
        return SettingError(self.setting, self.text, rule)

    def number(self, key: str, **bounds: float) -> float:
        """The number in an option.

        Args:
            key: Name of the option.
            **bounds: As of `foretouch.errors.checks.require`.

        Raises:
            SettingError: It is none, or out of bounds.
        """
        try:
            number = float(self.options[key])
        except ValueError:
            raise self.refuse(f"{key} must be a number, and is {self.options[key]!r}") from None
        require(f"{key} of {self.setting} {self.text!r}", number, **bounds)
        return number


def plugin_names(kind: str) -> tuple[str, ...]:
    """Names of all of a kind, each once.

    Args:
        kind: One of `GROUPS`.
    """
    return tuple(dict.fromkeys(one.name for one in all_plugins() if one.kind == kind))


Made = TypeVar("Made")

CONNECT = "connect the {} and switch it on, and see that you have the right to open it"
"""Advice where a factory could not open something of the system."""


class PluginError(InputError):
    """Something of another package cannot be used.

    Args:
        plugin: The entry point.
        problem: What is wrong with it.
        remedy: What to do; without one, to mend the package or to uninstall it.
    """

    def __init__(self, plugin: Plugin, problem: str, remedy: str = "") -> None:
        remedy = remedy or f"mend {plugin.package} or uninstall it"
        super().__init__(f"{plugin.kind} {plugin.name!r} ({plugin.place}): {problem}; {remedy}")
        self.plugin = plugin
        self.problem = problem


def load_plugin(kind: str, name: str, *, built_in: Collection[str] = ()) -> tuple[Plugin, Callable[..., object]] | None:
    """What the entry point names, imported; None where no package has this name.

    Args:
        kind: One of `foretouch.plugins.GROUPS`.
        name: As on the command line.
        built_in: Names that no package may take.

    Raises:
        PluginError: It is there twice, takes a built-in name, raises at import, or is nothing that could be called.
    """
    named = plugins_named(kind, name)
    if not named:
        return None
    first = named[0]
    if name in built_in:
        raise PluginError(first, f"the name is that of a built-in {kind}", f"ask {first.package} for another name")
    if len(named) > 1:
        others = " and ".join(f"{one.package} {one.version} ({one.target})" for one in named)
        raise PluginError(first, f"the name is there {len(named)} times: {others}", "uninstall all but one of them")
    try:
        target = first.import_target()
    except (Exception, SystemExit) as error:
        raise PluginError(first, f"raises {_said(error)} at import") from error
    if not callable(target):
        raise PluginError(first, f"is {_kind_of(target)} and not something to call")
    return first, target


def make_plugin(
    kind: str,
    name: str,
    expected: type[Made] | tuple[type[Made], ...],
    *arguments: object,
    built_in: Collection[str] = (),
) -> Made | None:
    """What a package's factory makes; None where no package has this name.

    An error that is foretouch's own passes as it is: its line says what the factory misses.

    Args:
        kind: One of `foretouch.plugins.GROUPS`.
        name: As on the command line.
        expected: Class that it must be of, or classes, one of which.
        *arguments: For the factory.
        built_in: Names that no package may take.

    Raises:
        PluginError: As `load_plugin`, and where the factory raises or makes something else.
    """
    loaded = load_plugin(kind, name, built_in=built_in)
    if loaded is None:
        return None
    plugin, factory = loaded
    try:
        made = factory(*arguments)
    except ForetouchError:
        raise
    except (Exception, SystemExit) as error:
        remedy = CONNECT.format(kind) if isinstance(error, OSError) else ""
        raise PluginError(plugin, f"raises {_said(error)} where one is to be made", remedy) from error
    if not isinstance(made, expected):
        wanted = " or ".join(one.__name__ for one in (expected if isinstance(expected, tuple) else (expected,)))
        raise PluginError(plugin, f"makes {_kind_of(made)} and not a {wanted}")
    return made


def problem_of(plugin: Plugin, *, built_in: Collection[str] = ()) -> str:
    """What is wrong with an entry point, as far as an import shows it; empty where nothing is.

    Args:
        plugin: One of `foretouch.plugins.all_plugins`.
        built_in: Names that no package may take.
    """
    try:
        load_plugin(plugin.kind, plugin.name, built_in=built_in)
    except PluginError as error:
        return error.problem
    return ""


def _said(error: BaseException) -> str:
    """An exception in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _kind_of(value: object) -> str:
    """A value's class for people; a class itself by its name."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    name = type(value).__name__
    return f"an {name}" if name[0].lower() in "aeiou" else f"a {name}"
