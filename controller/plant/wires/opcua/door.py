"""Who is let in, and how much each may ask for: asyncua's server with its open ends closed.

asyncua 2.1 as it comes is made to be tried. What is closed here, each tried by a test:

- Discovery alone is answered without encryption. A session there would be let in by its password
  in plain text, and without the check of rights, which hangs on the encrypted policies.
- The certificate of the *channel* is checked, when it is opened. asyncua checks the one that a
  client names in CreateSession, which may be another's.
- Names and passwords are checked in a thread, one at a time, with a limit on failed attempts; the
  hash that they are compared with takes half a second on purpose.
- A session is known by a random token: asyncua counts them, and whoever guesses one may take over.
- A call is answered in a task of its own. asyncua answers one request after the other, and its
  client gives the connection up where a read, which waits behind a call, takes a second.
- Clients write no attribute, register no server, and touch no subscription of another session.
- Messages, connections, sessions, subscriptions and publishing intervals have limits; a connection
  that breaks them, or sends what cannot be read, is closed.
"""

import asyncio
import logging
import secrets
import time
from collections.abc import Callable
from contextvars import ContextVar
from hashlib import sha256
from typing import Any, Final

from asyncua import Server, ua
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import Buffer, ServiceError
from asyncua.crypto.permission_rules import PermissionRuleset, User, UserRole
from asyncua.crypto.security_policies import (
    SECURITY_POLICY_TYPE_MAP,
    SecurityPolicyFactory,
    SecurityPolicyNone,
)
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.uaprocessor import UaProcessor
from asyncua.server.user_managers import UserManager
from asyncua.ua.ua_binary import nodeid_from_binary, struct_from_binary, uatcp_to_binary

from controller.page.security.sessions import Attempts
from controller.plant.plant import PlantError

from .certificates import CertificateFolder, leaf
from .lean import LeanNodes

log = logging.getLogger(__name__)

POLICIES: Final = (
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
)

MAX_CONNECTION_COUNT: Final = 20
MAX_UNNAMED_WALL_S: Final = 10.0  # until a connection has logged in
WARN_WALL_S: Final = 10.0
MAX_UNNAMED_MESSAGE_COUNT: Final = (
    10  # that wait; whoever logs in sends one and waits for the answer
)
MAX_CHUNK_BYTES: Final = 65_535  # the smallest buffer that every client must have is 8,192
MAX_CHUNK_COUNT: Final = 16  # a call with 2,000 serial numbers of 80 signs takes three
MAX_SESSION_WALL_S: Final = 120.0  # that a session outlives its connection
MAX_SUBSCRIPTION_COUNT: Final = 60
MAX_SUBSCRIPTION_OF_ONE_COUNT: Final = 10
MAX_ITEM_COUNT: Final = 500  # monitored items in one call; the whole cell has some hundred nodes
MAX_QUEUE_COUNT: Final = 1_000  # events that wait for a client that is slow
MIN_PUBLISHING_MS: Final = 50.0
MAX_CALL_COUNT: Final = 8  # calls of one connection that wait for their answer
MAX_UNREAD_BYTES: Final = 4_000_000  # answers that a client asks for and does not read

account: ContextVar[str] = ContextVar("account", default="")
"""Name of the account whose call is being answered."""

_ALLOWED: Final = frozenset(
    ua.NodeId(getattr(ua.ObjectIds, f"{name}Request_Encoding_DefaultBinary"))
    for name in (
        "Read", "Write", "Browse", "TranslateBrowsePathsToNodeIds", "RegisterNodes",
        "UnregisterNodes", "CreateSubscription", "ModifySubscription", "DeleteSubscriptions",
        "CreateMonitoredItems", "ModifyMonitoredItems", "DeleteMonitoredItems",
        "SetMonitoringMode", "SetPublishingMode", "Publish", "Republish", "Call",
    )
)  # fmt: skip
_CREATE_SESSION: Final = ua.NodeId(ua.ObjectIds.CreateSessionRequest_Encoding_DefaultBinary)
_ACTIVATE: Final = ua.NodeId(ua.ObjectIds.ActivateSessionRequest_Encoding_DefaultBinary)
_CALL: Final = ua.NodeId(ua.ObjectIds.CallRequest_Encoding_DefaultBinary)
_REGISTER: Final = (
    ua.NodeId(ua.ObjectIds.RegisterServerRequest_Encoding_DefaultBinary),
    ua.NodeId(ua.ObjectIds.RegisterServer2Request_Encoding_DefaultBinary),
)


