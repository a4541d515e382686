"""X.509 certificates of a private authority: making, reading and judging them. No files here.

Keys are Ed25519 (RFC 8032), certificates follow RFC 5280; both by the package `cryptography`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

from foretouch.errors import MissingExtraError, SettingError

if TYPE_CHECKING:
    from cryptography import x509

AUTHORITY_DAYS = 3650
"""Lifetime of an authority [days]; no certificate outlasts it."""

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
        x509, _, serialization, _ = _cryptography()
        try:
            certificate = x509.load_pem_x509_certificate(content)
            name = _common_name(certificate)
            key = serialization.load_pem_private_key(content, None) if with_key else None
        except Exception as error:  # the package has no error of its own for all that can be wrong
            reason = " ".join(str(error).split())[:120] or type(error).__name__
            raise SettingError("keys", str(source), f"is no key with a certificate ({reason})") from None
        if key is not None and key.public_key() != certificate.public_key():
            raise SettingError("keys", str(source), "holds a key and the certificate of another key: issue it again")
        return cls(
            name,
            certificate.not_valid_after_utc,
            certificate.public_bytes(serialization.Encoding.PEM),
            certificate.fingerprint(_cryptography()[3].SHA256()).hex(),
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
        x509 = _cryptography()[0]
        from cryptography.exceptions import InvalidSignature

        try:
            x509.load_pem_x509_certificate(self.certificate).verify_directly_issued_by(
                x509.load_pem_x509_certificate(authority.certificate)
            )
        except (InvalidSignature, ValueError, TypeError):
            return False
        return True


def make_authority(now: datetime) -> Identity:
    """A private authority: signs certificates and nothing else.

    Args:
        now: UTC.

    Raises:
        MissingExtraError: cryptography is not installed.
    """
    x509, ed25519, _, _ = _cryptography()
    key = ed25519.Ed25519PrivateKey.generate()
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, AUTHORITY_NAME)])
    builder = _builder(name, name, key, now, now + timedelta(days=AUTHORITY_DAYS), authority=True)
    return _identity(builder.sign(key, None), key)


def make_identity(authority: Identity, common_name: str, now: datetime, days: float = CERTIFICATE_DAYS) -> Identity:
    """A certificate for one process of a session, which listens with it and connects with it.

    Args:
        authority: Authority with its key.
        common_name: What the access list knows it by.
        now: Present time, UTC.
        days: Validity [days], above 0; never longer than the authority's.

    Raises:
        SettingError: A length that is none.
        MissingExtraError: cryptography is not installed.
    """
    if not 0.0 < days <= AUTHORITY_DAYS:
        raise SettingError("days", days, f"must be above 0 and at most {AUTHORITY_DAYS}")
    x509, ed25519, serialization, _ = _cryptography()
    key = ed25519.Ed25519PrivateKey.generate()
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, common_name)])
    issuer = x509.load_pem_x509_certificate(authority.certificate)
    end = min(now + timedelta(days=days), authority.expires)
    builder = _builder(name, issuer.subject, key, now, end, authority=False).add_extension(
        x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer.public_key()), critical=False
    )
    signing = serialization.load_pem_private_key(authority.key, None)
    return _identity(builder.sign(signing, None), key)


def utc_now() -> datetime:
    """Now, by this machine's wall clock."""
    return datetime.now(UTC)


def _cryptography() -> tuple[Any, Any, Any, Any]:
    """The parts of the package that are used here, loaded when they are needed."""
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ImportError:
        raise MissingExtraError("cryptography", "security") from None
    return x509, ed25519, serialization, hashes


def _common_name(certificate: x509.Certificate) -> str:
    x509 = _cryptography()[0]
    names = certificate.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    if len(names) != 1:
        raise ValueError(f"{len(names)} common names")
    return str(names[0].value)


def _builder(subject: Any, issuer: Any, key: Any, now: datetime, end: datetime, *, authority: bool) -> Any:
    """The part that both kinds of certificate have in common."""
    x509 = _cryptography()[0]
    signs = x509.KeyUsage(
        digital_signature=not authority,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=authority,
        crl_sign=False,
        encipher_only=False,
        decipher_only=False,
    )
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_SKEW)
        .not_valid_after(end)
        .add_extension(x509.BasicConstraints(ca=authority, path_length=0 if authority else None), critical=True)
        .add_extension(signs, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )
    if authority:
        return builder
    uses = x509.ExtendedKeyUsage([x509.ExtendedKeyUsageOID.SERVER_AUTH, x509.ExtendedKeyUsageOID.CLIENT_AUTH])
    return builder.add_extension(uses, critical=False)


def _identity(certificate: x509.Certificate, key: Any) -> Identity:
    _, _, serialization, _ = _cryptography()
    return Identity.read(
        _key_pem(key) + certificate.public_bytes(serialization.Encoding.PEM), "new certificate", with_key=True
    )


def _key_pem(key: Any) -> bytes:
    _, _, serialization, _ = _cryptography()
    return bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
