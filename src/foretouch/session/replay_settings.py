"""The settings of a recorded session, for it to be run again."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from foretouch.devices import OPERATORS
from foretouch.errors import InputError
from foretouch.robot import material_names
from foretouch.session.settings import SessionSettings

__all__ = ["recorded_settings"]

_DEFAULTS: dict[str, Any] = {one.name: one.default for one in dataclasses.fields(SessionSettings) if one.init}
del _DEFAULTS["robot"]  # it is played, whatever it was
del _DEFAULTS["calibration"]  # what was recorded is corrected already


def recorded_settings(
    texts: Mapping[str, str], changes: Mapping[str, Any] | None = None
) -> tuple[SessionSettings, tuple[str, ...]]:
    """The settings that a recording names, some of them changed.

    What the recording does not say, or what no version knows that this one is, has its default. A changed law has its
    own default estimator, unless that is changed too.

    Args:
        texts: `foretouch.messages.SessionLog.settings`.
        changes: Fields of `SessionSettings` and their new values.

    Returns:
        The settings, and one sentence on each thing for which a default was taken.

    Raises:
        SettingError: A changed value is out of range, or does not go with the others.
        UnknownNameError: A changed name that does not exist.
    """
    values, notes = _parsed(texts)
    try:
        SessionSettings(**values)
    except InputError:
        values, refused = _understood(values)
        notes += refused
    changes = dict(changes or {})
    if "model" in changes and changes["model"] != values.get("model"):
        values.pop("estimator", None)
    return SessionSettings(**values | changes), tuple(notes)


def _parsed(texts: Mapping[str, str]) -> tuple[dict[str, Any], list[str]]:
    """The values in the texts, by name, and what is to be said of the others."""
    values: dict[str, Any] = {}
    missing, notes = [], []
    for name, default in _DEFAULTS.items():
        if name not in texts:
            missing.append(name)
        elif name == "operator" and texts[name] not in OPERATORS:
            continue  # a shadow, or a device of somebody's own: it is played, whoever it was
        elif name == "material" and texts[name] not in material_names():
            continue  # of a package that is not here: what it answered is played
        else:
            try:
                values[name] = (float if default is None else type(default))(texts[name])  # None: a number not stated
            except ValueError:
                notes.append(_not_known(name, texts[name]))
    if missing:
        notes.insert(0, f"the recording does not say {', '.join(missing)}: defaults are taken")
    return values, notes


def _understood(values: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Those values that go together, as many as can be had, and what is to be said of the others."""
    taken: dict[str, Any] = {}
    left = dict(values)
    for _ in range(2):  # some need others that come later
        for name in list(left):
            try:
                SessionSettings(**taken, **{name: left[name]})
            except InputError:
                continue
            taken[name] = left.pop(name)
    return taken, [_not_known(name, str(value)) for name, value in left.items()]


def _not_known(name: str, text: str) -> str:
    default = _DEFAULTS[name] or "its default"
    return f"the recording says {name} = {text!r}, which this version does not take: {default} is taken"
