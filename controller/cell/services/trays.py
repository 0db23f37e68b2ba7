"""The tray of a part by its verdict."""

from collections.abc import Mapping
from typing import Final

from controller.inspection import Verdict

TRAYS: Final[Mapping[Verdict, str]] = {Verdict.PASS: "accept", Verdict.FAIL: "reject"}
# The tray of every other verdict.
QUARANTINE: Final = "quarantine"
