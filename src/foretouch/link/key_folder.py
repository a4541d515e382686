"""A folder of keys: the authority, the certificates that it issued, and the names that are let in.

- ``authority.key``: private key and certificate of the authority; stays on the machine where it was made.
- ``authority.crt``: certificate of the authority, on every machine.
- ``ROLE[.NAME].pem``: private key and certificate of one process, on its machine.
- ``allowed.txt``: the common names that are let in, one a line, on every machine.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from foretouch.errors import SettingError
from foretouch.link.certificates import CERTIFICATE_DAYS, Identity, make_authority, make_identity, refused

ROLES = ("leader", "follower", "watcher")
"""Roles of processes; recorder and console are watchers."""

LARGEST_FILE = 65_536  # Largest file [bytes]: longer ones are refused unread

_AUTHORITY_KEY, _AUTHORITY, _ALLOWED = "authority.key", "authority.crt", "allowed.txt"
_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,31}")
_STAGED, _NEXT = ".staged", ".next"


def default_key_folder() -> Path:
    """``FORETOUCH_KEYS``, or ``~/.config/foretouch/keys``."""
    chosen = os.environ.get("FORETOUCH_KEYS")
    return Path(chosen) if chosen else Path.home() / ".config" / "foretouch" / "keys"


def role_of(common_name: str) -> str:
    """Role of a common name, which is the role itself or role.NAME.

    Raises:
        SettingError: It is neither.
    """
    role, dot, name = common_name.partition(".")
    if role not in ROLES or (dot and not _NAME.fullmatch(name)):
        rule = f"write ROLE or ROLE.NAME: {', '.join(ROLES)}; a name of a-z, 0-9 and -, at most 32 long"
        raise SettingError("common name", common_name, rule)
    return role


class KeyFolder:
    """Reads and writes a folder of keys.

    Files that belong together are written together: complete in a folder beside, which one rename declares to be
    valid, and the next process moves what a crash has left there. A lock keeps two processes apart.

    Args:
        path: The folder; the default one where none is given.

    Attributes:
        tightened: Whether `init` took from others the right to look into the folder.
    """

    def __init__(self, path: str | os.PathLike[str] | None = None) -> None:
        self.path = default_key_folder() if path is None else Path(path)
        self.tightened = False

    def init(self, now: datetime) -> Identity:
        """Make an authority, and the list of admitted names with the three roles.

        Args:
            now: UTC.

        Returns:
            The authority.

        Raises:
            SettingError: There is one already, or the folder cannot be written.
        """
        try:
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
            mode = stat.S_IMODE(self.path.stat().st_mode)
            if mode & 0o077 and not mode & 0o022:  # what others could write to is refused below
                self.path.chmod(0o700)
                self.tightened = True
        except OSError as error:
            raise refused(self.path, f"cannot be made: {error.strerror}") from None
        with self._locked():
            for name in (_AUTHORITY_KEY, _AUTHORITY):
                self._require_new(name, "--authority")
            authority = make_authority(now)
            self._commit(_authority_files(authority) | {_ALLOWED: _as_text(ROLES)})
        return authority

    def issue(self, role: str, name: str, now: datetime, days: float = CERTIFICATE_DAYS) -> Identity:
        """Make the key and the certificate of one process, and let it in.

        Args:
            role: One of `ROLES`.
            name: Tells several of a role apart; empty for none.
            now: Present time, UTC.
            days: Validity [days].

        Raises:
            SettingError: No authority here, a bad name, or there is such a certificate already.
        """
        common_name = f"{role}.{name}" if name else role
        role_of(common_name)
        with self._locked():
            authority = self._authority(now)
            self._require_new(f"{common_name}.pem", common_name)
            identity = make_identity(authority, common_name, now, days)
            allowed = dict.fromkeys((*self._allowed(), common_name))
            self._commit({f"{common_name}.pem": identity.pem, _ALLOWED: _as_text(allowed)})
        return identity

    def rotate(
        self, common_name: str | None, now: datetime, days: float = CERTIFICATE_DAYS, *, authority: bool = False
    ) -> list[Identity]:
        """Make new keys and certificates in place of those here: all of them, or none if anything fails.

        Args:
            common_name: Whose; None for all that are here.
            now: Present time, UTC.
            days: Validity [days].
            authority: A new authority first; then every certificate is new, and the old ones are let in nowhere once
                the new ``authority.crt`` has been copied.

        Returns:
            The new certificates.

        Raises:
            SettingError: No authority here, or no such certificate.
        """
        with self._locked():
            here = self._names()
            if common_name is not None:
                if common_name not in here:
                    there = ", ".join(here) or "none"
                    raise refused(common_name, f"has no certificate in {self.path}, which has {there}")
                if authority:
                    raise refused(common_name, "cannot be made again alone: with a new authority all certificates are")
                here = [common_name]
            if authority:
                self._read(_AUTHORITY_KEY)  # a new one takes the place of the old one, which must be here
            signing = make_authority(now) if authority else self._authority(now)
            made = [make_identity(signing, each, now, days) for each in here]
            files = {f"{identity.common_name}.pem": identity.pem for identity in made}
            self._commit(_authority_files(signing) | files if authority else files)
        return made

    def read(self) -> tuple[Identity, dict[str, Identity], tuple[str, ...]]:
        """The authority's certificate, the certificates here by common name, and the admitted names.

        Raises:
            SettingError: A file is missing, is none, or others may read what they must not.
        """
        with self._locked():
            authority = Identity.read(self._read(_AUTHORITY), self.path / _AUTHORITY, with_key=False)
            here = {name: self._identity(name) for name in self._names()}
            return authority, here, self._allowed()

    def _require_new(self, name: str, rotated: str) -> None:
        if (self.path / name).exists():
            rule = f"is there already and is not overwritten: foretouch keys rotate {rotated} makes a new one"
            raise refused(self.path / name, rule)

    def _authority(self, now: datetime) -> Identity:
        path = self.path / _AUTHORITY_KEY
        authority = Identity.read(self._read(_AUTHORITY_KEY), path, with_key=True)
        if authority.days_left(now) <= 0.0:
            raise refused(path, "has expired: foretouch keys rotate --authority makes a new one")
        return authority

    def _identity(self, common_name: str) -> Identity:
        path = self.path / f"{common_name}.pem"
        identity = Identity.read(self._read(path.name), path, with_key=True)
        if identity.common_name != common_name:
            raise refused(path, f"is the certificate of {identity.common_name!r}: a file is named as its certificate")
        return identity

    def _names(self) -> list[str]:
        return sorted(path.stem for path in self.path.glob("*.pem"))

    def _allowed(self) -> tuple[str, ...]:
        names = [line.strip() for line in self._read(_ALLOWED).decode("utf-8", "replace").splitlines()]
        names = [name for name in names if name and not name.startswith("#")]
        for name in names:
            role_of(name)
        return tuple(dict.fromkeys(names))

    def _read(self, name: str) -> bytes:
        """A file's content; a private one is refused where others may read it, any where others may write it."""
        path = self.path / name
        try:
            with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
                status = os.fstat(file.fileno())
                if not stat.S_ISREG(status.st_mode):
                    raise refused(path, "is no regular file")
                public = name in (_AUTHORITY, _ALLOWED)
                if status.st_mode & (0o022 if public else 0o077):
                    verb = "written" if public else "read"
                    raise refused(path, f"can be {verb} by others than its owner: chmod 600 {path}")
                content = file.read(LARGEST_FILE + 1)
        except FileNotFoundError:
            remedy = "run this" if name == _AUTHORITY_KEY else "copy it from the machine"
            rule = f"is not here: {remedy} where the authority was made, or foretouch keys init"
            raise refused(path, rule) from None
        except OSError as error:
            raise refused(path, f"cannot be read: {error.strerror}") from None
        if len(content) > LARGEST_FILE:
            raise refused(path, f"is longer than {LARGEST_FILE} bytes")
        return content

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Be alone in the folder, with nothing half moved in it."""
        try:
            folder = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError as error:
            rule = f"is no folder of keys ({error.strerror}): foretouch keys init makes one"
            raise refused(self.path, rule) from None
        try:
            if os.fstat(folder).st_mode & 0o022:
                raise refused(self.path, f"can be written by others: chmod 700 {self.path}")
            fcntl.flock(folder, fcntl.LOCK_EX)
            try:
                shutil.rmtree(self.path / _STAGED, ignore_errors=True)  # never declared valid
                self._finish()
                yield
            except OSError as error:
                raise refused(self.path, f"cannot be written: {error.strerror or error}") from None
        finally:
            os.close(folder)

    def _commit(self, files: Mapping[str, bytes]) -> None:
        """Write all of these files or none."""
        staged = self.path / _STAGED
        staged.mkdir(mode=0o700)
        for name, content in files.items():
            with open(os.open(staged / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        _sync(staged)
        staged.rename(self.path / _NEXT)  # from here on the new files are the valid ones
        _sync(self.path)
        self._finish()

    def _finish(self) -> None:
        """Move what was declared valid to its place."""
        declared = self.path / _NEXT
        if not declared.is_dir():
            return
        for path in sorted(declared.iterdir()):
            path.replace(self.path / path.name)
        _sync(self.path)
        declared.rmdir()


def _authority_files(authority: Identity) -> dict[str, bytes]:
    return {_AUTHORITY_KEY: authority.pem, _AUTHORITY: authority.certificate}


def _as_text(names: Iterable[str]) -> bytes:
    return "".join(f"{name}\n" for name in names).encode()


def _sync(folder: Path) -> None:
    """See that names in a folder outlast a power cut."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
