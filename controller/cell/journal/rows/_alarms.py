"""The alarm that a row raises, from whichever of its models: one reading for all who tell of it."""

from dataclasses import dataclass

from messages.fields import Sentence

from ._body import Body
from ._events import AlarmFields, AtRest


@dataclass(frozen=True, slots=True)
class ToldAlarm:
    """An alarm that a row raises.

    Attributes
    ----------
    number : number in docs/alarms.md
    message : sentence for the operator; empty if the row has none
    device, action : device, and action required; empty where the row leaves them to the catalogue
    is_repeated : it is that of a run's end, which most often an event has told before
    """

    number: int
    message: Sentence
    device: str
    action: Sentence
    is_repeated: bool


def told_alarm(body: Body | None) -> ToldAlarm | None:
    """Return the alarm that a row raises; None for none."""
    alarm: AlarmFields | int | None = getattr(body, "alarm", None)
    if not alarm:
        return None
    texts = (str(getattr(body, key, "")) for key in ("message", "error", "reason"))
    message = next(filter(None, texts), "")
    is_repeated = isinstance(body, AtRest)
    if isinstance(alarm, AlarmFields):
        return ToldAlarm(alarm.number, message, alarm.device, alarm.action, is_repeated)
    return ToldAlarm(alarm, message, str(getattr(body, "device", "")), "", is_repeated)
