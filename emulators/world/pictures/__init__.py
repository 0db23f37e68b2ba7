"""The pictures of the emulated cell's cameras, drawn in a process of their own."""

from .desk import PictureDesk
from .geometry import Scene, board_surface, build_scene, coded, part_surface
from .worker import Order, Picture, PictureMaker

__all__ = [
    "Order",
    "Picture",
    "PictureDesk",
    "PictureMaker",
    "Scene",
    "board_surface",
    "build_scene",
    "coded",
    "part_surface",
]
