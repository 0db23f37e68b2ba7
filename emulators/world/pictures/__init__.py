"""What the cameras of the emulated cell see, drawn in a process of their own."""

from .geometry import Scene, build_scene
from .picture_worker import Picture, PictureDesk, Studio

__all__ = ["Picture", "PictureDesk", "Scene", "Studio", "build_scene"]
