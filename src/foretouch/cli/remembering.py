"""What is remembered of a material under a name, for the commands that learn it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import say
from foretouch.errors import SettingError

if TYPE_CHECKING:
    from foretouch.identification import Estimator
    from foretouch.messages import SessionLog
    from foretouch.models import ContactMapModel
    from foretouch.session import SessionSettings

Remember = Annotated[
    str | None,
    typer.Option(help="Name of the material: begin with its map from before, if there is one, and keep it at the end."),
]

LEAST_CONTACT = 1.0  # Time in contact from which a map is kept [s]


def begin_with(estimator: Estimator, name: str | None) -> None:
    """Let an estimator begin with what is remembered; a SettingError says that it is none of contact maps."""
    from foretouch.identification import ContactMap
    from foretouch.recordings import read_memory

    if name is None:
        return
    if not isinstance(estimator, ContactMap):
        raise SettingError("remember", name, "is of contact maps: --model contact-map --estimator bank")
    known = read_memory(name)
    if known is not None:
        estimator.recall(known)


def begin_as(estimator: Estimator, log: SessionLog) -> None:
    """Let an estimator begin with what was remembered in a session, as its recording says."""
    from foretouch.identification import ContactMap
    from foretouch.models import ContactMapModel

    text = log.longest().settings.get("remembered", "")
    if text and isinstance(estimator, ContactMap):
        estimator.recall(ContactMapModel.from_text(text))


def keep(estimator: Estimator, name: str | None) -> str | None:
    """Keep what an estimator has learnt, and say what became of a map from before; None without a name."""
    from foretouch.identification import ContactMap

    if name is None or not isinstance(estimator, ContactMap):
        return None
    _write(name, estimator.remembered if estimator.contact_time >= LEAST_CONTACT else None)
    return estimator.recalls


def settings_with(settings: SessionSettings, name: str | None) -> SessionSettings:
    """Settings of a session that begins with what is remembered."""
    from foretouch.recordings import read_memory

    if name is None:
        return settings
    if settings.model != "contact-map" or settings.estimator not in ("", "bank"):
        raise SettingError("remember", name, "is of contact maps: --model contact-map --estimator bank")
    known = read_memory(name)
    return settings if known is None else replace(settings, remembered=known.to_text())


def keep_of(log: SessionLog, name: str | None) -> None:
    """Keep the newest map of a session."""
    from foretouch.identification import from_the_surface
    from foretouch.models import ContactMapModel

    if name is None:
        return
    known = [one for one in log.models if one.law == ContactMapModel.law and one.valid]
    touched = float(log.follower["in_contact"].sum()) * 1e-3  # a tick is a millisecond
    model = None
    if known and touched >= LEAST_CONTACT:
        stiffness, damping, exponent, switching = known[-1].parameters
        newest = ContactMapModel(stiffness, damping, exponent, switching, known[-1].map)
        model = ContactMapModel.of(from_the_surface(newest.record))
    _write(name, model)


def _write(name: str, model: ContactMapModel | None) -> None:
    from foretouch.recordings import write_memory

    if model is None:
        say(f"remember: nothing new is kept of {name}: less than {LEAST_CONTACT:g} s in contact")
    else:
        say(f"remember: {write_memory(name, model)}; delete it to forget")
