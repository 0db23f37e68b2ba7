"""The cell as matter and light: bodies in pybullet, pictures by ray casting, time handed in.

`World` is stepped by the owner of the time; `PictureDesk` makes pictures of it in another process.
Lengths are mm and angles rad, except for pybullet's metres, which stay inside.
"""

from ._models import ArmBody, Event, Snapshot
from ._world import World
from .boards import Board, read_board
from .ground_truth import part_pose, tray_of, truth
from .layout import (
    CameraLayout,
    DriverChoice,
    LampLayout,
    Layout,
    LayoutError,
    TrayLayout,
    read_layout,
)
from .matter.collide import Collision
from .matter.engine import EngineError
from .matter.solid import MAX_REST_OFF_RAD, Rest, Solid, load_solid
from .pictures import (
    Picture,
    PictureDesk,
    PictureMaker,
    Scene,
    board_surface,
    build_scene,
    coded,
    part_surface,
)

__all__ = [
    "MAX_REST_OFF_RAD",
    "ArmBody",
    "Board",
    "CameraLayout",
    "Collision",
    "DriverChoice",
    "EngineError",
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
    "board_surface",
    "build_scene",
    "coded",
    "load_solid",
    "part_pose",
    "part_surface",
    "read_board",
    "read_layout",
    "tray_of",
    "truth",
]
