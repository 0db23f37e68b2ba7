"""The cell on MQTT as an edge node of Sparkplug B 3.0: what tools discover by themselves.

A mirror: DATA has QoS 0 by the specification, so results that must arrive go by `_plain`. Nothing
is taken in but the wish for a rebirth, and the word of a primary host that it is there.
"""

import asyncio
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from controller.config.cell.mqtt import MqttSection, SparkplugSection

from ...model import Notice, PartResult
from ...plant import Plant, PlantError
from ..tasks import together
from ._link import Access, BrokerLink, connected
from .node import NAMESPACE, EdgeNode, as_ms, came_about, notice_values, state_values
from .payload import Value

# From births to the next ones: whoever asks more often gets one answer to all that he asked.
BIRTH_PAUSE_S: Final = 1.0
MAX_STATE_BYTES: Final = 1000


class HostGoneError(ConnectionError):
    """The primary host is no longer there: the node leaves, and waits for it."""


class SparkplugWire:
    """The node's connection: a courier that mirrors."""

    name = "sparkplug"

    def __init__(self, settings: MqttSection, sparkplug: SparkplugSection, folder: Path) -> None:
        self._access = Access(settings, folder)
        self._settings = sparkplug
        self.node: EdgeNode | None = None
        self._plant: Plant | None = None
        self._link: BrokerLink | None = None
        self._speaking = asyncio.Lock()
        self._birth_due = asyncio.Event()
        self._is_born = asyncio.Event()
        self._host_ms = 0

    async def serve(self, plant: Plant) -> None:
        """Be born once the primary host is there, tell the state, be born again when asked.

        Raises
        ------
        HostGoneError : the primary host is gone
        OSError : the broker is not there, refuses, or is gone
        """
        settings = self._settings
        if self.node is None:
            self.node = EdgeNode(settings.group, settings.node or plant.cell, settings.device)
            self.node.note({"Properties/Software": plant.software}, _now_ms())
        node, self._plant = self.node, plant
        state = await plant.state()
        node.note(state_values(state), as_ms(state.at))
        self._birth_due.clear()
        async with connected(
            self._access, f"cellctl-{plant.cell}-sparkplug", node.connect()
        ) as link:
            try:
                await link.listen(node.command_topic)
                if settings.primary_host is None:
                    self._birth_due.set()
                else:
                    await link.follow(f"{NAMESPACE}/STATE/{settings.primary_host}")
                self._link = link
                async with together() as tasks:
                    tasks.create_task(self._hear(link, node))
                    tasks.create_task(self._bear(link, node))
                    tasks.create_task(self._tell_states(plant, node))
            finally:
                self._link = None
                self._is_born.clear()

    async def deliver(self, notice: Notice) -> None:
        """Mirror a result or an alarm, once the node is born; a result that others follow is old.

        Raises
        ------
        OSError, TimeoutError : the broker is gone meanwhile
        """
        await self._is_born.wait()
        node, plant = self.node, self._plant
        assert node is not None  # since it is born
        assert plant is not None
        old = isinstance(notice, PartResult) and await _is_followed(plant, notice)
        await self._speak(node, notice_values(notice), came_about(notice), is_historical=old)

    async def _tell_states(self, plant: Plant, node: EdgeNode) -> None:
        async for state in plant.states():
            await self._speak(node, state_values(state), state.at)

    async def _speak(
        self,
        node: EdgeNode,
        values: Mapping[str, Value],
        at: datetime,
        *,
        is_historical: bool = False,
    ) -> None:
        async with self._speaking:
            node.note(values, as_ms(at))
            link = self._link
            # with births due no data go out: the births have it all
            if link is None or not self._is_born.is_set() or self._birth_due.is_set():
                return
            message = node.data(_now_ms(), is_historical=is_historical)
            if message is not None:
                await link.send(message)

    async def _bear(self, link: BrokerLink, node: EdgeNode) -> None:
        while True:
            await self._birth_due.wait()
            async with self._speaking:
                self._birth_due.clear()
                for message in node.births(_now_ms()):
                    await link.send(message)
                self._is_born.set()
            await asyncio.sleep(BIRTH_PAUSE_S)

    async def _hear(self, link: BrokerLink, node: EdgeNode) -> None:
        async for message in link.received():
            if message.topic.value == node.command_topic:
                is_live = self._is_born.is_set() and not message.retain
                if is_live and node.is_rebirth(bytes(message.payload)):
                    self._birth_due.set()
            else:
                self._heed(bytes(message.payload))

    def _heed(self, payload: bytes) -> None:
        """Take in what is said of the primary host; what is older than what is known is not."""
        try:
            said = json.loads(payload[:MAX_STATE_BYTES])
            is_online, at_ms = said["online"], said["timestamp"]
        except (ValueError, TypeError, KeyError, RecursionError):
            return
        if type(is_online) is not bool or type(at_ms) is not int or at_ms < self._host_ms:
            return
        if is_online:
            self._host_ms = at_ms
            if not self._is_born.is_set():
                self._birth_due.set()
        elif self._is_born.is_set() or self._birth_due.is_set():
            raise HostGoneError(f"primary host {self._settings.primary_host} is offline")


async def _is_followed(plant: Plant, result: PartResult) -> bool:
    try:
        return bool(await plant.parts(result.seq, 1))
    except PlantError:
        return False


def _now_ms() -> int:
    return as_ms(datetime.now(UTC))
