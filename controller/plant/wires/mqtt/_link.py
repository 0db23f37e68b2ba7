"""A connection to an MQTT broker: its will, its end, and what the broker refuses.

Not responsible for topics and payloads. Source: MQTT 5.0, OASIS Standard, 2019-03-07; the numbers
of its sections stand at the lines. aiomqtt 2.5 hides what decides here whether a result arrived:
the reason in a PUBACK (3.4.2.1), and the loss of the connection while one is awaited. It waits to
write to a socket that has been closed, for the answer of a broker that has hung up, and leaves
errors that nobody asks for. `BrokerLink` mends these.
"""

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import aiomqtt
from aiomqtt.types import PahoSocket
from paho.mqtt import client as paho
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from controller.config.cell.mqtt import MqttSection
from controller.page.security.private_file import read_secret

from ...plant import RejectedError

# A broker that answers at all does so in milliseconds; a slow line needs some seconds.
ANSWER_S: Final = 10.0
# Seconds for a last message at the end; what is not said by then, the will says.
FAREWELL_S: Final = 2.0
# Bytes of the largest message that is taken in: an order of 2,000 serial numbers of 80 signs.
MAX_BYTES: Final = 250_000
# Messages that wait; of more, the sender gets no answer and asks again.
MAX_WAITING: Final = 32
# Reasons in a PUBACK that are about this message and stay as they are: MQTT 5.0, 3.4.2.1
NEVER: Final = {0x95: "it is too large", 0x99: "its format is not allowed"}


@dataclass(frozen=True, slots=True)
class Message:
    """Something to publish."""

    topic: str
    payload: bytes
    qos: int = 1
    is_retained: bool = False


@dataclass(frozen=True, slots=True)
class Access:
    """The way to a broker; files are read anew for each connection, since they are renewed.

    Attributes
    ----------
    folder : folder that names of files are relative to
    """

    settings: MqttSection
    folder: Path

    def password(self) -> str | None:
        """Return the password.

        Raises
        ------
        OSError : its file cannot be read, is readable by others, or is empty
        """
        if (name := self.settings.password_file) is None:
            return None
        return read_secret(self.folder / name).decode(errors="replace")

    def tls(self) -> ssl.SSLContext | None:
        """Return the certificates.

        Raises
        ------
        OSError : a file cannot be read or is no certificate
        """
        files = self.settings.tls
        if files is None:
            return None
        ca = self.folder / files.ca if files.ca else None
        try:
            context = ssl.create_default_context(cafile=ca)
            context.minimum_version = ssl.TLSVersion.TLSv1_2
            if files.certificate and files.key:
                read_secret(self.folder / files.key)
                context.load_cert_chain(self.folder / files.certificate, self.folder / files.key)
        except ssl.SSLError as error:
            raise OSError(f"connect.mqtt.tls: {error}; are these PEM files?") from error
        return context


