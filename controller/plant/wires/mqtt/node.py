"""The cell as an edge node of Sparkplug B: births, data by exception, sequence numbers. No I/O.

Source: Sparkplug 3.0.0, chapters 5 and 6; the rules' names (`tck-id-...`) stand at the tests,
tests/plant/test_sparkplug_node.py.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Final

from ...model import AlarmNotice, CellState, Notice, PartResult
from ._link import Message
from .payload import DataType, Metric, PayloadError, SparkplugPayload, Value, decode, encode

NAMESPACE: Final = "spBv1.0"
REBIRTH: Final = "Node Control/Rebirth"
BD_SEQ: Final = "bdSeq"
# What the device tells, each with its type; an alias is a place in this list, from 1.
METRICS: Final[Mapping[str, DataType]] = {
    "State": DataType.STRING,
    "PackML": DataType.STRING,
    "Ready": DataType.BOOLEAN,
    "Message": DataType.STRING,
    "Run": DataType.STRING,
    "Recipe": DataType.STRING,
    "Order/Number": DataType.STRING,
    "Now/Part": DataType.INT32,
    "Now/Serial": DataType.STRING,
    "Counts/Accept": DataType.INT32,
    "Counts/Reject": DataType.INT32,
    "Counts/Quarantine": DataType.INT32,
    "Part/Run": DataType.STRING,
    "Part/Number": DataType.INT32,
    "Part/Revision": DataType.INT32,
    "Part/Order": DataType.STRING,
    "Part/Recipe": DataType.STRING,
    "Part/Serial": DataType.STRING,
    "Part/Ended": DataType.DATE_TIME,
    "Part/Verdict": DataType.STRING,
    "Part/Disposition": DataType.STRING,
    "Part/Json": DataType.STRING,
    "Alarm/Number": DataType.INT32,
    "Alarm/Code": DataType.STRING,
    "Alarm/Change": DataType.STRING,
    "Alarm/Message": DataType.STRING,
    "Properties/Software": DataType.STRING,
    "Properties/Emulated": DataType.BOOLEAN,
}
ALIASES: Final = {name: place for place, name in enumerate(METRICS, 1)}
BD_SEQ_ALIAS: Final = len(METRICS) + 1


def as_ms(at: datetime) -> int:
    """Return milliseconds since 1970, UTC."""
    return int(at.astimezone(UTC).timestamp() * 1000)


def state_values(state: CellState) -> dict[str, Value]:
    """Return what a state says, by metric."""
    return {
        "State": state.state,
        "PackML": state.packml,
        "Ready": state.is_ready,
        "Message": state.message,
        "Run": state.run,
        "Recipe": state.recipe,
        "Order/Number": state.order,
        "Now/Part": state.part,
        "Now/Serial": state.serial,
        "Counts/Accept": state.counts.get("accept", 0),
        "Counts/Reject": state.counts.get("reject", 0),
        "Counts/Quarantine": state.counts.get("quarantine", 0),
        "Properties/Emulated": state.is_emulated,
    }


def notice_values(notice: Notice) -> dict[str, Value]:
    """Return what a result or an alarm says, by metric."""
    if isinstance(notice, AlarmNotice):
        return {
            "Alarm/Number": notice.number,
            "Alarm/Code": notice.code,
            "Alarm/Change": notice.change,
            "Alarm/Message": notice.message,
        }
    return {
        "Part/Run": notice.run,
        "Part/Number": notice.part,
        "Part/Revision": notice.revision,
        "Part/Order": notice.order,
        "Part/Recipe": notice.recipe,
        "Part/Serial": notice.serial,
        "Part/Ended": as_ms(notice.ended),
        "Part/Verdict": notice.verdict,
        "Part/Disposition": notice.disposition,
        "Part/Json": notice.model_dump_json(by_alias=True),
    }


def came_about(notice: Notice) -> datetime:
    """Return when a notice's values came about."""
    return notice.ended if isinstance(notice, PartResult) else notice.at


class EdgeNode:
    """What the node has told and tells next.

    Parameters
    ----------
    group, node, device : its names
    """

    def __init__(self, group: str, node: str, device: str) -> None:
        self._group, self.node, self._device = group, node, device
        self._bd_seq = -1
        self._seq = 0
        self._values: dict[str, tuple[Value, int]] = dict.fromkeys(METRICS, (None, 0))
        self._told: dict[str, tuple[Value, int]] = {}

    @property
    def command_topic(self) -> str:
        """Where commands to the node come in."""
        return self._topic("NCMD")

    def connect(self) -> Message:
        """Return the will of the next connection, NDEATH; each has a number of its own."""
        self._bd_seq = (self._bd_seq + 1) % 256
        metric = Metric(BD_SEQ, None, None, DataType.INT64, self._bd_seq)
        death = SparkplugPayload(as_ms(datetime.now(UTC)), None, (metric,))
        return Message(self._topic("NDEATH"), encode(death), qos=1, is_retained=False)

    def note(self, values: Mapping[str, Value], at_ms: int) -> None:
        """Take in values; what is not new keeps its time."""
        for name, value in values.items():
            if self._values[name][0] != value or not self._values[name][1]:
                self._values[name] = (value, at_ms)

    def births(self, now_ms: int) -> tuple[Message, Message]:
        """Return NBIRTH and DBIRTH: all there is, and the sequence from zero."""
        self._seq = 0
        node = (
            Metric(BD_SEQ, BD_SEQ_ALIAS, now_ms, DataType.INT64, self._bd_seq),
            Metric(REBIRTH, None, now_ms, DataType.BOOLEAN, value=False),
        )
        device = tuple(
            Metric(name, ALIASES[name], at_ms or now_ms, kind, value)
            for name, kind in METRICS.items()
            for value, at_ms in (self._values[name],)
        )
        self._told = dict(self._values)
        return (
            self._message("NBIRTH", now_ms, node),
            self._message("DBIRTH", now_ms, device),
        )

    def data(self, now_ms: int, *, is_historical: bool = False) -> Message | None:
        """Return DDATA with what has changed since it was told; None if nothing has."""
        changed = tuple(
            Metric(None, ALIASES[name], at_ms, METRICS[name], value, is_historical)
            for name, (value, at_ms) in self._values.items()
            if self._told.get(name) != (value, at_ms)
        )
        if not changed:
            return None
        self._told = dict(self._values)
        return self._message("DDATA", now_ms, changed)

    def is_rebirth(self, payload: bytes) -> bool:
        """Return whether a command asks for the births again; no other command is heeded."""
        try:
            found = decode(payload)
        except PayloadError:
            return False
        return any(one.name == REBIRTH and one.value is True for one in found.metrics)

    def _topic(self, kind: str) -> str:
        device = f"/{self._device}" if kind.startswith("D") else ""
        return f"{NAMESPACE}/{self._group}/{kind}/{self.node}{device}"

    def _message(self, kind: str, now_ms: int, metrics: tuple[Metric, ...]) -> Message:
        payload = encode(SparkplugPayload(now_ms, self._seq, metrics))
        self._seq = (self._seq + 1) % 256
        return Message(self._topic(kind), payload, qos=0, is_retained=False)
