"""The server's own key and certificate, and the certificates of clients that a person trusts.

A folder holds all of them::

    own/key.pem, own/certificate.der   made at the first start; give the .der to clients
    trusted/                           certificates of clients, DER or PEM, put here by a person
    rejected/                          those of clients that were turned away; move one to trusted/

A client is trusted by its very certificate: no authority vouches for another, so that a trusted
client cannot let in others. The folder is read at each new connection.
"""

import logging
import os
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from controller.page.security.private_file import SharedFileError, read_private, write_private

log = logging.getLogger(__name__)

# Basic256Sha256 and Aes256_Sha256_RsaPss allow 2048 to 4096 bits (OPC 10000-7)
MIN_KEY_BITS: Final = 2048
OWN_KEY_BITS: Final = 3072
OWN_VALID_DAYS: Final = 5 * 365
WARN_DAYS: Final = 60
MAX_CERTIFICATE_BYTES: Final = 16_384  # one of 4096 bits has some 2,000
MAX_TRUSTED_COUNT: Final = 200
# Anyone who reaches the port can fill the folder: a person looks through some tens at most.
MAX_REJECTED_COUNT: Final = 50


class CertificateError(Exception):
    """A certificate of this server cannot be used."""


class CertificateFolder:
    """The folder of certificates.

    Parameters
    ----------
    folder : its path; made where it is not there
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @property
    def certificate_path(self) -> Path:
        """File of this server's certificate."""
        return self._folder / "own" / "certificate.der"

    @property
    def key_path(self) -> Path:
        """File of this server's private key, which this user alone may read."""
        return self._folder / "own" / "key.pem"

    def own(self, uri: str, hosts: tuple[str, ...]) -> tuple[x509.Certificate, rsa.RSAPrivateKey]:
        """Return this server's certificate and private key; make them the first time.

        Parameters
        ----------
        uri : application URI, which must be the certificate's
        hosts : names and addresses by which clients reach the server

        Raises
        ------
        CertificateError : the files there do not do; says why
        """
        for part in ("own", "trusted", "rejected"):
            (self._folder / part).mkdir(mode=0o700, parents=True, exist_ok=True)
        if not self.key_path.exists() and not self.certificate_path.exists():
            self._make_own(uri, hosts)
        try:
            text = read_private(self.key_path)
            if text is None:
                raise CertificateError(
                    f"{self.key_path} is missing; remove {self.certificate_path} to have both made"
                    " anew"
                )
            key = serialization.load_pem_private_key(text, password=None)
            certificate = _read(self.certificate_path)
        except (OSError, SharedFileError, ValueError, TypeError) as error:
            raise CertificateError(f"certificate of the OPC UA server: {error}") from error
        if not isinstance(key, rsa.RSAPrivateKey) or key.public_key() != certificate.public_key():
            raise CertificateError(
                f"{self.certificate_path} is not the certificate of {self.key_path}"
            )
        if uri not in _uris(certificate):
            raise CertificateError(
                f"{self.certificate_path} is for {', '.join(_uris(certificate)) or 'no URI'}, this"
                f" cell is {uri}; move the folder own/ away to have a new one made"
            )
        left = certificate.not_valid_after_utc - datetime.now(UTC)
        if left < timedelta(days=WARN_DAYS):
            log.warning(
                "the certificate of the OPC UA server ends in %d days: move %s away to have a new"
                " one made, and give it to the clients",
                left.days,
                self.certificate_path.parent,
            )
        return certificate, key

    def refusal(self, der: bytes | None) -> str:
        """Return why a client's certificate is not trusted; empty if it is.

        A certificate that is turned away is kept in the folder of rejected ones.
        """
        der = leaf(der or b"")
        if not der or len(der) > MAX_CERTIFICATE_BYTES:
            return "no certificate, or one too large"
        try:
            certificate = x509.load_der_x509_certificate(der)
        except ValueError:
            return "what was sent is no certificate"
        now = datetime.now(UTC)
        if not certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc:
            return (
                f"its certificate is valid from {certificate.not_valid_before_utc:%Y-%m-%d} to"
                f" {certificate.not_valid_after_utc:%Y-%m-%d}"
            )
        key = certificate.public_key()
        if not isinstance(key, rsa.RSAPublicKey) or key.key_size < MIN_KEY_BITS:
            return f"its key is no RSA key of {MIN_KEY_BITS} bits or more"
        if certificate.public_bytes(serialization.Encoding.DER) in self._trusted():
            return ""
        kept = self._keep_rejected(der)
        return f"its certificate is not in {self._folder / 'trusted'}{kept}"

    def _trusted(self) -> set[bytes]:
        found = set()
        for path in sorted((self._folder / "trusted").iterdir())[:MAX_TRUSTED_COUNT]:
            try:
                found.add(_read(path).public_bytes(serialization.Encoding.DER))
            except (OSError, ValueError) as error:
                log.warning("%s is no certificate: %s", path, error)
        return found

    def _keep_rejected(self, der: bytes) -> str:
        folder = self._folder / "rejected"
        path = folder / f"{sha256(der).hexdigest()[:16]}.der"
        if not path.exists():
            if sum(1 for _ in folder.iterdir()) >= MAX_REJECTED_COUNT:
                return f"; {folder} is full with {MAX_REJECTED_COUNT}, remove those of no use"
            path.write_bytes(der)
        return f"; to trust it, move {path} there"

    def _make_own(self, uri: str, hosts: tuple[str, ...]) -> None:
        key = rsa.generate_private_key(public_exponent=65537, key_size=OWN_KEY_BITS)
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, uri.rpartition(":")[2][:64])])
        now = datetime.now(UTC)
        certificate = (
            x509.CertificateBuilder()
            .subject_name(name)
            .issuer_name(name)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - timedelta(days=1))  # a client's clock may be behind
            .not_valid_after(now + timedelta(days=OWN_VALID_DAYS))
            .add_extension(
                x509.SubjectAlternativeName(
                    [x509.UniformResourceIdentifier(uri), *map(_alternative_name, hosts)]
                ),
                critical=False,
            )
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(
                # OPC 10000-6, table 43: what an application's certificate is used for
                x509.KeyUsage(
                    digital_signature=True,
                    content_commitment=True,
                    key_encipherment=True,
                    data_encipherment=True,
                    key_agreement=False,
                    key_cert_sign=False,
                    crl_sign=False,
                    encipher_only=False,
                    decipher_only=False,
                ),
                critical=True,
            )
            .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
            .add_extension(
                x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False
            )
            .sign(key, hashes.SHA256())
        )
        text = key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
        write_private(self.key_path, text.decode("ascii"))
        fresh = self.certificate_path.with_name(f"{self.certificate_path.name}.{os.getpid()}")
        fresh.write_bytes(certificate.public_bytes(serialization.Encoding.DER))
        fresh.replace(self.certificate_path)


def leaf(der: bytes) -> bytes:
    """Return the first certificate of a chain, which is one behind the other (OPC 10000-6, 6.2)."""
    if der[:2] != b"\x30\x82":  # a sequence whose length takes two bytes
        return der
    return der[: 4 + int.from_bytes(der[2:4], "big")]


def _alternative_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _read(path: Path) -> x509.Certificate:
    with path.open("rb") as file:
        data = file.read(MAX_CERTIFICATE_BYTES)
    if data.startswith(b"-----BEGIN"):
        return x509.load_pem_x509_certificate(data)
    return x509.load_der_x509_certificate(data)


def _uris(certificate: x509.Certificate) -> list[str]:
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return names.get_values_for_type(x509.UniformResourceIdentifier)
