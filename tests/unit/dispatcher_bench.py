"""A dispatcher around a journal, with stand-ins for what its run does not reach."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from controller.cell.batch import Dispatcher
from controller.cell.custody import Custody
from controller.cell.journal import Journal
from controller.cell.services import Gate, Permits
from drivers.clock import CellClock


def dispatcher_on(
    journal: Journal, actions: object, metal: object, custody: Custody = Custody.ON_TABLE
) -> Dispatcher:
    """Return a dispatcher that writes to a journal.

    Parameters
    ----------
    journal : of the run
    actions : perform its effects
    metal : what it halts
    custody : of the part
    """
    part = SimpleNamespace(custody=custody, tray=None)
    record = SimpleNamespace(part=part, parts_left=0, show_state=lambda *_, **__: None)
    gate = Gate(Permits(journal), CellClock())
    closed = SimpleNamespace(holding=lambda: None)
    return Dispatcher(
        cast(Any, actions), cast(Any, record), cast(Any, metal), (), journal, gate,
        cast(Any, closed), cast(Any, None),
    )  # fmt: skip