class _Rights(PermissionRuleset):
    """What a session may ask for. Writes are answered, each with a refusal."""

    def check_validity(self, user: User, action_type: ua.NodeId, body: Any) -> bool:
        """Return whether a plant account may use a service."""
        return user.role == UserRole.User and action_type in _ALLOWED


class Names(UserManager):
    """Names and passwords.

    Parameters
    ----------
    may_enter : whether an account has a password; slow, called in a thread
    """

    def __init__(self, may_enter: Callable[[str, str], bool]) -> None:
        self._may_enter = may_enter
        self._attempts = Attempts()
        self._turn = asyncio.Lock()
        self._let_in: tuple[str, str] | None = None

    async def check(self, name: str, password: str, client: str) -> None:
        """Check a name and a password before asyncua asks for them.

        Parameters
        ----------
        name, password : as they came
        client : what the client is known by, for the limit on failed attempts
        """
        async with self._turn:
            self._let_in = None
            wait_s = self._attempts.seconds_to_wait(client)
            if wait_s > 0:
                log.warning("OPC UA: too many failed log-ins, wait %.0f s", wait_s)
                return
            self._attempts.note(client)
            try:
                is_known = await asyncio.to_thread(self._may_enter, name, password)
            except PlantError as error:
                log.warning("OPC UA: nobody can log in: %s", error)
                return
            if is_known:
                self._attempts.forgive(client)
                self._let_in = (name, password)
            else:
                log.warning("OPC UA: log-in of %.40r refused", name)

    def get_user(
        self,
        iserver: InternalServer,
        username: str | None = None,
        password: str | None = None,
        certificate: Any = None,
    ) -> User | None:
        """Return the user that `check` has let in just now.

        Parameters
        ----------
        iserver : the server that asks
        username, password : as they came
        certificate : of the channel, which was checked when it was opened
        """
        let_in, self._let_in = self._let_in, None
        if let_in is None or let_in != (username, password):
            return None
        return User(role=UserRole.User, name=username)


