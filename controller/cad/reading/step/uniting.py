"""All bodies of a STEP file as one part: `EVERY` behind the ``#``, or ``unite: true`` in a recipe.

Many CAD programs write a web, a boss or a fillet as a solid of its own, which touches the others.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from controller.config.cad_files import EVERY, body_path

from ...errors import CadError, ManySolidsCadError
from .bodies import Bodies, StepBody, written
from .kernel import KernelLimits, KernelRun
from .references import References

OVERLAP_SHARE: Final = 1e-6  # share of the volume: the error of the kernel's integrals
MAX_TRIED: Final = 50  # bodies that are united only to test whether they touch


@dataclass(frozen=True, slots=True, eq=False)
class United:
    """The union of a file's bodies.

    Attributes
    ----------
    count : number of the bodies
    piece_count : number of pieces of what they make; 1 where all touch
    overlap_mm3 : volume of their overlap
    shape : the kernel's own format, in the coordinates of the file
    unit : unit of length, in the kernel's spelling
    """

    count: int
    piece_count: int
    overlap_mm3: float
    shape: bytes
    unit: str

    @property
    def caution(self) -> str:
        """A caution about a part made by such a union."""
        text = f"{self.count} bodies of the file were united by the STEP kernel"
        if self.overlap_mm3:
            text += f"; they ran into each other by {self.overlap_mm3:.3g} mm3"
        return f"{text}."


def unite(path: Path, files: References, limits: KernelLimits | None = None) -> United:
    """Return the union of all bodies of a file, as placed in it.

    Parameters
    ----------
    path : path of the file, for messages
    files : its content, with that of the files it names
    limits : on memory and time of the kernel; None for the usual ones

    Raises
    ------
    UnreadableCadError : the kernel does not read the file, or does not unite its bodies
    """
    with tempfile.TemporaryDirectory(prefix="cellctl-step-") as folder:
        source = written(files, Path(folder) / "inputs")
        target = Path(folder) / "united.bin"
        with KernelRun(
            "uniting", source, Path(folder) / "united.npz", (str(target),), limits
        ) as run:
            found = run.result(str(path))
        volume_mm3, sum_mm3 = float(found["volume_mm3"]), float(found["sum_mm3"])
        overlap_mm3 = sum_mm3 - volume_mm3
        return United(
            int(found["count"]),
            int(found["piece_count"]),
            overlap_mm3 if overlap_mm3 > OVERLAP_SHARE * sum_mm3 else 0.0,
            target.read_bytes(),
            str(found["unit"]),
        )


def require_whole(path: Path, united: United) -> StepBody:
    """Return the union as a body.

    Raises
    ------
    ManySolidsCadError : some of the bodies do not touch
    """
    if united.piece_count != 1:
        raise ManySolidsCadError(
            f"{path}: its {united.count} bodies touch so that {united.piece_count} are left; a "
            "part is one. Name one of them behind the #, or unite them in the CAD system"
        )
    return StepBody("", (), np.zeros(3), 0.0, (), "", 0, united.shape)


def touching_text(path: Path, files: References, bodies: Bodies) -> str:
    """Return a sentence on bodies that together form one part; empty for others.

    Parameters
    ----------
    path : path of the file
    files : its content, with that of the files it names
    bodies : bodies of the file
    """
    if bodies.count > MAX_TRIED or bodies.missing or bodies.open_names:
        return ""
    try:
        united = unite(path, files)
    except CadError:
        return ""
    if united.piece_count != 1:
        return ""
    how = "run into each other" if united.overlap_mm3 else "touch"
    return (
        f"They {how}, and may be one part whose features were not united: take them as one by "
        f"'{body_path(path, EVERY)}' (on a command line in quotes), or in a recipe by `unite: true`"
    )
