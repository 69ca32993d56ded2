"""A certificate for the page, made once: browsers give cameras and headsets to pages over TLS only.

It is signed by itself, so a browser asks once whether to trust it. The key stays in the user's own folder, readable by
nobody else.
"""

from __future__ import annotations

import ipaddress
import os
import socket
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from highfive.model.errors import HighFiveError
from highfive.model.files import write_whole

LASTS = timedelta(days=390)
"""Browsers refuse certificates of much more than a year."""
_LEFT = timedelta(days=7)
_NOT_SENT_TO = ("192.0.2.1", 9)  # of a network that does not exist (RFC 5737): only asks which way packets would go


def network_address() -> str | None:
    """This machine's address in its network, as others would reach it; None where it is in none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(_NOT_SENT_TO)
        except OSError:
            return None
        address = str(probe.getsockname()[0])
    return None if ipaddress.ip_address(address).is_unspecified else address


def certificate_folder() -> Path:
    """The user's own: ``$XDG_CONFIG_HOME/highfive``, or ``~/.config/highfive``."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "highfive"


def certificate(names: tuple[str, ...], folder: Path | None = None) -> tuple[Path, Path]:
    """Files with certificate and key, both PEM; made where there are none, or they lack a name or end within a week.

    Args:
        names: host names and addresses that it must be good for, besides this machine's own loopback.
        folder: where they are kept; None is :func:`certificate_folder`.

    Raises:
        HighFiveError: they cannot be written.
    """
    folder = certificate_folder() if folder is None else folder
    files = folder / "page-certificate.pem", folder / "page-key.pem"
    wanted = {"localhost", "127.0.0.1", "::1", *names}
    if not _still_good(*files, wanted):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _make(*files, wanted)
        except OSError as error:
            raise HighFiveError(f"cannot write the page's certificate into {folder}: {error.strerror}") from None
    return files


def _still_good(certificate: Path, key: Path, wanted: set[str]) -> bool:
    try:
        found = x509.load_pem_x509_certificate(certificate.read_bytes())
        private = serialization.load_pem_private_key(key.read_bytes(), None)
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (OSError, ValueError, TypeError, x509.ExtensionNotFound):
        return False
    has = {str(name.value) for name in names}
    lasts = found.not_valid_after_utc > datetime.now(UTC) + _LEFT
    return lasts and wanted <= has and private.public_key() == found.public_key()


def _make(certificate: Path, key: Path, wanted: set[str]) -> None:
    private = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "High Five live page")])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(private.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(hours=1))
        .not_valid_after(now + LASTS)
        .add_extension(x509.SubjectAlternativeName([_general_name(each) for each in sorted(wanted)]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(private, hashes.SHA256())
    )
    plain = serialization.NoEncryption()
    secret = private.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain)
    before = os.umask(0o077)
    try:
        write_whole(key, secret)
        write_whole(certificate, made.public_bytes(serialization.Encoding.PEM))
    finally:
        os.umask(before)
    key.chmod(0o600)


def _general_name(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        return x509.DNSName(name)
