"""Draws docs/alarms.md: ``python -m controller.cell.alarms.page > docs/alarms.md``.

A test fails when the page is out of date.
"""

import sys

from .alarm import Severity
from .catalogue import ALARMS

HEAD = """# Alarms

One alarm for each way in which the cell can stop, hold, refuse or recover. Messages, report and
journal have its number; the code stands in the journal and in JSON. Drawn from the catalogue by
`python -m controller.cell.alarms.page > docs/alarms.md`; a test fails when this page is out of
date, and when an alarm is raised that is not in it.

| severity | what the cell does |
|---|---|
"""
MEANING = {
    Severity.WARNING: "goes on",
    Severity.RECOVERED: "recovers by itself as often as the fault policy has it "
    "(docs/operating/recovery.md); then it parks the part or holds",
    Severity.HOLD: "holds: the arm stands still and keeps what it has",
    Severity.STOP: "stops every device and comes to rest",
    Severity.ABORT: "stops every device at once",
    Severity.REFUSED: "refuses to begin; nothing has moved",
}
TABLE_HEAD = """
| number | code | severity | device | what happened | unknown from now on | what to do |
|---|---|---|---|---|---|---|
"""


def page() -> str:
    """Return docs/alarms.md."""
    meanings = "".join(f"| {severity.value} | {MEANING[severity]} |\n" for severity in Severity)
    lines = "".join(
        f"| {a.number} | `{a.code}` | {a.severity.value} | {a.device} | {a.words} | {a.unknown} | "
        f"{a.action} |\n"
        for a in ALARMS
    )
    return f"{HEAD}{meanings}{TABLE_HEAD}{lines}"


if __name__ == "__main__":
    sys.stdout.write(page())
