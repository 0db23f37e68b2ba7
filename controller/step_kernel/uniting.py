"""Unite all solids of one STEP file, as placed in it, into one: runs as a process.

It ends as `solid` does. Facts: the kernel's reference pages (Open CASCADE 7.9: BRepAlgoAPI_Fuse,
ShapeUpgrade_UnifySameDomain).

Usage: ``python -m controller.step_kernel.uniting FILE OUT MEMORY_BYTES CPU_S SHAPE``. The united
solid is left in SHAPE, in the kernel's own format and the coordinates of the file. In OUT are
``count`` of the solids, ``piece_count`` of what they make, ``volume_mm3`` of that, ``sum_mm3`` of
the solids by themselves, and ``unit``.
"""

import sys
from pathlib import Path
from typing import Any

from .bodies import Listing, read_named
from .ending import limit_resources, refuse
from .measures import mass_of
from .shapes import shapes_of


def placed_solids(listing: Listing) -> list[Any]:
    """Return every solid at every place it has in the file."""
    from OCP.gp import gp_Trsf
    from OCP.TopLoc import TopLoc_Location

    found = []
    for solid, body in zip(listing.solids, listing.bodies, strict=True):
        for place in body["placed"]:
            move = gp_Trsf()
            move.SetValues(*(number for row in place["T"][:3] for number in row))
            found.append(solid.Moved(TopLoc_Location(move)))
    return found


def united(solids: list[Any]) -> Any:  # noqa: ANN401  the kernel's types have no stubs
    """Return the union of solids, surfaces that go on across a seam made one.

    Raises
    ------
    ValueError : the kernel does not unite them
    """
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Fuse
    from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
    from OCP.TopTools import TopTools_ListOfShape

    first, others = TopTools_ListOfShape(), TopTools_ListOfShape()
    first.Append(solids[0])
    for solid in solids[1:]:
        others.Append(solid)
    fuse = BRepAlgoAPI_Fuse()
    fuse.SetArguments(first)
    fuse.SetTools(others)
    fuse.Build()
    if not fuse.IsDone():
        raise ValueError("it does not unite these bodies")
    whole = ShapeUpgrade_UnifySameDomain(fuse.Shape(), True, True, False)
    whole.Build()
    return whole.Shape()


def main(argv: list[str]) -> int:
    """Unite the solids and write the result; return the exit code, 0 unless it refuses."""
    source, out, memory, cpu, target = argv
    limit_resources(int(memory), int(cpu))
    import numpy as np
    from OCP.BinTools import BinTools
    from OCP.TopAbs import TopAbs_SOLID

    try:
        listing, unit = read_named(source)
        solids = placed_solids(listing)
        whole = united(solids) if len(solids) > 1 else solids[0]
        pieces = shapes_of(whole, TopAbs_SOLID)
        BinTools.Write_s(pieces.FindKey(1), target)
        volume_mm3 = mass_of(whole)["volume_mm3"]
        sum_mm3 = sum(mass_of(solid)["volume_mm3"] for solid in solids)
    except MemoryError:
        return refuse(out, "UnreadableCadError", "needs more memory than is granted")
    except Exception as error:  # noqa: BLE001  whatever the kernel throws is about this file
        return refuse(
            out, "UnreadableCadError", f"the STEP kernel gave up ({type(error).__name__}: {error})"
        )
    with Path(out).open("wb") as sink:
        np.savez(
            sink,
            unit=np.array(unit),
            count=np.array(len(solids)),
            piece_count=np.array(pieces.Extent()),
            volume_mm3=np.array(volume_mm3),
            sum_mm3=np.array(sum_mm3),
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
