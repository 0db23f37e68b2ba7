"""Convex pieces of a part by pybullet's V-HACD, in a process of its own: it prints on fd 1.

``python -m emulators.world.matter._decompose MESH.obj PIECES.obj LOG``; see `solid`.
"""

import sys
from typing import Final

from .engine import load_engine

RESOLUTION: Final = 300_000  # voxels: 1 mm across on a 130 mm part, 1 to 4 s of time
CONCAVITY: Final = 0.001
GAMMA: Final = 0.0002  # cost of merging: larger values melt an L into one piece
MAX_VERTICES: Final = 64


def main(argv: list[str]) -> int:
    """Decompose ``argv[0]`` into ``argv[1]``, log in ``argv[2]``; return the exit code."""
    mesh_path, pieces_path, log_path = argv
    load_engine().vhacd(
        mesh_path,
        pieces_path,
        log_path,
        resolution=RESOLUTION,
        concavity=CONCAVITY,
        gamma=GAMMA,
        maxNumVerticesPerCH=MAX_VERTICES,
    )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
