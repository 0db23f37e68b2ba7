"""An OPC UA server before a cell in memory, and asyncua's client of it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import NameOID
from fake_plant import FakePlant, idle_state

from controller.config.cell.connect import OpcuaSection
from controller.plant.model import CellState
from controller.plant.wires.opcua import OpcuaWire
from controller.plant.wires.opcua.space import MACHINE_VISION

RUN = "20261128-101500-123-holder"
PASSWORD = "correct horse battery"
# answers come at once; a machine of many runs takes its time
ANSWER_WALL_S = 300.0


def make_certificate(
    folder: Path, name: str, *, days: int = 30, bits: int = 2048
) -> tuple[Path, Path]:
    """Return the files of a new certificate (DER) and its key (PEM)."""
    key = rsa.generate_private_key(public_exponent=65537, key_size=bits)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    began = datetime.now(UTC) - timedelta(days=10)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(began)
        .not_valid_after(datetime.now(UTC) + timedelta(days=days))
        .add_extension(
            x509.SubjectAlternativeName([x509.UniformResourceIdentifier(f"urn:test:{name}")]),
            critical=False,
        )
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    folder.mkdir(parents=True, exist_ok=True)
    to = (folder / f"{name}.der", folder / f"{name}.pem")
    to[0].write_bytes(certificate.public_bytes(serialization.Encoding.DER))
    to[1].write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )
    return to


class Bench:
    """A served cell in memory, with one trusted client certificate.

    Attributes
    ----------
    plant : the cell
    wire : what serves it
    folder : certificates of the server
    trusted : files of a certificate that the server trusts, and of its key
    """

    def __init__(self, folder: Path) -> None:
        self.plant = FakePlant()
        self.folder = folder / "opcua"
        section = OpcuaSection(listen="127.0.0.1:0", folder=Path("opcua"))
        self.wire = OpcuaWire(section, folder)
        self.trusted = make_certificate(folder / "clients", "mes")
        trust = self.folder / "trusted"
        trust.mkdir(parents=True)
        (trust / "mes.der").write_bytes(self.trusted[0].read_bytes())

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[Bench]:
        """Serve within a block."""
        task = asyncio.create_task(self.wire.serve(self.plant))
        try:
            async with asyncio.timeout(ANSWER_WALL_S):
                while not self.wire.url:
                    await asyncio.sleep(0.01)
                    if task.done():
                        task.result()
            yield self
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def fresh(self) -> Bench:
        """Forget what an earlier test did."""
        vision = self.wire._vision
        assert vision is not None
        self.plant.results.clear()
        self.plant.told.clear()
        self.plant._orders.clear()
        vision._job = None
        vision._keep(prepared=None, prepared_sha256="", is_halted=False)
        await self.become(self.plant_idle())
        return self

    def plant_idle(self, **changes: Any) -> CellState:
        """Return the state of a cell without a run."""
        return idle_state(**changes)

    async def become(self, state: CellState) -> None:
        """Change the state of the cell, and wait until it is shown."""
        vision = self.wire._vision
        assert vision is not None
        await self.plant.become(**dict(state))
        await vision.cell_changed(state)

    async def run(self, order: str | None, count: int = 1, **changes: Any) -> CellState:
        """Have the cell run."""
        fields = {
            "state": "execute_acquiring", "packml": "Execute", "run": RUN, "recipe": "holder",
            "order": order, "part": 1, "done": {"holder": (0, count)},
        }  # fmt: skip
        state = idle_state(**{**fields, **changes})
        await self.become(state)
        return state

    async def client(
        self,
        *,
        name: str | None = "mes",
        password: str = PASSWORD,
        files: tuple[Path, Path] | None = None,
        policy: type = SecurityPolicyBasic256Sha256,
        mode: ua.MessageSecurityMode = ua.MessageSecurityMode.SignAndEncrypt,
    ) -> Client:
        """Return a client that is not connected yet."""
        certificate, key = files or self.trusted
        client = Client(self.wire.url, timeout=ANSWER_WALL_S, watchdog_intervall=ANSWER_WALL_S)
        client.application_uri = f"urn:test:{certificate.stem}"
        await client.set_security(policy, certificate, key, mode=mode)
        if name is not None:
            client.set_user(name)
            client.set_password(password)
        return client


class Vision:
    """The vision system, as a client calls it."""

    def __init__(self, client: Client, node: Any, namespace: int) -> None:
        self.client = client
        self.node = node
        self.namespace = namespace

    @classmethod
    async def found(cls, client: Client) -> Vision:
        """Return the vision system in the folder of machines."""
        namespace = await client.get_namespace_index(MACHINE_VISION)
        for node in await client.nodes.objects.get_children():
            kind = await node.read_type_definition()
            if kind == ua.NodeId(1003, namespace):
                return cls(client, node, namespace)
        raise LookupError("no vision system")

    async def child(self, path: str) -> Any:
        """Return a node by its path; names of Machine Vision if they have no number."""
        names = [n if ":" in n else f"{self.namespace}:{n}" for n in path.split("/")]
        return await self.node.get_child(names)

    async def call(self, path: str, *arguments: Any) -> Any:
        """Call a method; every argument has its own type in OPC UA."""
        on, _, method = path.rpartition("/")
        node = await self.child(on) if on else self.node
        return await node.call_method(f"{self.namespace}:{method}", *arguments)

    async def state(self) -> tuple[str, str | None]:
        """Return the states of both machines."""
        outer = await self.child("VisionStateMachine/0:CurrentState")
        inner = await self.child("VisionStateMachine/AutomaticModeStateMachine/0:CurrentState")
        value = await inner.read_data_value(raise_on_bad_status=False)
        below = value.Value.Value if value.StatusCode.is_good() else None
        return (await outer.read_value()).Text, below.Text if below else None


class Heard:
    """Events, as a client gets them."""

    def __init__(self) -> None:
        self._queue: asyncio.Queue[Any] = asyncio.Queue()
        self.all: list[Any] = []

    def event_notification(self, event: Any) -> None:
        self._queue.put_nowait(event)

    async def of(self, kind: int, *, wall_s: float = ANSWER_WALL_S) -> Any:
        """Return the next event of a type, by its number."""
        async with asyncio.timeout(wall_s):
            while True:
                event = await self._queue.get()
                self.all.append(event)
                if event.EventType.Identifier == kind:
                    return event
