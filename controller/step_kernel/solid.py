"""Read one STEP file with the STEP kernel and leave its content in an npz: runs as a process.

Its facts are the kernel's own reference pages (Open CASCADE 7.9: BRepMesh, BRepAdaptor,
BRepGProp).

Usage: ``python -m controller.step_kernel.solid FILE OUT MEMORY_BYTES CPU_S TIMES ANGLE_RAD
MENDED``. TIMES is how far chords may be off, as a multiple of what `chord_of` has for a solid of
its size; MENDED is 1 to mend the solid first, 2 to give its balls new borders first, 0 to mend it
only if a surface cannot be tessellated; a surface that cannot even so is left out.
It ends with 0 and arrays in OUT, or with 3 and a JSON object in OUT that names the error class and
the reason.
"""

import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from .bordering import balls_of, rebordered
from .closing import counted
from .dividing import chord_of
from .ending import RefusalError, limit_resources, refuse
from .files import mended, read_body, read_shape
from .measures import extent_of, mass_of, surfaces_of
from .mesh import UndividedError, tessellate

AS_IT_IS, MENDED, BORDERED = "0", "1", "2"  # what is done to a solid before it is divided
BODY: Final = ".bin"  # file of one body, in the kernel's own format; it names no unit


def main(argv: list[str]) -> int:
    """Read, measure, tessellate, write; return the exit code, 0 unless it refuses."""
    source, out, memory, cpu, times, angle, mend = argv
    limit_resources(int(memory), int(cpu))
    import numpy as np

    try:
        solid, unit = (read_body(source), "") if source.endswith(BODY) else read_shape(source)
        chord_mm = float(times) * chord_of(extent_of(solid))
        solid, how, mesh = divided(solid, chord_mm, float(angle), mend)
        arrays = mesh | surfaces_of(solid)
        arrays |= counted(arrays) if len(arrays["left_out"]) else mass_of(solid)
        arrays["how"] = np.array(how)
    except RefusalError as refusal:
        return refuse(out, refusal.error, str(refusal))
    except MemoryError:
        return refuse(out, "UnreadableCadError", "needs more memory than is granted")
    except Exception as error:  # noqa: BLE001  whatever the kernel throws is about this file
        name = type(error).__name__
        return refuse(out, "UnreadableCadError", f"the STEP kernel gave up ({name}: {error})")
    with Path(out).open("wb") as sink:
        np.savez(sink, unit=np.array(unit), **arrays)
    return 0


def divided(
    solid: Any,  # noqa: ANN401  the kernel's types have no stubs
    chord_mm: float,
    angle_rad: float,
    mend: str,
) -> tuple[Any, str, dict[str, Any]]:
    """Return a solid, the repairs made to it, and its mesh.

    Parameters
    ----------
    solid : the kernel's ``TopoDS_Solid`` [mm]
    chord_mm, angle_rad : as in `tessellate`
    mend : `AS_IT_IS`, to mend it only where a surface cannot be tessellated; `BORDERED`, to give
        its balls new borders first; `MENDED`, to mend it first

    Raises
    ------
    RefusalError : nothing helps; the reason is that of the solid as it is
    """
    if mend == BORDERED:
        solid = rebordered(solid, balls_of(solid))
    if mend == MENDED:
        solid = mended(solid)
    try:
        return solid, mend, tessellate(solid, chord_mm, angle_rad)
    except RefusalError as error:
        if mend != AS_IT_IS:
            raise
        refusal = error
    for way in (BORDERED, MENDED, AS_IT_IS):
        with suppress(RefusalError):
            if way == BORDERED and not isinstance(refusal, UndividedError):
                continue
            if way == BORDERED and isinstance(refusal, UndividedError):
                changed = rebordered(solid, refusal.faces)
            else:
                changed = mended(solid) if way == MENDED else solid
            leaves_out = way == AS_IT_IS
            return changed, way, tessellate(changed, chord_mm, angle_rad, leaves_out=leaves_out)
    raise refusal


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
