"""Which entry points the installed packages have for foretouch."""

from __future__ import annotations

import functools
from dataclasses import dataclass

__all__ = ["GROUPS", "Plugin", "all_plugins", "find_plugin", "plugin_names", "plugins_named"]

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
        kind: Of `GROUPS`.
        name: By which it is asked for.
        target: ``module:attribute``.
        package: That brings it.
        version: Of that package.
    """

    kind: str
    name: str
    target: str
    package: str
    version: str

    @property
    def place(self) -> str:
        """Where it comes from, for people: package, version, group and entry point."""
        return f"{self.package} {self.version}, entry point {self.name} = {self.target!r} of {GROUPS[self.kind]}"

    def import_target(self) -> object:
        """What the entry point names, imported; raises whatever that raises."""
        from importlib.metadata import EntryPoint

        return EntryPoint(self.name, self.target, GROUPS[self.kind]).load()


@functools.cache
def all_plugins() -> tuple[Plugin, ...]:
    """Every entry point of `GROUPS`, by kind and name; the packages are looked through once in a process."""
    from importlib.metadata import entry_points  # costs start-up, and most sessions never come here

    found = []
    for kind, group in GROUPS.items():
        for point in entry_points(group=group):
            package = "an unknown package" if point.dist is None else point.dist.name
            version = "" if point.dist is None else point.dist.version
            found.append(Plugin(kind, point.name, point.value, package, version))
    return tuple(sorted(found, key=lambda one: (list(GROUPS).index(one.kind), one.name, one.package, one.target)))


def plugins_named(kind: str, name: str) -> tuple[Plugin, ...]:
    """Those of a kind that have this name: none, one, or by mistake more.

    Args:
        kind: Of `GROUPS`.
        name: As on the command line.
    """
    return tuple(one for one in all_plugins() if (one.kind, one.name) == (kind, name))


def find_plugin(kind: str, name: str) -> Plugin | None:
    """The first of a kind that has this name; None where there is none.

    Args:
        kind: Of `GROUPS`.
        name: As on the command line.
    """
    return next(iter(plugins_named(kind, name)), None)


def plugin_names(kind: str) -> tuple[str, ...]:
    """Names of all of a kind, each once.

    Args:
        kind: Of `GROUPS`.
    """
    return tuple(dict.fromkeys(one.name for one in all_plugins() if one.kind == kind))
