"""Straight edges of planes."""

from typing import Final

import numpy as np

from controller.cad import Crease, Curve, Solid

from .._types import EdgeLine

MIN_LENGTH_MM: Final = 2.0  # least length; on a shorter edge any camera of a cell has too few rays


def convex_lines(solid: Solid) -> dict[int, tuple[EdgeLine, ...]]:
    """Return the straight outer edges of each plane that has any, by face id, longest first."""
    b = solid.boundary
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    found: dict[int, list[tuple[float, EdgeLine]]] = {}
    straight = (b.curve == Curve.LINE) & (b.crease == Crease.CONVEX)
    for edge in np.nonzero(straight)[0].tolist():
        chain = b.chain_of(edge)
        start, end = vertices[chain[0]], vertices[chain[-1]]
        length = float(np.linalg.norm(end - start))
        if length < MIN_LENGTH_MM:
            continue
        faces = int(b.face[2 * edge]), int(b.face[2 * edge + 1])
        for mine, beyond in (faces, faces[::-1]):
            if solid.faces[mine].kind == "plane":
                line = EdgeLine(start, end, (mine, beyond))
                found.setdefault(mine, []).append((length, line))
    return {
        face: tuple(line for _, line in sorted(lines, key=lambda pair: -pair[0]))
        for face, lines in found.items()
    }
