"""The cell as matter and light: bodies in pybullet, pictures by ray casting, time handed in.

`World` is stepped by whoever owns the time; `PictureDesk` makes pictures of it in another process.
Lengths are mm and angles rad, but for pybullet's metres, which stay inside.
"""

from ._collide import Collision
from ._layout import Layout, LayoutError, read_layout
from ._models import Event, Snapshot
from ._picture_worker import Picture, PictureDesk, Studio
from ._scene import Scene, build_scene
from ._solid import Solid, load_solid
from ._truth import tray_of, truth
from ._world import World

__all__ = [
    "Collision",
    "Event",
    "Layout",
    "LayoutError",
    "Picture",
    "PictureDesk",
    "Scene",
    "Snapshot",
    "Solid",
    "Studio",
    "World",
    "build_scene",
    "load_solid",
    "read_layout",
    "tray_of",
    "truth",
]
