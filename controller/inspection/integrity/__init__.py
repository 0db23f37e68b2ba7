"""Evidence of an outline before the panel: missing, extra or displaced material."""

from ._allowed import Allowances, allowed_mm
from ._blurred import blur_rounds_px
from ._outline import BURR_PX, CHIP_PX, OutlineResult, compare_outline
from ._runs import Run, RunTest, alone, crowded, find_runs

__all__ = [
    "BURR_PX",
    "CHIP_PX",
    "Allowances",
    "OutlineResult",
    "Run",
    "RunTest",
    "allowed_mm",
    "alone",
    "blur_rounds_px",
    "compare_outline",
    "crowded",
    "find_runs",
]
