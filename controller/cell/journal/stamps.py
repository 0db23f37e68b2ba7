"""The stamps of rows: the date, and a clock that never goes back.

Both are passed to the writer, so that a journal can use a time other than this computer's.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final


def _utc_now() -> datetime:
    return datetime.now(UTC)


@dataclass(frozen=True, slots=True)
class Stamps:
    """Reads both clocks.

    Attributes
    ----------
    utc : returns the present date and time, UTC
    monotonic_s : returns an instant [s] for differences alone
    """

    utc: Callable[[], datetime] = _utc_now
    monotonic_s: Callable[[], float] = time.monotonic


HOST_STAMPS: Final = Stamps()
