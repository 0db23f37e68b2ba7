"""Read one STEP file with the STEP kernel and leave what it knows in an npz: runs as a process.

Its facts are the kernel's own reference pages (Open CASCADE 7.9: BRepMesh, BRepAdaptor,
BRepGProp).

Usage: ``python -m controller.step_kernel.solid FILE OUT MEMORY_BYTES CPU_S TIMES ANGLE_RAD
MENDED``. TIMES is how far chords may be off, as a multiple of what `chord_of` has for a solid of
its size; MENDED is 1 to mend the solid first, 0 to do so only if a surface cannot be tessellated.
It ends with 0 and arrays in OUT, or with 3 and a JSON object in OUT that names the error class and
the reason.
"""

import sys
from pathlib import Path
from typing import Final

from .dividing import chord_of
from .ending import RefusalError, limit_resources, refuse
from .files import mended, read_body, read_shape
from .measures import extent_of, mass_of, surfaces_of
from .mesh import tessellate

BODY: Final = ".bin"  # file of one body, in the kernel's own format; it names no unit


def main(argv: list[str]) -> int:
    """Read, measure, tessellate, write; return the exit code, 0 unless it refuses."""
    source, out, memory, cpu, times, angle, mend = argv
    limit_resources(int(memory), int(cpu))
    import numpy as np

    try:
        solid, unit = (read_body(source), "") if source.endswith(BODY) else read_shape(source)
        chord_mm = float(times) * chord_of(extent_of(solid))
        is_mended = mend == "1"
        solid = mended(solid) if is_mended else solid
        try:
            mesh = tessellate(solid, chord_mm, float(angle))
        except RefusalError:
            if is_mended:
                raise
            is_mended, solid = True, mended(solid)
            mesh = tessellate(solid, chord_mm, float(angle))
        arrays = mesh | surfaces_of(solid) | mass_of(solid) | {"is_mended": np.array(is_mended)}
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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
