"""The model of an alarm."""

from dataclasses import dataclass
from enum import StrEnum

from messages import key


class Severity(StrEnum):
    """The cell's reaction to an alarm."""

    WARNING = "warning"
    """Goes on; somebody should look at it when there is time."""
    RECOVERED = "recovered"
    """Recovers by itself, as often as the fault policy has it; then it parks the part or holds."""
    HOLD = key("hold")
    """Holds: the arm stands still and keeps what it has; a person has to look at the part."""
    STOP = key("stop")
    """Stops every device on request, and comes to rest."""
    ABORT = key("abort")
    """Stops every device at once; a person has to look at the cell."""
    REFUSED = key("refused")
    """Refuses to begin: nothing has moved."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm.

    Attributes
    ----------
    number : for messages, reports and people on the telephone; never given to another alarm
    code : stable short name, in the journal and in JSON
    severity : reaction of the cell
    device : device concerned; "device" if the message names it
    words : description of the event
    unknown : state that is unknown from now on; "nothing" if all is known
    action : action required of a person
    """

    number: int
    code: str
    severity: Severity
    device: str
    words: str
    unknown: str
    action: str
