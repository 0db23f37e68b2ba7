"""Light that a part's walls throw on each other: one bounce, by form factors from node to node.

Every triangle has a grid of nodes. Which other places of the part a node sees does not depend on
its pose, so it is found once: rays spread by the cosine over the node's half space, each of which
stands for the same share of what comes in. For a pose and a lamp the nodes' direct light is found
by shadow rays, and one sparse product gives the light after a bounce.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ...matter.solid import ray_scene
from ...shapes import Array
from ..geometry import Array32, Surface

Index = NDArray[np.intp]

NODE_MM: Final = 2.5  # distance between nodes
_STEPS_MAX: Final = 24
_NODES_MAX: Final = 25_000  # besides corners; a part with more gets them further apart
RAY_COUNT: Final = 96  # rays from each node
_PULL: Final = 0.03  # nodes stand this share of the way to their triangle's middle: off its sides
_LIFT_MM: Final = 0.02
_CHUNK: Final = 400  # nodes at a time


class Nodes:
    """The nodes of a part.

    Attributes
    ----------
    points_mm, normals : (n, 3) in the part frame
    seen : (n, n) sparse; times the light that leaves the nodes it is what falls on them
    """

    def __init__(self, surface: Surface) -> None:
        corners = surface.vertices_mm[surface.faces]
        self._steps = _steps(corners)
        per = (self._steps + 1) * (self._steps + 2) // 2
        self._first = np.concatenate(([0], np.cumsum(per)))[:-1]
        triangle, u, v = _grid(self._steps)
        weights = np.stack((1.0 - u - v, u, v), axis=1)
        pulled = weights + _PULL * (1.0 / 3.0 - weights)
        of = corners[triangle]
        self.points_mm: Array = np.einsum("nk,nkj->nj", pulled, of)
        normals = np.einsum("nk,nkj->nj", pulled, surface.normals[triangle].astype(float))
        size = np.linalg.norm(normals, axis=1, keepdims=True)
        self.normals: Array = normals / np.maximum(size, 1e-9)
        flat = np.cross(of[:, 1] - of[:, 0], of[:, 2] - of[:, 0])
        length = np.linalg.norm(flat, axis=1, keepdims=True)
        self._flat = np.where(length > 1e-9, flat / np.maximum(length, 1e-9), self.normals)
        self.seen: Any = self._form_factors(surface)

    @property
    def is_concave(self) -> bool:
        """Whether any wall sees another."""
        return bool(self.seen.nnz > 0)

    def weights(self, triangle: Index, u: Array32, v: Array32) -> tuple[Index, Array32]:
        """Return the nodes around places in triangles, and their weights: (n, 3) each.

        Parameters
        ----------
        triangle : (n,) triangle of the surface
        u, v : (n,) barycentric coordinates, of the second and the third corner
        """
        steps = self._steps[triangle]
        a, b = np.clip(u, 0.0, 1.0) * steps, np.clip(v, 0.0, 1.0) * steps
        i = np.minimum(a.astype(np.intp), steps - 1)
        j = np.minimum(b.astype(np.intp), steps - 1 - i)
        fa, fb = np.clip(a - i, 0.0, 1.0), np.clip(b - j, 0.0, 1.0)
        is_upper = (fa + fb > 1.0) & (i + j < steps - 1)
        lower = np.stack((np.maximum(1.0 - fa - fb, 0.0), fa, fb), axis=1)
        upper = np.stack((fa + fb - 1.0, 1.0 - fb, 1.0 - fa), axis=1)
        weights = np.where(is_upper[:, None], upper, lower)
        weights /= weights.sum(axis=1, keepdims=True)
        base = self._first[triangle]
        ten, one = _number(i + 1, j, steps), _number(i, j + 1, steps)
        corner = np.where(is_upper, _number(i + 1, np.minimum(j + 1, steps - 1 - i), steps),
                          _number(i, j, steps))  # fmt: skip
        nodes = np.stack((corner, ten, one), axis=1) + base[:, None]
        return nodes, weights.astype(np.float32)

    def _form_factors(self, surface: Surface) -> Any:  # noqa: ANN401  (scipy's sparse matrix)
        scene = ray_scene(surface.vertices_mm, surface.faces)
        count = len(self.points_mm)
        local = _cosine_directions()
        rows, columns, values = [], [], []
        for start in range(0, count, _CHUNK):
            some = slice(start, min(count, start + _CHUNK))
            normals = self.normals[some]
            across, along = _tangents(normals)
            directions = (
                local[None, :, :1] * across[:, None]
                + local[None, :, 1:2] * along[:, None]
                + local[None, :, 2:] * normals[:, None]
            ).reshape(-1, 3)
            lifted = self.points_mm[some] + _LIFT_MM * self._flat[some]
            origins = np.repeat(lifted, RAY_COUNT, axis=0)
            hit = scene.run(origins.astype(np.float32), directions.astype(np.float32), output=True)
            ray = np.flatnonzero(hit["primID"] >= 0)
            # from within, through a thin edge: not a wall that is seen
            faces = np.einsum("ij,ij->i", directions[ray], self._normal_of(surface, hit, ray)) < 0.0
            ray = ray[faces]
            nodes, weights = self.weights(
                hit["primID"][ray].astype(np.intp), hit["u"][ray], hit["v"][ray]
            )
            rows.append(np.repeat(start + ray // RAY_COUNT, 3))
            columns.append(nodes.ravel())
            values.append(weights.ravel() / RAY_COUNT)
        each = (np.concatenate(one) for one in (values, rows, columns))
        value, row, column = each
        matrix = csr_matrix((value, (row, column)), shape=(count, count), dtype=np.float32)
        matrix.sum_duplicates()
        return matrix

    def _normal_of(self, surface: Surface, hit: Any, ray: Index) -> Array:  # noqa: ANN401
        first = self._first[hit["primID"][ray]]
        normals: Array = self._flat[first]
        return normals


def _steps(corners_mm: Array) -> NDArray[np.intp]:
    """Return the number of steps into which each triangle's sides are divided."""
    across = np.linalg.norm(corners_mm - np.roll(corners_mm, 1, axis=1), axis=2)
    sides = np.asarray(across.max(axis=1))
    pitch_mm = NODE_MM
    while True:
        steps = np.clip(np.ceil(sides / pitch_mm), 1, _STEPS_MAX).astype(np.intp)
        count = int(((steps + 1) * (steps + 2) // 2).sum())
        if count <= _NODES_MAX + 3 * len(steps) or int(steps.max()) == 1:
            return steps
        pitch_mm *= 1.3


def _grid(steps: NDArray[np.intp]) -> tuple[Index, Array, Array]:
    """Return triangle and barycentric coordinates of all nodes, in the order of `_number`."""
    triangle, u, v = [], [], []
    for number, m in enumerate(steps.tolist()):
        j, i = np.array([(b, a) for b in range(m + 1) for a in range(m + 1 - b)]).T
        triangle.append(np.full(len(i), number))
        u.append(i / m)
        v.append(j / m)
    return np.concatenate(triangle), np.concatenate(u), np.concatenate(v)


def _number(i: Index, j: Index, steps: Index) -> Index:
    """Return the number of a node within its triangle: row j has steps + 1 - j of them."""
    number: Index = j * (steps + 1) - j * (j - 1) // 2 + i
    return number


def _cosine_directions() -> Array:
    """Return directions about z, spread by the cosine: (RAY_COUNT, 3)."""
    k = np.arange(RAY_COUNT)
    radius = np.sqrt((k + 0.5) / RAY_COUNT)  # Malley: even on the disc, by the cosine above it
    phi = k * np.pi * (3.0 - np.sqrt(5.0))
    return np.stack((radius * np.cos(phi), radius * np.sin(phi), np.sqrt(1.0 - radius**2)), axis=1)


def _tangents(normals: Array) -> tuple[Array, Array]:
    """Return two directions at right angles to normals and to each other, (n, 3) each."""
    helper = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    across = np.cross(normals, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return across, np.cross(normals, across)
