"""Solids whose facts are known on paper, built with manifold3d, for the geometry rooms' tests."""

from __future__ import annotations

import manifold3d
import numpy as np
import trimesh

from controller.cad import Solid, make_solid

Body = manifold3d.Manifold


def box(x: float, y: float, z: float) -> Body:
    """A box round the origin."""
    return Body.cube((x, y, z), True)


def rod(radius: float, length: float, segments: int = 64) -> Body:
    """A cylinder along z round the origin, its corners on the circle."""
    return Body.cylinder(length, radius, radius, segments, True)


def prism(outline: list[tuple[float, float]], height: float) -> Body:
    return manifold3d.CrossSection([outline]).extrude(height)


def mesh_of(body: Body) -> trimesh.Trimesh:
    mesh = body.to_mesh()
    return trimesh.Trimesh(
        np.asarray(mesh.vert_properties, dtype=float)[:, :3], np.asarray(mesh.tri_verts)
    )


def solid_of(body: Body, name: str = "test") -> Solid:
    return make_solid(mesh_of(body), name, "5eed" * 16, where=name)


def polygon_area(radius: float, segments: int) -> float:
    """Area of a regular polygon whose corners lie on the circle."""
    return 0.5 * segments * radius**2 * float(np.sin(2 * np.pi / segments))
