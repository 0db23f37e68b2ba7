"""Things as rays meet them: movers in place, and all triangles of a picture in one structure."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...matter.solid import ray_scene
from ...poses import transform
from ...shapes import Array
from .edges import Edges
from .scene import Scene, Surface


class Mover:
    """A rigid thing that moves: its surface and the corners that bound it."""

    def __init__(self, surface: Surface) -> None:
        self.surface = surface
        self.edges = Edges(surface)
        low, high = surface.vertices_mm.min(axis=0), surface.vertices_mm.max(axis=0)
        self._bound = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
        self.T_world = np.eye(4)
        self.corners_mm: Array = self._bound

    def place(self, T_world: Array) -> None:
        """Move it to a pose."""
        self.T_world = T_world
        self.corners_mm = transform(T_world, self._bound)


class Assembly:
    """Triangles of the fixed and of some moving things, in the world, ready for rays.

    To build it anew for every picture takes milliseconds, and then each ray is cast once.
    """

    def __init__(self, fixed: Surface | None, movers: Sequence[Mover]) -> None:
        still = [] if fixed is None else [fixed]
        surfaces = [*still, *(mover.surface for mover in movers)]
        starts = np.cumsum([0] + [len(surface.vertices_mm) for surface in surfaces])
        vertices = [surface.vertices_mm for surface in still]
        normals = [surface.normals for surface in still]
        for mover in movers:
            vertices.append(transform(mover.T_world, mover.surface.vertices_mm))
            normals.append(mover.surface.normals @ mover.T_world[:3, :3].T.astype(np.float32))
        faces = [surface.faces + start for surface, start in zip(surfaces, starts, strict=False)]
        # quick rays may slip through a seam: a jump of light, which many rays then correct
        self.scene: Any = ray_scene(np.vstack(vertices), np.vstack(faces), robust=False)
        self._moving = (
            vertices[len(still) :],
            [surface.faces for surface in surfaces[len(still) :]],
        )
        self._moving_scene: Any = None
        self.normals = np.concatenate(normals)
        self.flat = self.normals.mean(axis=1)  # good enough to lift rays off a surface
        self.material = np.concatenate([surface.material for surface in surfaces])
        self.panel = np.concatenate([surface.panel for surface in surfaces])
        self.fixed_count = sum(len(surface.faces) for surface in still)
        counts = [len(surface.faces) for surface in surfaces]
        # of each moving thing, the number of its first triangle
        self.first_faces = np.cumsum([0, *counts])[len(still) : -1].tolist()

    @property
    def moving_scene(self) -> Any:  # noqa: ANN401  (embree has no types)
        """Movable objects alone, which may throw a new shadow; made at their first use."""
        if self._moving_scene is None:
            vertices, faces = self._moving
            starts = np.cumsum([0] + [len(one) for one in vertices])
            moved = [one + start for one, start in zip(faces, starts, strict=False)]
            self._moving_scene = ray_scene(np.vstack(vertices), np.vstack(moved), robust=False)
        return self._moving_scene


def without_own_box(scene: Scene, eye_mm: Array) -> Surface:
    """Return the fixed things but the camera's own housing, which it would look at from within."""
    fixed = scene.fixed
    own = [
        i
        for i, box in enumerate(scene.owner_boxes)
        if np.all(eye_mm >= box.low_mm) and np.all(eye_mm <= box.high_mm)
    ]
    keep = ~np.isin(scene.owner, own)
    return Surface(
        "",
        fixed.vertices_mm,
        fixed.faces[keep],
        fixed.normals[keep],
        fixed.material[keep],
        fixed.panel[keep],
    )
