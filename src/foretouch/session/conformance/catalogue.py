"""All robots, devices, materials and estimators available, and their checks by name.

A check whose calls do not return is abandoned, and reported.
"""

from __future__ import annotations

import functools
import queue
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from types import FrameType

from foretouch.devices import HARDWARE_OPERATORS, OPERATORS, UNKNOWN_REACH
from foretouch.errors import SettingError, UnknownNameError
from foretouch.identification import BUILT_IN_ESTIMATORS, ESTIMATORS, all_estimators, load_estimator, make_estimator
from foretouch.plugins import (
    GROUPS,
    PluginError,
    all_plugins,
    load_plugin,
    named_at,
    plugin_names,
    plugins_named,
    problem_of,
)
from foretouch.robot import DEFAULT_MATERIAL, MATERIALS, make_material
from foretouch.session.conformance.device_checks import check_device
from foretouch.session.conformance.estimator_checks import check_estimator
from foretouch.session.conformance.finding import Finding
from foretouch.session.conformance.material_checks import check_material
from foretouch.session.conformance.robot_checks import check_robot
from foretouch.session.operators import make_operator
from foretouch.session.runners.news import where
from foretouch.session.settings import ROBOTS, SessionSettings
from foretouch.session.setup import make_session_robot

LONGEST_ANSWER = 5.0  # Time without return after which a call of a device or robot counts as hanging [s]
LONGEST_MAKING = 30.0
"""The same time for the call that makes a device or robot, which may have to find its home position [s]."""
LONGEST_CHECK = 60.0  # Longest duration of one check of a device or robot whose calls are not visible in Python [s]
LOOK_PERIOD = 0.1  # Time between two checks of a running call [s]
ROOM = __name__.rpartition(".")[0]


def watched(
    check: Callable[[Callable[[Finding], None]], object],
    tell: Callable[[Finding], None],
    *,
    longest: float = LONGEST_ANSWER,
    making: float = LONGEST_MAKING,
) -> None:
    """Run a check on a separate thread, which is abandoned when a call of what is checked does not return.

    The whole check runs on one thread, for some drivers must be called by the thread that made them.

    Args:
        check: Called with the function that takes its findings; what it raises is raised here.
        tell: Called with each finding on the calling thread as soon as it is known; the last is of the hanging call.
        longest: Longest duration of a call [s].
        making: Longest duration of the first one, before there is any finding [s].
    """
    results: queue.SimpleQueue[Finding | BaseException | None] = queue.SimpleQueue()

    def work() -> None:
        try:
            check(results.put)
        except BaseException as error:  # re-raised in the calling thread
            results.put(error)
        else:
            results.put(None)

    thread = threading.Thread(target=work, name="check", daemon=True)
    thread.start()
    calls, limit = _Calls(thread), making
    while True:
        try:
            result = results.get(timeout=LOOK_PERIOD)
        except queue.Empty:
            if hung := calls.hung(limit):
                tell(Finding("answers", False, hung, "every call comes back; a driver that waits has a timeout"))
                return
            continue
        if result is None:
            return
        if isinstance(result, BaseException):
            raise result
        limit = longest
        calls.begin()
        tell(result)


class _Calls:
    """Measures how long a thread has been in one call of what is checked."""

    def __init__(self, thread: threading.Thread) -> None:
        self._thread = thread
        self._call: FrameType | None = None  # held, so that no other call can be mistaken for it
        self._since = time.monotonic()

    def begin(self) -> None:
        """Start timing now."""
        self._call, self._since = None, time.monotonic()

    def hung(self, longest: float) -> str:
        """Description of a call that has lasted longer than this [s]; empty where none has."""
        frame = sys._current_frames().get(self._thread.ident or 0)
        call = _call(frame)
        if call is not self._call:
            self._call, self._since = call, time.monotonic()
        if call is None:  # in the check itself, or in a call not visible in Python: which of them is unknown
            longest = max(longest, LONGEST_CHECK)
        if frame is None or time.monotonic() - self._since < longest:
            return ""
        return f"a call has not come back for {longest:g} s, {where(frame)}"


def _call(frame: FrameType | None) -> FrameType | None:
    """The call that a check is in, None if in none: the outermost frame within the innermost of a check."""
    inner = None
    while frame is not None and not str(frame.f_globals.get("__name__", "")).startswith(ROOM):
        inner, frame = frame, frame.f_back
    return inner


