"""The arm as those see it who plan its motions: kinematics, limits, links, timing; no I/O.

Planning asks the same of every arm, in terms of its own (`controller.planning.model.arm`). This
model fits them without knowing them. Facts are those of umi_rtx.md.
"""

from ._model import LinkBox, UmiModel
from ._timing import UmiTiming

__all__ = ["LinkBox", "UmiModel", "UmiTiming"]