class BrokerLink(aiomqtt.Client):
    """A connection, made by `connected`."""

    def __init__(self, access: Access, identifier: str, will: Message) -> None:
        settings = access.settings
        self._is_5 = settings.version == 5
        connect: dict[str, Any] = {"clean_session": True}
        if self._is_5:
            properties = Properties(PacketTypes.CONNECT)
            properties.SessionExpiryInterval = 0
            properties.MaximumPacketSize = MAX_BYTES
            properties.ReceiveMaximum = MAX_WAITING
            connect = {"clean_start": True, "properties": properties}
        host, port = settings.address
        super().__init__(
            host,
            port,
            identifier=identifier,
            protocol=aiomqtt.ProtocolVersion.V5 if self._is_5 else aiomqtt.ProtocolVersion.V311,
            username=settings.user,
            password=access.password(),
            tls_context=access.tls(),
            keepalive=settings.keep_alive_s,
            timeout=ANSWER_S,
            will=aiomqtt.Will(will.topic, will.payload, will.qos, will.is_retained),
            max_queued_incoming_messages=MAX_WAITING,
            **connect,
        )
        self._will = will
        self._sending = asyncio.Lock()
        self._reason: ReasonCode | None = None

    def _on_publish(
        self,
        client: paho.Client,
        userdata: object,
        mid: int,
        reason_code: ReasonCode,
        properties: Properties,
    ) -> None:
        self._reason = reason_code
        super()._on_publish(client, userdata, mid, reason_code, properties)

    def _on_disconnect(
        self,
        client: paho.Client,
        userdata: object,
        flags: paho.DisconnectFlags,
        reason_code: ReasonCode,
        properties: Properties | None = None,
    ) -> None:
        def tell() -> None:
            if not self._connected.done():
                why = "the connection was closed before the broker answered; does it ask for TLS,"
                self._connected.set_exception(aiomqtt.MqttError(f"{why} or for a certificate?"))

        self._loop.call_soon_threadsafe(tell)
        super()._on_disconnect(client, userdata, flags, reason_code, properties)

    def _on_socket_register_write(
        self, client: paho.Client, userdata: object, sock: PahoSocket
    ) -> None:
        def write() -> None:
            try:
                client.loop_write()
            except Exception as error:  # noqa: BLE001 - whatever it is, the connection is over
                if not self._disconnected.done():
                    self._disconnected.set_exception(error)

        def register() -> None:
            if sock.fileno() >= 0:  # it may have been closed since
                self._loop.add_writer(sock.fileno(), write)

        self._loop.call_soon_threadsafe(register)

    async def send(self, message: Message, properties: Properties | None = None) -> None:
        """Publish a message; return once the broker has confirmed it, with QoS 1.

        Raises
        ------
        RejectedError : the broker never takes this one
        ConnectionError : the connection is lost
        OSError : it does not take it now
        TimeoutError : it does not answer
        """
        async with self._sending:
            self._reason = None
            publish = asyncio.create_task(
                self.publish(
                    message.topic,
                    message.payload,
                    message.qos,
                    message.is_retained,
                    properties if self._is_5 else None,
                )
            )
            try:
                await asyncio.wait(
                    (publish, self._disconnected), return_when=asyncio.FIRST_COMPLETED
                )
                if not publish.done():
                    raise ConnectionError(f"connection lost while {message.topic} was sent")
                publish.result()
            except aiomqtt.MqttError as error:
                if self._disconnected.done():
                    raise ConnectionError(f"{message.topic}: {error}") from error
                raise TimeoutError(f"{message.topic}: {error}") from error
            finally:
                publish.cancel()
            reason = self._reason
        if reason is None or not reason.is_failure:
            return
        said = f"the broker does not take {message.topic}: {reason}"
        if (why := NEVER.get(reason.value)) is not None:
            raise RejectedError(f"{said}; {why} for this broker")
        raise OSError(said)

    async def listen(self, topic: str) -> None:
        """Take in a topic, with QoS 1; with MQTT 5, without what was retained there.

        Raises
        ------
        OSError : the broker does not allow it, or is gone
        """
        # 3.8.3.1: retain handling 2 sends no retained messages
        options = SubscribeOptions(qos=1, retainHandling=2) if self._is_5 else None
        await self._subscribe(topic, options)

    async def follow(self, topic: str) -> None:
        """Take in a topic, with QoS 1, and what is retained there.

        Raises
        ------
        OSError : the broker does not allow it, or is gone
        """
        await self._subscribe(topic, SubscribeOptions(qos=1) if self._is_5 else None)

    async def _subscribe(self, topic: str, options: SubscribeOptions | None) -> None:
        try:
            codes = await self.subscribe(topic, qos=0 if options else 1, options=options)
        except aiomqtt.MqttError as error:
            raise ConnectionError(f"{topic}: {error}") from error
        for code in codes:
            value = code if isinstance(code, int) else code.value
            if value >= 0x80:
                raise OSError(f"the broker does not let this cell read {topic}")

    async def received(self) -> AsyncIterator[aiomqtt.Message]:
        """Yield what comes in.

        Raises
        ------
        ConnectionError : the connection is lost; always the end
        """
        try:
            async for message in self.messages:
                if len(message.payload) <= MAX_BYTES:
                    yield message
        except aiomqtt.MqttError as error:
            raise ConnectionError(f"connection lost: {error.__cause__ or error}") from error
        raise ConnectionError("connection ended")

    async def leave(self) -> None:
        """End the connection so that the will is published."""
        if self._disconnected.done():
            return
        if self._is_5:
            # 3.14.2.1: 0x04, disconnect with will message
            self._client.disconnect(
                reasoncode=ReasonCode(PacketTypes.DISCONNECT, "Disconnect with will message")
            )
            await asyncio.wait((self._disconnected,), timeout=FAREWELL_S)
        else:
            async with asyncio.timeout(FAREWELL_S):
                await self.send(self._will)

    def forget(self) -> None:
        """Take note of how the connection ended, so that asyncio does not ask about it."""
        if self._disconnected.done() and not self._disconnected.cancelled():
            self._disconnected.exception()


@asynccontextmanager
async def connected(access: Access, identifier: str, will: Message) -> AsyncIterator[BrokerLink]:
    """Connect for the time of a block; when it is left, the will is published.

    Parameters
    ----------
    access : broker, and how to get in
    identifier : name of the client, which no other has
    will : what the broker publishes at the end

    Returns
    -------
    the connection

    Raises
    ------
    ConnectionError : the broker is not there, or refuses; the message says which
    OSError : a file of `access` cannot be used
    """
    host, port = access.settings.address
    link = BrokerLink(access, identifier, will)
    try:
        async with link:
            try:
                yield link
            finally:
                with suppress(OSError, RejectedError):
                    await link.leave()
    except aiomqtt.MqttError as error:
        raise ConnectionError(f"MQTT broker {host}:{port}: {error}") from error
    finally:
        link.forget()