BUILT_IN: dict[str, tuple[str, ...]] = {
    "robot": ROBOTS,
    "device": (*OPERATORS, *HARDWARE_OPERATORS),
    "material": tuple(MATERIALS),
    "estimator": tuple(sorted(BUILT_IN_ESTIMATORS)),
}
"""Names of this package by kind; no other package may take one."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One robot, device, material or estimator.

    Attributes:
        kind: Key of `foretouch.plugins.GROUPS`.
        name: Name as on the command line.
        package: Package that provides it.
        version: Version of that package.
        target: ``module:attribute``; empty for those of foretouch.
        laws: Laws that an estimator learns.
        problem: What is wrong with it; empty where nothing is.
    """

    kind: str
    name: str
    package: str
    version: str
    target: str = ""
    laws: tuple[str, ...] = ()
    problem: str = ""


def catalogue() -> list[Entry]:
    """All entries, those of foretouch first; other packages' are imported to see whether they can be."""
    own = version("foretouch")
    entries = [
        Entry(kind, name, "foretouch", own, laws=tuple(law for law, kinds in ESTIMATORS.items() if name in kinds))
        for kind, names in BUILT_IN.items()
        for name in names
    ]
    for plugin in all_plugins():
        problem = problem_of(plugin, built_in=BUILT_IN[plugin.kind])
        laws: tuple[str, ...] = ()
        if plugin.kind == "estimator" and not problem:
            try:
                kind = load_estimator(plugin.name)
                laws = () if kind is None else (kind.model_name,)
            except PluginError as error:
                problem = error.problem
        entries.append(Entry(plugin.kind, plugin.name, plugin.package, plugin.version, plugin.target, laws, problem))
    return entries


def check_named(
    name: str, *, kind: str = "", move: bool = False, tell: Callable[[str, Finding], None] = lambda of, finding: None
) -> dict[str, list[Finding]]:
    """Run the conformance checks of the entry with this name.

    A device or robot that no longer returns is abandoned after some seconds; the last finding then reports it.

    Args:
        name: Name as on the command line.
        kind: Key of `foretouch.plugins.GROUPS`; empty where only one kind has the name.
        move: Whether a real robot may be moved.
        tell: Called with each finding and its title as soon as it is known.

    Returns:
        Findings by title: the kind and the name; for an estimator of several laws, one title each.

    Raises:
        UnknownNameError: Nothing has this name.
        SettingError: More than one kind has this name.
        PluginError: It is from another package and cannot be used.
        ForetouchError: It cannot be made here, for the reason in its message.
    """
    if kind and kind not in GROUPS:
        raise UnknownNameError("group", kind, GROUPS)
    kinds = [one for one in ((kind,) if kind else GROUPS) if name in BUILT_IN[one] or plugins_named(one, name)]
    if not kinds:
        one = kind or "robot, device, material or estimator"
        raise UnknownNameError(one, name, {known for of in ((kind,) if kind else GROUPS) for known in _names(of)})
    if len(kinds) > 1:
        raise SettingError("name", name, f"is a {' and a '.join(kinds)}: say which with --group")
    of = kinds[0]
    load_plugin(of, name, built_in=BUILT_IN[of])  # a name that is taken twice is nobody's
    findings: dict[str, list[Finding]] = {}
    for title, check in _checks(of, name, move).items():
        results = findings[title] = []

        def hear(finding: Finding, title: str = title, results: list[Finding] = results) -> None:
            results.append(finding)
            tell(title, finding)

        if of in ("robot", "device"):
            watched(check, hear)
        else:
            check(hear)
    return findings


def _names(kind: str) -> tuple[str, ...]:
    return (*BUILT_IN[kind], *plugin_names(kind))


Check = Callable[[Callable[[Finding], None]], object]


def _checks(kind: str, name: str, move: bool) -> dict[str, Check]:
    """By title, what checks an entry and passes its findings on."""
    title = f"{kind} {name}"
    if kind == "robot":
        settings = SessionSettings(robot=name)
        return {title: lambda tell: check_robot(lambda: make_session_robot(settings)[0], move=move, tell=tell)}
    if kind == "material":
        return {title: lambda tell: check_material(lambda: make_material(name), name=name, tell=tell)}
    if kind == "estimator":
        load_estimator(name)
        laws = [law for law, kinds in all_estimators().items() if name in kinds]
        return {f"{title} of {law}": functools.partial(_check_estimator, law, name) for law in laws}
    settings, material = SessionSettings(operator=name), make_material(DEFAULT_MATERIAL)
    surface, depth = UNKNOWN_REACH if name in HARDWARE_OPERATORS else (material.surface, material.press_depth)
    make = functools.partial(make_operator, settings, surface=surface, press_depth=depth, say=lambda line: None)
    return {title: lambda tell: check_device(make, name=named_at(name)[0], tell=tell)}


def _check_estimator(law: str, name: str, tell: Callable[[Finding], None]) -> None:
    check_estimator(functools.partial(make_estimator, law, name), name=name, tell=tell)
