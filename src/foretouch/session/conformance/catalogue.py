"""All robots, devices, materials and estimators that there are, and their checks by name.

A check whose calls do not come back is left alone, and told of.
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

from foretouch.devices import HARDWARE_OPERATORS, OPERATORS, UNKNOWN_REACH, Device
from foretouch.errors import SettingError, UnknownNameError
from foretouch.identification import BUILT_IN_ESTIMATORS, ESTIMATORS, all_estimators, load_estimator, make_estimator
from foretouch.plugins import GROUPS, PluginError, all_plugins, load_plugin, plugin_names, plugins_named, problem_of
from foretouch.robot import DEFAULT_MATERIAL, MATERIALS, make_material
from foretouch.session.conformance.device_checks import check_device
from foretouch.session.conformance.estimator_checks import check_estimator
from foretouch.session.conformance.finding import Finding, told
from foretouch.session.conformance.material_checks import check_material
from foretouch.session.conformance.robot_checks import check_robot
from foretouch.session.operators import make_operator
from foretouch.session.processes.news import where
from foretouch.session.robots import make_session_robot
from foretouch.session.settings import ROBOTS, SessionSettings

LONGEST_ANSWER = 5.0
"""A call of a device or robot that has not come back for so long [s] hangs ..."""
LONGEST_MAKING = 30.0
"""... and one that makes it, which may have to find its way home, for so long [s]."""
LONGEST_CHECK = 60.0
"""One check of those that have nothing of Python to be seen in lasts at most so long [s]."""
LOOK_PERIOD = 0.1
"""Between two looks at it [s]."""
ROOM = __name__.rpartition(".")[0]


def watched(
    check: Callable[[Callable[[Finding], None]], object],
    tell: Callable[[Finding], None],
    *,
    longest: float = LONGEST_ANSWER,
    making: float = LONGEST_MAKING,
) -> None:
    """Run a check on a thread of its own, which is left where it is when a call of what is checked does not come back.

    All of it is on one thread, for there are drivers that want to be called by the one that made them.

    Args:
        check: Given whom it tells its findings.
        tell: Told each finding on the calling thread as soon as it is known; the last is of the call that hangs.
        longest: That a call may take [s].
        making: That the first one may take, before there is any finding [s].

    Raises:
        Exception: Whatever the check raises.
    """
    found: queue.SimpleQueue[Finding | BaseException | None] = queue.SimpleQueue()

    def work() -> None:
        try:
            check(found.put)
        except BaseException as error:  # it is raised where it was asked for
            found.put(error)
        else:
            found.put(None)

    thread = threading.Thread(target=work, name="check", daemon=True)
    thread.start()
    calls, limit = _Calls(thread), making
    while True:
        try:
            said = found.get(timeout=LOOK_PERIOD)
        except queue.Empty:
            if hung := calls.hung(limit):
                tell(Finding("answers", False, hung, "every call comes back; a driver that waits has a timeout"))
                return
            continue
        if said is None:
            return
        if isinstance(said, BaseException):
            raise said
        limit = longest
        calls.begin()
        tell(said)


class _Calls:
    """Looks at how long a thread has been in one call of what is checked.

    Args:
        thread: That checks.
    """

    def __init__(self, thread: threading.Thread) -> None:
        self._thread = thread
        self._call: FrameType | None = None  # held, so that no other call can be taken for it
        self._since = time.monotonic()

    def begin(self) -> None:
        """Count from now on."""
        self._call, self._since = None, time.monotonic()

    def hung(self, longest: float) -> str:
        """What is to be said where a call has lasted for longer than this [s]; empty where none has."""
        frame = sys._current_frames().get(self._thread.ident or 0)
        call = _call(frame)
        if call is not self._call:
            self._call, self._since = call, time.monotonic()
        if call is None:  # in the check itself, or in a call that is not of Python: which of them, nobody can tell
            longest = max(longest, LONGEST_CHECK)
        if frame is None or time.monotonic() - self._since < longest:
            return ""
        return f"a call has not come back for {longest:g} s, {where(frame)}"


def _call(frame: FrameType | None) -> FrameType | None:
    """The call that a check makes, None where it makes none: the outermost frame within the innermost of a check."""
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
"""Names of the package by kind; no other may take one."""


Tell = Callable[[str, Finding], None]
"""Is told a title and a finding."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One robot, device, material or estimator.

    Attributes:
        kind: Of `foretouch.plugins.GROUPS`.
        name: As on the command line.
        package: That it is of.
        version: Of that package.
        target: ``module:attribute``; empty for those of foretouch.
        laws: That it learns, of an estimator.
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
    """All that there are, those of foretouch first; what other packages bring is imported to see whether it can be."""
    own = version("foretouch")
    entries = [
        Entry(kind, name, "foretouch", own, laws=_laws(name) if kind == "estimator" else ())
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
    """The conformance checks of what has this name.

    A device or robot that does not answer any more is left alone after some seconds; the last finding is then of that.

    Args:
        name: As on the command line.
        kind: Of `foretouch.plugins.GROUPS`; empty where the name is of one kind alone.
        move: Whether a real robot may be moved.
        tell: Told each finding, with its title, as soon as it is known.

    Returns:
        Findings by title: the kind and the name; of an estimator for several laws, one for each.

    Raises:
        UnknownNameError: Nothing has this name.
        SettingError: More than one kind has it.
        PluginError: It is another package's and cannot be used.
        ForetouchError: It cannot be made here, for what it says.
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
    return _CHECKS[of](name, move, tell)


def _names(kind: str) -> tuple[str, ...]:
    return (*BUILT_IN[kind], *plugin_names(kind))


def _laws(estimator: str) -> tuple[str, ...]:
    return tuple(model for model, kinds in ESTIMATORS.items() if estimator in kinds)


def _check_robot(name: str, move: bool, tell: Tell) -> dict[str, list[Finding]]:
    settings = SessionSettings(robot=name)
    return _watched(
        f"robot {name}", lambda to: check_robot(lambda: make_session_robot(settings)[0], move=move, tell=to), tell
    )


def _check_device(name: str, _: bool, tell: Tell) -> dict[str, list[Finding]]:
    settings = SessionSettings(operator=name)
    material = make_material(DEFAULT_MATERIAL)
    surface, depth = UNKNOWN_REACH if name in HARDWARE_OPERATORS else (material.surface, material.press_depth)

    def make() -> Device:
        return make_operator(settings, surface=surface, press_depth=depth, say=lambda _: None)

    return _watched(f"device {name}", lambda to: check_device(make, name=name, tell=to), tell)


def _watched(
    title: str, check: Callable[[Callable[[Finding], None]], list[Finding]], tell: Tell
) -> dict[str, list[Finding]]:
    """The findings of what may hang, by their title."""
    found: list[Finding] = []

    def hear(finding: Finding) -> None:
        found.append(finding)
        tell(title, finding)

    watched(check, hear)
    return {title: found}


def _check_material(name: str, _: bool, tell: Tell) -> dict[str, list[Finding]]:
    title = f"material {name}"
    found = check_material(lambda: make_material(name), name=name)
    return {title: told(found, functools.partial(tell, title))}


def _check_estimator(name: str, _: bool, tell: Tell) -> dict[str, list[Finding]]:
    load_estimator(name)
    laws = [model for model, kinds in all_estimators().items() if name in kinds]
    found = {}
    for law in laws:
        title = f"estimator {name} of {law}"
        findings = check_estimator(functools.partial(make_estimator, law, name), name=name)
        found[title] = told(findings, functools.partial(tell, title))
    return found


_CHECKS: dict[str, Callable[[str, bool, Tell], dict[str, list[Finding]]]] = {
    "robot": _check_robot,
    "device": _check_device,
    "material": _check_material,
    "estimator": _check_estimator,
}
