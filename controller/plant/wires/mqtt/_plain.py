"""The cell on MQTT in plain JSON: what it tells on which topic, and the one thing that it takes in.

    PREFIX/state           QoS 1, retained    cellctl.state/1; the will says `"online": false`
    PREFIX/order           QoS 1, retained    cellctl.order/1, the order that changed last
    PREFIX/part            QoS 1              cellctl.part/1, by the outbox: each at least once
    PREFIX/part/last       QoS 1, retained    the newest of these
    PREFIX/alarm           QoS 1              cellctl.alarm/1, by the outbox
    PREFIX/cmd/order       taken in           an order and its number, one JSON object
    PREFIX/cmd/order/reply QoS 1              the answer: cellctl.order/1, or number and refusal

An order is taken from a broker alone that asks who this cell is: one that lets anybody in would let
anybody order.
"""

import asyncio
import logging
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from pydantic import ValidationError

from controller.config.cell.mqtt import MqttSection

from ...model import (
    CellState,
    Notice,
    OrderMessage,
    OrderRefusal,
    OrderState,
    PartResult,
    Payload,
    first_wrong,
)
from ...plant import Plant, PlantError, RejectedError
from ..tasks import together
from ._link import Access, BrokerLink, Message, connected

log = logging.getLogger(__name__)

PREFIX: Final = "cellctl/v1/{cell}"
# Connections that one notice may end before it is put aside: a broker cuts off who sends what is
# too large for it, and would do so for ever; that it dies by chance five times within the same
# milliseconds does not happen.
MAX_CUTS: Final = 5


def as_json(payload: Payload) -> bytes:
    """Return a payload as it stands on the wire."""
    return payload.model_dump_json(by_alias=True).encode()


def offline_state(cell: str) -> CellState:
    """Return what others say of the cell once the bridge is gone; `at` is when it came."""
    return CellState(
        cell=cell,
        at=datetime.now(UTC),
        online=False,
        state="unknown",
        packml="Stopped",
        message="cellctl connect is not connected to the broker",
    )


class MqttWire:
    """The courier to a broker."""

    name = "mqtt"

    def __init__(self, settings: MqttSection, folder: Path) -> None:
        self._access = Access(settings, folder)
        self._settings = settings
        self._link: BrokerLink | None = None
        self._is_connected = asyncio.Event()
        self._prefix = ""
        self._cuts: tuple[str, int] = ("", 0)

    async def serve(self, plant: Plant) -> None:
        """Tell the state and orders, take orders in.

        Raises
        ------
        OSError : the broker is not there, refuses, or is gone
        """
        prefix = self._prefix = self._settings.prefix or PREFIX.format(cell=plant.cell)
        will = Message(f"{prefix}/state", as_json(offline_state(plant.cell)), is_retained=True)
        async with connected(self._access, f"cellctl-{plant.cell}", will) as link:
            try:
                async with together() as tasks:
                    tasks.create_task(self._take(link, plant))
                    tasks.create_task(self._tell_states(link, plant))
                    tasks.create_task(self._tell_orders(link, plant))
                    self._link = link
                    self._is_connected.set()
            finally:
                self._link = None

    async def deliver(self, notice: Notice) -> None:
        """Publish a result or an alarm, once there is a connection; return after the PUBACK.

        Raises
        ------
        RejectedError : the broker never takes this one
        OSError, TimeoutError : it is gone meanwhile, does not take it now, or does not answer
        """
        text = as_json(notice)
        self._require_uncut(notice.key, len(text))
        link = await self._connection()
        try:
            if isinstance(notice, PartResult):
                await link.send(Message(f"{self._prefix}/part", text))
                await link.send(Message(f"{self._prefix}/part/last", text, is_retained=True))
            else:
                await link.send(Message(f"{self._prefix}/alarm", text))
        except ConnectionError:
            last, count = self._cuts
            self._cuts = (notice.key, count + 1 if notice.key == last else 1)
            raise
        self._cuts = ("", 0)

    async def _connection(self) -> BrokerLink:
        """Wait for a connection: `serve` makes it, and begins again without being asked."""
        while self._link is None:
            self._is_connected.clear()
            await self._is_connected.wait()
        return self._link

    def _require_uncut(self, key: str, size: int) -> None:
        if self._cuts == (key, MAX_CUTS):
            raise RejectedError(
                f"the broker has cut the connection {MAX_CUTS} times at this message of"
                f" {size} bytes; see its limit of a message's size (max_packet_size)"
            )

    async def _tell_states(self, link: BrokerLink, plant: Plant) -> None:
        async for state in plant.states():
            await self._tell(link, "state", state)

    async def _tell_orders(self, link: BrokerLink, plant: Plant) -> None:
        changes = plant.order_changes()  # asked for first, so that none is missed
        orders = await plant.orders()
        if orders:
            await self._tell(link, "order", max(orders, key=lambda order: order.changed))
        async for order in changes:
            await self._tell(link, "order", order)

    async def _tell(self, link: BrokerLink, topic: str, payload: Payload) -> None:
        """Tell something retained; a broker that does not take it hinders nothing else."""
        await _send_or_warn(
            link, Message(f"{self._prefix}/{topic}", as_json(payload), is_retained=True)
        )

    async def _take(self, link: BrokerLink, plant: Plant) -> None:
        topic = f"{self._prefix}/cmd/order"
        if self._settings.is_known:
            try:
                await link.listen(topic)
            except ConnectionError:
                raise
            except OSError as error:
                log.warning("MQTT: no orders are taken: %s", error)
        else:
            log.warning(
                "MQTT: no orders are taken: the broker lets anybody in; give `user` and"
                " `password_file`, or a certificate"
            )
        async for message in link.received():
            if message.topic.value == topic and not message.retain:
                await self._answer(link, message, await self._order(message.payload, plant))

    async def _order(self, payload: object, plant: Plant) -> OrderState | OrderRefusal:
        number = None
        try:
            command = OrderMessage.model_validate_json(payload)  # type: ignore[arg-type]
            number = command.number
            return await plant.order(number, command.request(), "MQTT")
        except ValidationError as error:
            reason = first_wrong(error)
        except PlantError as error:
            reason = str(error)
        return OrderRefusal(cell=plant.cell, number=number, reason=reason)

    async def _answer(
        self, link: BrokerLink, message: aiomqtt.Message, answer: OrderState | OrderRefusal
    ) -> None:
        own = f"{self._prefix}/cmd/order/reply"
        topic, properties = own, Properties(PacketTypes.PUBLISH)
        asked = message.properties
        if (data := getattr(asked, "CorrelationData", None)) is not None:
            properties.CorrelationData = data
        wanted = getattr(asked, "ResponseTopic", None)
        if wanted and self._may_reply_to(wanted, own):
            topic = wanted
        await _send_or_warn(link, Message(topic, as_json(answer)), properties)

    def _may_reply_to(self, topic: str, own: str) -> bool:
        """Whether an answer may go there: nobody has this cell write where it does not write."""
        if any(sign in topic for sign in "+#\0"):
            return False
        return any(
            topic == allowed or topic.startswith(f"{allowed}/")
            for allowed in (own, *self._settings.reply_to)
        )


async def _send_or_warn(
    link: BrokerLink, message: Message, properties: Properties | None = None
) -> None:
    """Publish what may be missed; a connection that is gone still ends the wire."""
    try:
        await link.send(message, properties)
    except (ConnectionError, TimeoutError):
        raise
    except (OSError, RejectedError) as error:
        log.warning("MQTT: %s", error)