class _Session(InternalSession):
    """A session of a client."""

    def __init__(self, *args: Any, **fields: Any) -> None:
        super().__init__(*args, **fields)
        if self.external:
            self.iserver.unregister_external_session(self)
            self.auth_token = ua.NodeId(secrets.token_bytes(32))
            self.iserver.register_external_session(self)

    def _own(self, ids: list[int]) -> list[int]:
        """Return subscriptions' numbers, with 0, which none has, for those of others."""
        known = self.subscription_service.subscriptions
        return [i if i in known and known[i].session_id == self.session_id else 0 for i in ids]

    def _require_own(self, subscription: int) -> None:
        if self._own([subscription]) == [0]:
            raise ServiceError(ua.StatusCodes.BadSubscriptionIdInvalid)

    async def write(self, params: ua.WriteParameters) -> list[ua.StatusCode]:
        """Refuse each write of a client: what is to be done has a method."""
        if not self.external:
            return await super().write(params)
        denied = ua.StatusCode(ua.StatusCodes.BadUserAccessDenied)
        return [denied for _ in params.NodesToWrite]

    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        """Call methods in the name of the account."""
        mark = account.set(self.user.name or "")
        try:
            return await super().call(params)
        finally:
            account.reset(mark)

    async def create_subscription(
        self,
        params: ua.CreateSubscriptionParameters,
        callback: Callable[..., Any],
        request_callback: Callable[..., Any] | None = None,
    ) -> ua.CreateSubscriptionResult:
        """Subscribe, within limits."""
        subscriptions = self.subscription_service.subscriptions.values()
        own = sum(1 for one in subscriptions if one.session_id == self.session_id)
        if self.external and own >= MAX_SUBSCRIPTION_OF_ONE_COUNT:
            raise ServiceError(ua.StatusCodes.BadTooManySubscriptions)
        if not params.RequestedPublishingInterval >= MIN_PUBLISHING_MS:  # NaN, too
            params.RequestedPublishingInterval = MIN_PUBLISHING_MS
        return await super().create_subscription(params, callback, request_callback)

    async def create_monitored_items(
        self, params: ua.CreateMonitoredItemsParameters
    ) -> list[ua.MonitoredItemCreateResult]:
        """Add items to a subscription of this session."""
        self._require_own(params.SubscriptionId)
        service = self.subscription_service.subscriptions[params.SubscriptionId]
        known = len(service.monitored_item_srv._monitored_items)  # noqa: SLF001 - no public count
        if known + len(params.ItemsToCreate) > MAX_ITEM_COUNT:
            raise ServiceError(ua.StatusCodes.BadTooManyMonitoredItems)
        return await super().create_monitored_items(params)

    async def modify_monitored_items(
        self, params: ua.ModifyMonitoredItemsParameters
    ) -> list[ua.MonitoredItemModifyResult]:
        """Change items of a subscription of this session."""
        self._require_own(params.SubscriptionId)
        return await super().modify_monitored_items(params)

    async def delete_monitored_items(
        self, params: ua.DeleteMonitoredItemsParameters
    ) -> list[ua.StatusCode]:
        """Remove items of a subscription of this session."""
        self._require_own(params.SubscriptionId)
        return await super().delete_monitored_items(params)

    async def set_monitoring_mode(self, params: ua.SetMonitoringModeParameters) -> list[Any]:
        """Set the mode of items of a subscription of this session."""
        self._require_own(params.SubscriptionId)
        return await super().set_monitoring_mode(params)

    async def set_publishing_mode(self, params: ua.SetPublishingModeParameters) -> list[Any]:
        """Set the mode of subscriptions of this session."""
        params.SubscriptionIds = self._own(params.SubscriptionIds)
        return await super().set_publishing_mode(params)

    async def delete_subscriptions(self, ids: list[int]) -> list[ua.StatusCode]:
        """End subscriptions of this session."""
        return await super().delete_subscriptions(self._own(ids))

    def republish(self, params: ua.RepublishParameters) -> ua.NotificationMessage:
        """Send a message of a subscription of this session again."""
        self._require_own(params.SubscriptionId)
        return super().republish(params)

    def publish(self, acks: Any = None) -> tuple[int, list[ua.StatusCode]]:
        """Take acknowledgements of this session's messages."""
        acks = list(acks or ())
        own = self._own([ack.SubscriptionId for ack in acks])
        for ack, number in zip(acks, own, strict=True):
            ack.SubscriptionId = number
        return super().publish(acks)


class _Inside(InternalServer):
    """asyncua's inner server with the limits and sessions of this door."""

    def __init__(self, names: Names) -> None:
        super().__init__(user_manager=names)
        self.node_mgt_service = LeanNodes(self.aspace)
        self.names = names
        self.allow_remote_admin = False
        self.supported_tokens = (ua.UserNameIdentityToken,)
        self.max_connections = MAX_CONNECTION_COUNT
        self.max_pending_activation_seconds = MAX_UNNAMED_WALL_S
        self.max_session_timeout_ms = MAX_SESSION_WALL_S * 1e3
        self.max_subscriptions = MAX_SUBSCRIPTION_COUNT
        self.max_monitored_item_queue_size = MAX_QUEUE_COUNT
        self.max_unacked_messages_per_subscription = MAX_QUEUE_COUNT

    def create_session(
        self, name: str, user: User | None = None, external: bool = False
    ) -> InternalSession:
        """Return a new session."""
        return _Session(
            self,
            self.aspace,
            self.subscription_service,
            name,
            user=user or User(role=UserRole.Anonymous),
            external=external,
        )

    def decrypt_user_token(
        self,
        isession: Any,
        token: ua.UserNameIdentityToken,
    ) -> tuple[str, str]:
        """Return name and password of a token. One padded by PKCS#1 v1.5 is not looked at."""
        if str(token.EncryptionAlgorithm or "").endswith("#rsa-1_5"):
            raise ServiceError(ua.StatusCodes.BadIdentityTokenInvalid)
        return super().decrypt_user_token(isession, token)


