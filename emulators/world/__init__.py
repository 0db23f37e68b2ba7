"""The cell as matter and light: bodies in pybullet, pictures by ray casting, time handed in.

`World` is stepped by whoever owns the time; `PictureDesk` makes pictures of it in another process.
Lengths are mm and angles rad, but for pybullet's metres, which stay inside.
"""

from ._models import Event, Snapshot
from ._world import World
from .ground_truth import tray_of, truth
from .layout import CameraLayout, LampLayout, Layout, LayoutError, TrayLayout, read_layout
from .matter.collide import Collision
from .matter.solid import MAX_REST_OFF_RAD, Rest, Solid, load_solid
from .pictures import Picture, PictureDesk, PictureMaker, Scene, build_scene

__all__ = [
    "MAX_REST_OFF_RAD",
    "CameraLayout",
    "Collision",
    "Event",
    "LampLayout",
    "Layout",
    "LayoutError",
    "Picture",
    "PictureDesk",
    "PictureMaker",
    "Rest",
    "Scene",
    "Snapshot",
    "Solid",
    "TrayLayout",
    "World",
    "build_scene",
    "load_solid",
    "read_layout",
    "tray_of",
    "truth",
]
