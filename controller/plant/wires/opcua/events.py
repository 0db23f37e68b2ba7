"""The events of OPC 40100-1: each is raised at the vision system and at the server.

Clients subscribe at either node. asyncua takes the type of a field from an empty property of the
event's type, and sends null where that says BaseDataType or a subtype of Int32: each field has its
type from here.
"""

from collections.abc import Mapping
from typing import Any, Final

from asyncua import Server, ua
from asyncua.server.event_generator import EventGenerator

from .space import CellSpace

# OPC 40100-1, 8.2.9, 8.3.8 and 11.3: events by name, with the number of the type
TYPES: Final[Mapping[str, int]] = {
    "StateChanged": 1018,
    "Error": 1019,
    "ErrorResolved": 1020,
    "RecipePrepared": 1022,
    "JobStarted": 1013,
    "Ready": 1023,
    "ResultReady": 1024,
    "Information": 1038,
}
# OPC 10000-5: 1 to 1000, urgent last
SEVERITY: Final[Mapping[str, int]] = {"Error": 800, "Information": 400}
USUAL_SEVERITY: Final = 200

_SERVER: Final = ua.NodeId(ua.ObjectIds.Server)
_OF: Final[Mapping[type, ua.VariantType]] = {
    bool: ua.VariantType.Boolean,
    str: ua.VariantType.String,
    list: ua.VariantType.Variant,
    ua.NodeId: ua.VariantType.NodeId,
    ua.LocalizedText: ua.VariantType.LocalizedText,
    int: ua.VariantType.Int32,
}


class Events:
    """Raises events; made by `made`."""

    def __init__(self, server: Server, space: CellSpace) -> None:
        self._server = server
        self._vision = space.vision
        self._generators: dict[str, EventGenerator] = {}

    @classmethod
    async def made(cls, server: Server, space: CellSpace) -> "Events":
        """Return what raises the events of a cell."""
        events = cls(server, space)
        for name, number in TYPES.items():
            events._generators[name] = await server.get_event_generator(
                ua.NodeId(number, space.namespace), space.vision.nodeid
            )
        return events

    async def raised(
        self, kind: str, message: str, fields: Mapping[str, Any] | None = None
    ) -> None:
        """Raise an event.

        Parameters
        ----------
        kind : a key of `TYPES`
        message : a sentence
        fields : values by browse name; None is sent as null
        """
        generator = self._generators[kind]
        event = generator.event
        event.Severity = SEVERITY.get(kind, USUAL_SEVERITY)
        for name, value in (fields or {}).items():
            event.add_property(name, value, _OF.get(type(value), _type_of(value)))
        await generator.trigger(message=message)
        # whoever subscribes at the server gets the events of the whole server (OPC 10000-3, 4.6)
        event.emitting_node = _SERVER
        try:
            await self._server.iserver.subscription_service.trigger_event(event)
        finally:
            event.emitting_node = self._vision.nodeid


def _type_of(value: Any) -> ua.VariantType:
    return ua.Variant(value).VariantType if value is not None else ua.VariantType.Null