class _Processor(UaProcessor):
    """The services of one connection."""

    iserver: _Inside

    def __init__(self, *args: Any, **fields: Any) -> None:
        super().__init__(*args, **fields)
        self._calls: set[asyncio.Task[bool]] = set()

    async def process(self, header: ua.Header, body: Buffer) -> bool:
        """Take one chunk; until somebody has logged in, a message is one chunk."""
        is_named = self.session is not None and self.session.is_activated()
        if header.ChunkType == ua.ChunkType.Intermediate and not is_named:
            raise ServiceError(ua.StatusCodes.BadRequestTooLarge)
        return bool(await super().process(header, body))

    async def process_message(self, seqhdr: ua.SequenceHeader, body: Buffer) -> bool:
        """Answer one message, if this connection may send it."""
        ahead = body.copy()
        service = nodeid_from_binary(ahead)
        request: ua.RequestHeader = struct_from_binary(ua.RequestHeader, ahead)
        try:
            await self._require_right(service, request, ahead)
        except ServiceError as error:
            fault = ua.ServiceFault()
            fault.ResponseHeader.ServiceResult = ua.StatusCode(error.code)
            self.send_response(request.RequestHandle, seqhdr, fault)
            return True
        if service == _CALL:
            # what has begun ends, though its client has gone
            call = asyncio.create_task(super().process_message(seqhdr, body))
            self._calls.add(call)
            call.add_done_callback(self._calls.discard)
            return True
        return bool(await super().process_message(seqhdr, body))

    async def _require_right(
        self, service: ua.NodeId, request: ua.RequestHeader, body: Buffer
    ) -> None:
        policy = self._connection.security_policy
        if service == _CALL and len(self._calls) >= MAX_CALL_COUNT:
            raise ServiceError(ua.StatusCodes.BadTooManyOperations)
        if service in _REGISTER:
            raise ServiceError(ua.StatusCodes.BadServiceUnsupported)
        if service in (_CREATE_SESSION, _ACTIVATE) and isinstance(policy, SecurityPolicyNone):
            raise ServiceError(ua.StatusCodes.BadSecurityModeInsufficient)
        if service == _CREATE_SESSION:
            if self.session is not None:
                raise ServiceError(ua.StatusCodes.BadTooManySessions)
            params = struct_from_binary(ua.CreateSessionParameters, body)
            named = leaf(params.ClientCertificate or b"")
            if named and named != leaf(policy.peer_certificate):
                raise ServiceError(ua.StatusCodes.BadCertificateInvalid)
        if service == _ACTIVATE:
            await self._check_name(request, struct_from_binary(ua.ActivateSessionParameters, body))

    async def _check_name(
        self, request: ua.RequestHeader, params: ua.ActivateSessionParameters
    ) -> None:
        session = self.session or self.iserver.lookup_external_session(request.AuthenticationToken)
        token = params.UserIdentityToken
        if session is None or not isinstance(token, ua.UserNameIdentityToken):
            return  # asyncua refuses these
        try:
            name, password = self.iserver.decrypt_user_token(session, token)
        except (ValueError, UnicodeDecodeError, ua.UaError):
            return
        if session.is_activated() and session.user.name != name:
            raise ServiceError(ua.StatusCodes.BadIdentityTokenRejected)
        client = sha256(self._connection.security_policy.peer_certificate).hexdigest()
        await self.iserver.names.check(name, password, client)


class _Seldom:
    """Writes a line to the log at most every so often: strangers must not fill it."""

    def __init__(self) -> None:
        self._last_s = float("-inf")
        self._kept_back = 0

    def warn(self, text: str) -> None:
        """Write a line, or count it."""
        now_s = time.monotonic()
        if now_s - self._last_s < WARN_WALL_S:
            self._kept_back += 1
            return
        more = f" ({self._kept_back} more like this)" if self._kept_back else ""
        self._last_s, self._kept_back = now_s, 0
        log.warning("%s%s", text, more)


_seldom: Final = _Seldom()


