"""Judge the stored pictures of a part again, and print what was measured and what was found.

    python examples/judge_pictures.py runs/RUN/part001.views.json [RECIPE.yaml]

No device is opened. A run writes such a set beside its pictures; docs/inspect.md has the form, for
pictures of your own.
"""

import sys
from pathlib import Path

from controller.interface import judge_pictures

part = judge_pictures(Path(sys.argv[1]), recipe=sys.argv[2] if len(sys.argv) > 2 else None)
print(part.verdict.name)
for reason in part.reasons:
    print(f"  {reason}")
for value in part.measured:
    if value.measured_mm is not None:
        U = f" (U = {value.U_mm:.3f} mm)" if value.U_mm is not None else ""
        print(f"{value.characteristic.label}: {value.measured_mm:.3f} mm{U}, {value.verdict.value}")
print(f"{part.ledger.compared_fraction:.0%} of the surface was compared")
