"""The alarms of the cell: one per way in which it can stop, hold, refuse or recover.

`alarm.py` defines an alarm; `parts.py`, `devices.py` and `cell.py` are the data; `catalogue.py`
finds the alarm of a code or of an error, `page.py` draws docs/alarms.md.
"""

from .alarm import Alarm, Severity
from .catalogue import ALARMS, BY_CODE, BY_NUMBER, INTERNAL, alarm_of, code_of, device_named

__all__ = [
    "ALARMS",
    "BY_CODE",
    "BY_NUMBER",
    "INTERNAL",
    "Alarm",
    "Severity",
    "alarm_of",
    "code_of",
    "device_named",
]
