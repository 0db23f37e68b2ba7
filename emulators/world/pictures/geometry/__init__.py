"""A camera's surroundings and its rays: surfaces with materials, moved into place, and edges.

Knows no light: `light` does.
"""

from .assembly import Assembly, Mover, without_own_box
from .coded import coded
from .edges import BLOCK_PX, Edges, any_in_blocks, fine_blocks, spread
from .optics import Array32, RayTable, distort, project, undistort
from .printed import board_surface
from .scene import (
    MACHINED_PART,
    PAINTED,
    Scene,
    Surface,
    build_scene,
    corner_normals,
    panel_frame,
    part_surface,
)

__all__ = [
    "BLOCK_PX",
    "MACHINED_PART",
    "PAINTED",
    "Array32",
    "Assembly",
    "Edges",
    "Mover",
    "RayTable",
    "Scene",
    "Surface",
    "any_in_blocks",
    "board_surface",
    "build_scene",
    "coded",
    "corner_normals",
    "distort",
    "fine_blocks",
    "panel_frame",
    "part_surface",
    "project",
    "spread",
    "undistort",
    "without_own_box",
]
