"""What one process shows to its peers, and whom it lets in."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from datetime import datetime

from foretouch.errors import SettingError
from foretouch.link.certificates import WARNING_DAYS, Identity, utc_now
from foretouch.link.key_folder import KeyFolder, role_of

__all__ = ["Credentials", "load_credentials"]


@dataclass(frozen=True, slots=True)
class Credentials:
    """Read once and handed on as read, so that what was checked is what is used.

    Attributes:
        identity: Key and certificate of this process.
        authority: Certificate that all peers' are checked against.
        allowed: Common names that are let in.
        warning: One line where a certificate ends soon, "" otherwise.
    """

    identity: Identity
    authority: Identity = field(repr=False)
    allowed: tuple[str, ...]
    warning: str


def load_credentials(
    role: str, folder: str | os.PathLike[str] | None = None, *, now: datetime | None = None
) -> Credentials:
    """Credentials of this machine for a role.

    Args:
        role: ``"leader"``, ``"follower"`` or ``"watcher"``; of several certificates the one without a name is taken.
        folder: Of keys; the default one where none is given.
        now: UTC; this machine's clock where none is given.

    Raises:
        SettingError: A file is missing, can be read by others, has expired, or does not belong to the rest.
        MissingExtraError: cryptography is not installed.
    """
    now = utc_now() if now is None else now
    keys = KeyFolder(folder)
    authority, here, allowed = keys.read()
    fitting = [name for name in here if role_of(name) == role]
    if not fitting:
        raise SettingError("keys", str(keys.path), f"has no certificate for the {role}: foretouch keys issue {role}")
    if role not in fitting and len(fitting) > 1:
        rule = f"has several certificates for the {role} ({', '.join(fitting)}): keep the one of this machine"
        raise SettingError("keys", str(keys.path), rule)
    identity = here[role if role in fitting else fitting[0]]
    if not identity.issued_by(authority):
        rule = f"is from another authority than {keys.path / 'authority.crt'}: copy both from where they were made"
        raise SettingError("keys", str(keys.path / f"{identity.common_name}.pem"), rule)
    for each, remedy in ((authority, "rotate --authority"), (identity, f"rotate {identity.common_name}")):
        if each.days_left(now) <= 0.0:
            rule = f"expired on {each.expires:%Y-%m-%d}: foretouch keys {remedy}, and copy the new files"
            raise SettingError("keys", each.common_name, rule)
    return Credentials(identity, authority, allowed, _warning(identity, now))


def _warning(identity: Identity, now: datetime) -> str:
    left = identity.days_left(now)
    if left > WARNING_DAYS:
        return ""
    return (
        f"the certificate of {identity.common_name} ends in {left:.0f} days, on {identity.expires:%Y-%m-%d}: "
        "foretouch keys rotate"
    )
