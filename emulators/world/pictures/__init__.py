"""What the cameras of the emulated cell see, drawn in a process of their own."""

from .desk import PictureDesk
from .geometry import Scene, build_scene
from .worker import Order, Picture, PictureMaker

__all__ = ["Order", "Picture", "PictureDesk", "PictureMaker", "Scene", "build_scene"]
