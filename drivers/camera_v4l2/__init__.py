"""V4L2 capture: a frame exposed wholly after an instant, with the time and settings of exposure.

A thin layer of our own over the kernel's ioctls. Not responsible for light, lens or the content of
pictures.
"""

from .. import kinds
from ..kinds import Driver, NoSettings, Site
from ._camera import Camera, system_calls_for
from .capture import (
    CameraConfig,
    CameraIdentity,
    CameraStats,
    ControlInfo,
    ControlSetting,
    Frame,
    StampSource,
    decode,
)
from .kernel import FoundNode, KernelCalls, SocketCalls, SysCalls, find_node, list_nodes

__all__ = [
    "DRIVER",
    "Camera",
    "CameraConfig",
    "CameraIdentity",
    "CameraStats",
    "ControlInfo",
    "ControlSetting",
    "FoundNode",
    "Frame",
    "KernelCalls",
    "SocketCalls",
    "StampSource",
    "SysCalls",
    "decode",
    "find_node",
    "list_nodes",
    "system_calls_for",
]


def _build(site: Site, _: NoSettings) -> Camera:
    capture = site.capture
    if capture is None:
        raise ValueError(f"{site.name}: no settings for this camera")
    config = CameraConfig(
        device=site.address,
        width=capture.width,
        height=capture.height,
        pixel_formats=capture.formats,
        fps=capture.fps,
        exposure_s=capture.exposure_s,
        buffer_count=2,
        settle_frame_count=capture.settle_frames,
        frame_margin_s=capture.margin_s,
        frame_timeout_s=capture.frame_late_s,
    )
    return Camera(config, clock=site.clock, wires=site.wires, name=site.name)


DRIVER: Driver[kinds.Camera, NoSettings] = Driver(NoSettings, _build, node_group="video")