class _Protocol(OPCUAProtocol):
    """One connection; it is closed at the first message that cannot be read."""

    processor: _Processor | None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin."""
        super().connection_made(transport)
        if self.processor is not None:
            self.processor = _Processor(self.iserver, self.transport, self.limits)
            self.processor.set_policies(self.policies)

    def data_received(self, data: bytes) -> None:
        """Take bytes; no more than one chunk waits for its end."""
        super().data_received(data)
        if len(self._buffer) > MAX_CHUNK_BYTES:
            self._close(ua.StatusCodes.BadTcpMessageTooLarge, "a chunk is too large")
        session = self.processor.session if self.processor is not None else None
        is_named = session is not None and session.is_activated()
        if not is_named and self.messages.qsize() > MAX_UNNAMED_MESSAGE_COUNT:
            self._close(ua.StatusCodes.BadTcpServerTooBusy, "too many messages before a log-in")

    async def _process_one_msg(self, header: Any, buf: Buffer) -> bool:
        try:
            goes_on = bool(await super()._process_one_msg(header, buf))
            if self.transport is None or self.transport.get_write_buffer_size() < MAX_UNREAD_BYTES:
                return goes_on
            log.warning("OPC UA: a client at %s does not read its answers", self.peer_name)
            self.transport.abort()
        except NotTrustedError as error:
            _seldom.warn(f"OPC UA: a client at {self.peer_name} is turned away: {error}")
            self._close(ua.StatusCodes.BadSecurityChecksFailed, "not trusted")
        except Exception as error:  # noqa: BLE001 - whatever a stranger's bytes set off
            log.info("OPC UA: connection of %s is closed: %s", self.peer_name, error)
            self._close(ua.StatusCodes.BadTcpInternalError, "not understood")
        return False

    def _close(self, code: int, why: str) -> None:
        self._buffer = b""
        if self.transport is not None and not self.transport.is_closing():
            error = ua.ErrorMessage(ua.StatusCode(code), why)
            self.transport.write(uatcp_to_binary(ua.MessageType.Error, error))
            self.transport.close()


class _Listener(BinaryServer):
    """The listening socket."""

    def _make_protocol(self) -> _Protocol:
        return _Protocol(
            iserver=self.iserver,
            policies=self._policies,
            clients=self.clients,
            closing_tasks=self.closing_tasks,
            limits=self.limits,
        )


class NotTrustedError(Exception):
    """A client's certificate is not trusted; says why."""


class _TrustingFactory(SecurityPolicyFactory):
    """Makes the encryption of a channel, for trusted certificates."""

    def __init__(self, folder: CertificateFolder, *args: Any, **fields: Any) -> None:
        super().__init__(*args, **fields)
        self._folder = folder

    def create(self, peer_certificate: bytes | None) -> Any:
        """Return the encryption of a channel.

        Raises
        ------
        NotTrustedError : the client's certificate is not trusted
        """
        if refusal := self._folder.refusal(peer_certificate):
            raise NotTrustedError(refusal)
        return super().create(peer_certificate)


class DoorServer(Server):
    """asyncua's server behind this door.

    Parameters
    ----------
    names : who may log in
    folder : certificates
    """

    def __init__(self, names: Names, folder: CertificateFolder) -> None:
        super().__init__(iserver=_Inside(names))
        self._folder = folder
        self.set_security_policy(list(POLICIES), permission_ruleset=_Rights())
        self.limits = TransportLimits(
            max_recv_buffer=MAX_CHUNK_BYTES,
            max_send_buffer=MAX_CHUNK_BYTES,
            max_chunk_count=MAX_CHUNK_COUNT,
            max_message_size=MAX_CHUNK_COUNT * MAX_CHUNK_BYTES,
        )

    async def start(self) -> None:
        """Listen.

        Raises
        ------
        OSError : the port is taken, or the address is not this computer's
        """
        await self._setup_server_nodes()
        self._policies = [
            _TrustingFactory(
                self._folder,
                *SECURITY_POLICY_TYPE_MAP[policy][:2],
                self.iserver.certificate,
                self.iserver.private_key,
                permission_ruleset=self._permission_ruleset,
            )
            for policy in POLICIES
        ]
        await self.iserver.start()
        host, port = self._get_bind_socket_info()
        self.bserver = _Listener(self.iserver, host or "127.0.0.1", port or 0, self.limits)
        self.bserver.set_policies(self._policies)
        await self.bserver.start()
