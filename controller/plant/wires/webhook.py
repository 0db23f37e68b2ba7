"""Each result and alarm by POST to a server, signed; tried again until it is confirmed."""

import asyncio
import hashlib
import hmac
import http.client
import ssl
from pathlib import Path
from typing import Final
from urllib.parse import SplitResult, urlsplit

from controller.config.cell.connect import WebhookSection
from controller.page.security.private_file import read_secret

from ..model import Notice
from ..plant import Plant, PlantError, RejectedError

ANSWER_WALL_S: Final = 15.0
REASON_MAX_BYTES: Final = 300
MIN_SECRET: Final = 16
# Client errors that pass: too slow, too early, too many.
FOR_NOW: Final = frozenset({408, 425, 429})
SIGNATURE: Final = "X-Cellctl-Signature"


class WebhookError(OSError):
    """The server has not confirmed a notice; it is tried again."""


def signature(secret: bytes, body: bytes) -> str:
    """Return the value of the signature's header.

    Parameters
    ----------
    secret : shared with the receiver
    body : of the message, byte by byte as it is sent
    """
    return f"sha256={hmac.new(secret, body, hashlib.sha256).hexdigest()}"


class Webhook:
    """A server that gets each notice.

    Parameters
    ----------
    section : its address and its secret
    folder : folder of the cell file, from which its files are named

    Raises
    ------
    PlantError : the secret is missing, short, or others may read it
    """

    def __init__(self, section: WebhookSection, folder: Path) -> None:
        self.name = f"webhook {section.url}"
        self._at: SplitResult = urlsplit(section.url)
        path = folder / section.secret_file
        try:
            secret = read_secret(path)
            if len(secret) < MIN_SECRET:
                raise OSError(f"{path}: {len(secret)} bytes; a secret has {MIN_SECRET} or more")
        except OSError as error:
            raise PlantError(
                f"`connect.webhook.secret_file`: {error}: openssl rand -hex 32 > {path} && "
                f"chmod 600 {path}"
            ) from error
        self._secret = secret
        ca = None if section.ca_file is None else str(folder / section.ca_file)
        try:
            self._tls = ssl.create_default_context(cafile=ca)
        except OSError as error:
            raise PlantError(f"`connect.webhook.ca_file`: {ca}: {error}") from error

    async def serve(self, plant: Plant) -> None:
        """Do nothing: a webhook asks nothing."""
        await asyncio.Event().wait()

    async def deliver(self, notice: Notice) -> None:
        """Send a notice; return once the server has answered with 2xx.

        Raises
        ------
        RejectedError : the server will never take it
        WebhookError : it is not there, or has not confirmed it
        """
        body = notice.model_dump_json(by_alias=True).encode()
        status, reason = await asyncio.to_thread(self._post, notice.key, body)
        if 200 <= status < 300:
            return
        said = f"{self._at.geturl()}: answered {status} {reason}".strip()
        if 400 <= status < 500 and status not in FOR_NOW:
            raise RejectedError(said)
        raise WebhookError(said)

    def _post(self, key: str, body: bytes) -> tuple[int, str]:
        host, port = self._at.hostname or "", self._at.port
        connection: http.client.HTTPConnection
        if self._at.scheme == "https":
            connection = http.client.HTTPSConnection(
                host, port, timeout=ANSWER_WALL_S, context=self._tls
            )
        else:
            connection = http.client.HTTPConnection(host, port, timeout=ANSWER_WALL_S)
        headers = {
            "Content-Type": "application/json",
            "Idempotency-Key": key.encode("ascii", "backslashreplace").decode(),
            SIGNATURE: signature(self._secret, body),
        }
        path = (self._at.path or "/") + (f"?{self._at.query}" if self._at.query else "")
        try:
            connection.request("POST", path, body, headers)
            answer = connection.getresponse()
            said = answer.read(REASON_MAX_BYTES).decode(errors="replace")
            return answer.status, " ".join(said.split())
        except (OSError, http.client.HTTPException, ValueError) as error:
            raise WebhookError(f"{self._at.geturl()}: {error or type(error).__name__}") from error
        finally:
            connection.close()
