"""Substitute for a face that cannot be divided: straight pieces between its borders.

A face with one border gets a lid, one with two (a cone, a bore) a band. The solid's volume and
inertia are then computed from its triangles, since the kernel's integrals include that face.
"""

from typing import Any

from .ending import RefusalError
from .measures import KINDS


def close(vertices: Any, triangles: Any, left_out: dict[int, set[int]]) -> dict[int, Any]:  # noqa: ANN401
    """Return the triangles that close a mesh where faces have been left out.

    Parameters
    ----------
    vertices, triangles : (v, 3) [mm] and (t, 3), of all other faces
    left_out : numbers of faces, and the vertices along the edges of each

    Returns
    -------
    by number of the face, (k, 3) vertices

    Raises
    ------
    RefusalError : the gap that a face leaves has no clear border, or more than two
    """
    loops = _borders(triangles)
    found: dict[int, list[list[int]]] = {face: [] for face in left_out}
    for loop in loops:
        owners = [face for face, along in left_out.items() if along.issuperset(loop)]
        if len(owners) != 1:
            raise RefusalError("OpenCadError", "has a gap that belongs to no single surface")
        found[owners[0]].append(loop)
    closed = {}
    for face, own in found.items():
        if len(own) not in (1, 2):
            raise RefusalError("OpenCadError", f"surface {face + 1} cannot be tessellated")
        closed[face] = _lid(vertices, *own) if len(own) == 1 else _band(vertices, *own)
    return closed


def _borders(triangles: Any) -> list[list[int]]:  # noqa: ANN401
    """Return the loops of a mesh's open sides, in the direction of a closing face.

    Raises
    ------
    RefusalError : two loops meet
    """
    import numpy as np

    sides = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    used = set(map(tuple, sides.tolist()))
    after: dict[int, int] = {}
    for a, b in used:
        if (b, a) in used:
            continue
        if b in after:
            raise RefusalError("OpenCadError", "has gaps that meet")
        after[b] = a
    loops = []
    while after:
        first, at = after.popitem()
        loop = [first]
        while at != first:
            loop.append(at)
            if at not in after:
                raise RefusalError("OpenCadError", "has a gap whose border does not close")
            at = after.pop(at)
        loops.append(loop)
    return loops


def _lid(vertices: Any, loop: list[int]) -> Any:  # noqa: ANN401
    """Return triangles inside one border, cut off ear by ear as it lies in its mean plane.

    Raises
    ------
    RefusalError : seen along the normal of that plane, it crosses itself
    """
    import numpy as np

    points = vertices[loop]
    normal = np.cross(points - points[0], np.roll(points, -1, axis=0) - points[0]).sum(axis=0)
    length = np.linalg.norm(normal)
    if length <= 0:
        raise RefusalError("OpenCadError", "has a gap without an inside")
    across = np.eye(3)[np.argmin(np.abs(normal))]
    u = np.cross(across, normal / length)
    u /= np.linalg.norm(u)
    flat = points @ np.column_stack([u, np.cross(normal / length, u)])
    left = list(range(len(loop)))
    cut = []
    while len(left) > 3:
        for k in range(len(left)):
            ear = left[k - 1], left[k], left[(k + 1) % len(left)]
            if _is_ear(flat, ear, left):
                cut.append(ear)
                del left[k]
                break
        else:
            raise RefusalError("OpenCadError", "has a gap whose border crosses itself")
    cut.append((left[0], left[1], left[2]))
    return np.array(loop)[np.array(cut)]


def _is_ear(flat: Any, ear: tuple[int, int, int], left: list[int]) -> bool:  # noqa: ANN401
    import numpy as np

    corners = flat[list(ear)]
    sides = np.roll(corners, -1, axis=0) - corners
    if sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0] <= 0:
        return False
    others = flat[[i for i in left if i not in ear]]
    arm = others[:, None] - corners
    return not ((sides[:, 0] * arm[..., 1] - sides[:, 1] * arm[..., 0]) >= 0).all(axis=1).any()


def _band(vertices: Any, one: list[int], other: list[int]) -> Any:  # noqa: ANN401
    """Return triangles between two borders, the shorter side first wherever there are two."""
    import numpy as np

    there = other[::-1]
    gaps = np.linalg.norm(vertices[one][:, None] - vertices[there], axis=2)
    i, k = divmod(int(np.argmin(gaps)), len(there))
    one, there = one[i:] + one[:i], there[k:] + there[:k]
    gaps = np.roll(gaps, (-i, -k), axis=(0, 1))
    i = k = 0
    found = []
    n, m = len(one), len(there)
    while i < n or k < m:
        along_one = gaps[(i + 1) % n, k % m] if i < n else np.inf
        along_other = gaps[i % n, (k + 1) % m] if k < m else np.inf
        if along_one <= along_other:
            found.append((one[i], one[(i + 1) % n], there[k % m]))
            i += 1
        else:
            found.append((there[(k + 1) % m], there[k], one[i % n]))
            k += 1
    return np.array(found)


def counted(arrays: dict[str, Any]) -> dict[str, Any]:
    """Return replacements for the exact integrals of a solid with faces left out.

    Parameters
    ----------
    arrays : arrays of the mesh and of its surfaces, with ``left_out`` (k,), numbers of faces
    """
    import numpy as np

    a, b, c = (arrays["vertices_mm"][arrays["triangles"][:, i]] for i in range(3))
    doubled = np.cross(b - a, c - a)
    area = np.linalg.norm(doubled, axis=1) / 2
    six = (a * np.cross(b, c)).sum(axis=1)
    volume = six.sum() / 6
    total = a + b + c
    centroid = (six[:, None] * total).sum(axis=0) / 24 / volume
    spread = sum(np.einsum("n,ni,nj->ij", six, p, p) for p in (a, b, c, total)) / 120
    spread = spread - volume * np.outer(centroid, centroid)
    of, kinds = arrays["face_of_triangle"], arrays["kind"].copy()
    areas, means = arrays["area_mm2"].copy(), arrays["mean_mm"].copy()
    for face in arrays["left_out"].tolist():
        own = of == face
        kinds[face] = KINDS.index("freeform")
        areas[face] = area[own].sum()
        means[face] = (area[own, None] * total[own]).sum(axis=0) / 3 / areas[face]
    return {
        "kind": kinds,
        "area_mm2": areas,
        "mean_mm": means,
        "volume_mm3": volume,
        "centroid_mm": centroid,
        "inertia_mm5": np.trace(spread) * np.eye(3) - spread,
        "surface_mm2": area.sum(),
    }
