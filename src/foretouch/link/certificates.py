"""X.509 certificates of a private authority: making, reading and judging them. No files here.

Keys are Ed25519 (RFC 8032), certificates follow RFC 5280; both by the package `cryptography`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any

from foretouch.errors import MissingExtraError, SettingError

AUTHORITY_DAYS = 3650  # Lifetime of an authority [days]; no certificate outlasts it

CERTIFICATE_DAYS = 365
"""Lifetime of a certificate [days] where none is given."""

WARNING_DAYS = 30
"""Time before the end of a certificate from which on it is warned of [days]."""

CLOCK_SKEW = timedelta(days=1)
"""Time by which certificates begin before they are made, for machines whose clocks are behind."""

AUTHORITY_NAME = "foretouch authority"


@dataclass(frozen=True, slots=True)
class Identity:
    """A certificate with its private key, or without one where it belongs to another.

    Attributes:
        common_name: Name of the certificate's owner.
        expires: End of its validity, UTC.
        certificate: As PEM.
        fingerprint: SHA-256 of the certificate, in hexadecimal digits.
        key: Private key as PEM (PKCS 8, not encrypted); empty where it is not known.
    """

    common_name: str
    expires: datetime
    certificate: bytes = field(repr=False)
    fingerprint: str
    key: bytes = field(default=b"", repr=False)

    @classmethod
    def read(cls, content: bytes, source: object, *, with_key: bool) -> Identity:
        """Identity from PEM text.

        Args:
            content: One certificate, and before or after it its private key.
            source: Origin of the content, for the error.
            with_key: Whether a private key has to be there.

        Raises:
            SettingError: It is none, or its key belongs to another certificate.
            MissingExtraError: cryptography is not installed.
        """
        c = _cryptography()
        try:
            certificate = c.x509.load_pem_x509_certificate(content)
            names = certificate.subject.get_attributes_for_oid(c.x509.NameOID.COMMON_NAME)
            if len(names) != 1:
                raise ValueError(f"{len(names)} common names")
            key = c.serialization.load_pem_private_key(content, None) if with_key else None
        except Exception as error:  # the package has no error of its own for all that can be wrong
            reason = " ".join(str(error).split())[:120] or type(error).__name__
            raise refused(source, f"is no key with a certificate ({reason})") from None
        if key is not None and key.public_key() != certificate.public_key():
            raise refused(source, "holds a key and the certificate of another key: issue it again")
        return cls(
            str(names[0].value),
            certificate.not_valid_after_utc,
            certificate.public_bytes(c.serialization.Encoding.PEM),
            certificate.fingerprint(c.hashes.SHA256()).hex(),
            b"" if key is None else _key_pem(key),
        )

    @property
    def pem(self) -> bytes:
        """Key and certificate in one text, so that one file holds both or neither."""
        return self.key + self.certificate

    def days_left(self, now: datetime) -> float:
        """Until it ends [days]; negative afterwards."""
        return (self.expires - now) / timedelta(days=1)

    def issued_by(self, authority: Identity) -> bool:
        """Whether the authority signed it."""
        load = _cryptography().x509.load_pem_x509_certificate
        from cryptography.exceptions import InvalidSignature

        try:
            load(self.certificate).verify_directly_issued_by(load(authority.certificate))
        except (InvalidSignature, ValueError, TypeError):
            return False
        return True


def make_authority(now: datetime) -> Identity:
    """A private authority, which only signs certificates."""
    return _issue(AUTHORITY_NAME, now, now + timedelta(days=AUTHORITY_DAYS), None)


def make_identity(authority: Identity, common_name: str, now: datetime, days: float = CERTIFICATE_DAYS) -> Identity:
    """A certificate for one process of a session, which listens with it and connects with it.

    It never lasts longer than its authority, whose key is needed.
    """
    if not 0.0 < days <= AUTHORITY_DAYS:
        raise SettingError("days", days, f"must be above 0 and at most {AUTHORITY_DAYS}")
    return _issue(common_name, now, min(now + timedelta(days=days), authority.expires), authority)


def refused(what: object, rule: str) -> SettingError:
    """The error of a file, a folder or a name of keys."""
    return SettingError("keys", str(what), rule)


def utc_now() -> datetime:
    """Now, by this machine's wall clock."""
    return datetime.now(UTC)


def _cryptography() -> Any:
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ImportError:
        raise MissingExtraError("cryptography", "security") from None
    return SimpleNamespace(x509=x509, hashes=hashes, serialization=serialization, ed25519=ed25519)


_OTHER_USES = ("content_commitment", "key_encipherment", "data_encipherment", "key_agreement", "crl_sign")
_NO_USES = dict.fromkeys((*_OTHER_USES, "encipher_only", "decipher_only"), False)


def _issue(common_name: str, now: datetime, end: datetime, authority: Identity | None) -> Identity:
    """A key and its certificate, signed by an authority; by itself, as an authority, where there is none."""
    c = _cryptography()
    x509, alone = c.x509, authority is None
    key = signing = c.ed25519.Ed25519PrivateKey.generate()
    subject = issuer = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, common_name)])
    more = []
    if authority is not None:
        signer = x509.load_pem_x509_certificate(authority.certificate)
        issuer, signing = signer.subject, c.serialization.load_pem_private_key(authority.key, None)
        more = [
            x509.ExtendedKeyUsage([x509.ExtendedKeyUsageOID.SERVER_AUTH, x509.ExtendedKeyUsageOID.CLIENT_AUTH]),
            x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()),
        ]
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_SKEW)
        .not_valid_after(end)
        .add_extension(x509.BasicConstraints(ca=alone, path_length=0 if alone else None), critical=True)
        .add_extension(x509.KeyUsage(digital_signature=not alone, key_cert_sign=alone, **_NO_USES), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )
    for extension in more:
        builder = builder.add_extension(extension, critical=False)
    certificate = builder.sign(signing, None).public_bytes(c.serialization.Encoding.PEM)
    return Identity.read(_key_pem(key) + certificate, "new certificate", with_key=True)


def _key_pem(key: Any) -> bytes:
    form = _cryptography().serialization
    return bytes(key.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, form.NoEncryption()))
