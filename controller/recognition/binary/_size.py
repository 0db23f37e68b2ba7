"""Size of an object: area, perimeter and holes, by which the list of views is pruned first.

A chain of cracks is up to 41 % longer than the slanting edge it stands for. What corrects it
is the corner-count estimator of Vossepoel and Smeulders (1982): steps along the grid, steps across
it and changes between them are weighed so that over all directions of a straight edge the mean
error is zero and its spread least. It is used on the chain through the middles of the cracks,
which lie on both sides of the edge alike: through pixel centres every outline would be too short
by pi. The estimator is of straight edges; what it cuts off at corners is added for each one found.
Of sub-pixel loops the area is the shoelace sum, and the length that of the loop smoothed over
neighbours, which takes the zigzag of noise out and what it adds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray

from ._chain import Chain, curvature_code
from ._corners import find_corners, triangular
from ._strings import BoundaryString

EVEN, ODD, CHANGE = 0.980, 1.406, -0.091  # Vossepoel and Smeulders 1982
# length that the chain cuts off a right-angled corner, on average over its directions
CORNER_PX = 0.34
BOX, THRESHOLD = 15, 10  # of the paper's Table 2


@dataclass(frozen=True, eq=False, slots=True)
class Size:
    """Size of an object.

    Attributes
    ----------
    area_mm2 : holes taken out
    perimeter_mm : perimeter of the outline
    hole_count : number of holes
    hole_area_mm2 : (h,) area of each hole, largest first
    """

    area_mm2: float
    perimeter_mm: float
    hole_count: int
    hole_area_mm2: FloatArray


def chain_length_px(chain: Chain) -> float:
    """Return the length of the edge behind a chain, without bias over directions.

    A single direction may be off by 2 %, along the grid; of an outline the directions even out.
    """
    code = curvature_code(chain)
    turns = code != 0
    # from the middle of a crack to the next: straight on a whole step, round a corner half a
    # diagonal one
    odd = int(turns.sum())
    changes = int((turns != np.roll(turns, 1)).sum())
    corners = find_corners(triangular(code, BOX), THRESHOLD, BOX)
    cut_off = CORNER_PX * float(corners.size.sum()) / BOX
    return EVEN * (len(turns) - odd) + ODD * odd / 2 + CHANGE * changes + cut_off


def size_of_chains(chains: Sequence[Chain], mm_per_px: float) -> Size:
    """Return the size of one object from its mask's chains, at a uniform scale.

    Raises
    ------
    ValueError : no outer chain
    """
    outer = [chain for chain in chains if not chain.is_hole]
    if not outer:
        raise ValueError(f"no outer chain among {len(chains)}")
    holes = np.array([-chain.area_px for chain in chains if chain.is_hole]) * mm_per_px**2
    return Size(
        area_mm2=sum(chain.area_px for chain in chains) * mm_per_px**2,
        perimeter_mm=chain_length_px(max(outer, key=lambda chain: chain.area_px)) * mm_per_px,
        hole_count=len(holes),
        hole_area_mm2=np.sort(holes)[::-1],
    )


def size_of_string(string: BoundaryString) -> Size:
    """Return the size of an object from its sub-pixel boundary in the table plane.

    Perspective is in it already: a model's is that of its shadow at the same place.
    """
    return Size(
        area_mm2=string.area_mm2,
        perimeter_mm=string.perimeter_mm,
        hole_count=len(string.hole_area_mm2),
        hole_area_mm2=np.sort(string.hole_area_mm2)[::-1],
    )
