"""OPC UA as a wire to the plant: a server of one cell, and the courier of its results."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from asyncua import ua

from controller.config.cell.connect import OpcuaSection
from controller.config.cell.values import host_and_port
from controller.memory import give_back
from controller.plant.model import AlarmNotice, Notice, OrderState
from controller.plant.plant import Plant

from ..tasks import together
from .certificates import CertificateFolder
from .door import DoorServer, Names
from .events import Events
from .methods import link
from .space import CellSpace, instance_uri, load_types
from .vision import VisionSystem

log = logging.getLogger(__name__)

PRODUCT: Final = "urn:cellctl"


class OpcuaWire:
    """A server of OPC 40100-1 for one cell.

    Parameters
    ----------
    section : where it listens; port 0 for any that is free
    folder : folder of the cell file, from which its files are named
    """

    name = "opcua"

    def __init__(self, section: OpcuaSection, folder: Path) -> None:
        self._host, self._port = host_and_port(section.listen)
        self._hosts = tuple(dict.fromkeys((self._host, *section.names)))
        self._folder = folder / section.folder
        self._vision: VisionSystem | None = None
        self.url = ""

    async def serve(self, plant: Plant) -> None:
        """Serve until cancelled.

        Raises
        ------
        CertificateError : the server's own certificate does not do
        OSError : the address is taken, or is not this computer's
        """
        changes = plant.order_changes()  # asked for first, so that none is missed
        async with self.serving(plant) as vision, together() as tasks:
            tasks.create_task(_follow_orders(changes, vision))
            async for cell in plant.states():
                await vision.cell_changed(cell)

    @asynccontextmanager
    async def serving(self, plant: Plant) -> AsyncIterator[VisionSystem]:
        """Yield the vision system, served within a block, without following the cell."""
        quiet = logging.getLogger("asyncua")
        if quiet.level == logging.NOTSET:
            # it logs each bad message of a stranger with its traceback; `door.py` says it in a line
            quiet.setLevel(logging.CRITICAL)
        uri = instance_uri(plant.cell)
        folder = CertificateFolder(self._folder)
        certificate, key = await asyncio.to_thread(folder.own, uri, self._hosts)
        server = DoorServer(Names(plant.may_enter), folder)
        await load_types(server)
        await server.set_application_uri(uri)
        server.set_server_name(f"cellctl {plant.cell}")
        server.product_uri = PRODUCT
        server.application_type = ua.ApplicationType.Server
        await server.set_build_info(
            PRODUCT, "cellctl", "cellctl", plant.software, plant.software, datetime.now(UTC)
        )
        server.iserver.certificate, server.iserver.private_key = certificate, key
        server.set_endpoint(f"opc.tcp://{_in_url(self._host)}:{self._port}/cellctl")
        space = await CellSpace.made(server, plant.cell, plant.software, plant.cell_file_sha256)
        vision = VisionSystem(
            plant, space, await Events.made(server, space), self._folder / "kept.json"
        )
        await vision.begin()
        await link(server, space, vision)
        await server.start()
        give_back()  # the files that the address space was read from
        try:
            self._vision = vision
            port = server.bserver.port if server.bserver else self._port
            self.url = f"opc.tcp://{_in_url(self._host)}:{port}/cellctl"
            log.info("OPC UA: %s", self.url)
            yield vision
        finally:
            self._vision = None
            await server.stop()

    async def deliver(self, notice: Notice) -> None:
        """Raise the event of a notice. Whoever is not there asks for the list of results later.

        Raises
        ------
        ConnectionError : the server is not up
        """
        vision = self._vision
        if vision is None:
            raise ConnectionError("the OPC UA server is not up")
        if isinstance(notice, AlarmNotice):
            await vision.alarmed(notice)
        else:
            await vision.finished(notice)


async def _follow_orders(changes: AsyncIterator[OrderState], vision: VisionSystem) -> None:
    async for order in changes:
        await vision.order_changed(order)


def _in_url(host: str) -> str:
    return f"[{host}]" if ":" in host else host
