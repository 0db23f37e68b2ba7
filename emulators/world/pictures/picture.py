"""Pictures by ray casting: a sensor's light, without noise; ADR 43.

A picture is a sum over lamps. Static objects are painted once per camera and lamp; for a picture,
only the pixels that moving objects or their shadows may touch are painted again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..matter.solid import ray_scene
from ..shapes import Array
from .caster import Caster
from .geometry import (
    PAINTED,
    Array32,
    Assembly,
    Mover,
    RayTable,
    Scene,
    Surface,
    without_own_box,
)
from .light import CHUNK, Index, Lamps, Mask, Reach, chunks, fill
from .painter import Painter

if TYPE_CHECKING:  # loads scipy, which plain pictures do without
    from . import machined


@dataclass(frozen=True, slots=True, eq=False)
class Changes:
    """The changes of a picture by moving things.

    Attributes
    ----------
    pixels : (n,) pixels that may differ from those of the fixed things, row by row
    light : (n,) there, of each lit lamp at level 1
    """

    pixels: Index
    light: dict[int, Array32]


class Eye:
    """One camera: its rays, its view of fixed things, and its picture.

    Parameters
    ----------
    scene : data kept of machined parts, by all cameras of the scene together
    number : number of the camera in the scene
    parts : kept of machined parts, by all cameras of the scene together
    """

    def __init__(
        self, scene: Scene, number: int, parts: "dict[str, machined.MachinedPart] | None" = None
    ) -> None:
        self.camera = scene.cameras[number]
        self.rays = RayTable(self.camera)
        self.lamps = Lamps(scene)
        self._reach = Reach(self.camera, self.lamps)
        self._fixed = without_own_box(scene, self.camera.T_world_cam[:3, 3])
        self._movers: dict[str, Mover] = {}
        for surface in scene.moving:
            self.add(surface)
        self._shape = (self.camera.height_px, self.camera.width_px)
        self.painter = Painter(self.camera, self.rays, self.lamps)
        self._finish: machined.Finish | None = None
        if scene.finish_seed is not None:
            from .machined import Finish

            kept = {} if parts is None else parts
            self._finish = Finish(scene.finish_seed, self.camera, self.rays, self.lamps, kept)
        self._layers: dict[int, Array32] = {}
        self._bodies: Mask | None = None
        self._body_materials = [i for i, one in enumerate(scene.materials) if one == PAINTED]
        self._caster = Caster(self.rays.origin_mm)

    def add(self, surface: Surface) -> None:
        """Take one more movable object; it is visible once a picture has its pose."""
        self._movers[surface.name] = Mover(surface)

    def layer(self, lamp: int) -> Array32:
        """Return the camera's picture of the fixed things under one lamp at level 1, (h, w)."""
        if lamp not in self._layers:
            still = Mover(self._fixed)  # as if it had just appeared
            dark = {lamp: np.zeros(self._shape, np.float32)}
            everywhere = np.ones(self._shape, bool)
            assembly = Assembly(None, (still,))
            self._layers[lamp] = self.painter.paint(assembly, (still,), everywhere, dark)[lamp]
        return self._layers[lamp]

    # --- pictures -------------------------------------------------------------------------------

    def picture(self, poses: Mapping[str, Array], levels: Mapping[int, float]) -> Array32:
        """Return the radiance that reaches the sensor, (h, w); a panel's middle at level 1 is 1.

        Parameters
        ----------
        poses : T_world_* of everything that moves and is there
        levels : level of each lamp that is lit, by its number
        """
        lit = [lamp for lamp, level in levels.items() if level > 0.0]
        return self.mix(self.changes(poses, lit), levels)

    def changes(self, poses: Mapping[str, Array], lit: Sequence[int]) -> Changes:
        """Return the changes by moving things and their shadows; casts all the rays of a picture.

        Parameters
        ----------
        poses : T_world_* of everything that moves and is there
        lit : numbers of the lamps that are lit, at whatever level
        """
        movers = self._place(poses)
        wanted = self._wanted(movers, lit)
        pixels = np.flatnonzero(wanted)
        if len(pixels) == 0:
            return Changes(pixels, {lamp: np.zeros(0, np.float32) for lamp in lit})
        in_play = self._in_play(movers, lit)
        assembly = Assembly(self._fixed, in_play)
        before = {lamp: self.layer(lamp).copy() for lamp in lit}
        layers = self.painter.paint(assembly, in_play, wanted, before)
        if self._finish is not None:
            self._finish.apply(assembly, in_play, wanted, layers)
        return Changes(pixels, {lamp: layer.reshape(-1)[pixels] for lamp, layer in layers.items()})

    def mix(self, changes: Changes, levels: Mapping[int, float]) -> Array32:
        """Return the picture, (h, w), of its changes under lamps at some levels.

        Parameters
        ----------
        changes : return value of `changes` for these lamps
        levels : level of each lamp that is lit, by its number
        """
        picture = np.zeros(self._shape, np.float32)
        total = np.zeros(len(changes.pixels), np.float32)
        for lamp, light in changes.light.items():
            level = np.float32(levels[lamp])
            picture += level * self.layer(lamp)
            total += level * light
        picture.reshape(-1)[changes.pixels] = total
        return picture

    def _wanted(self, movers: Mapping[str, Mover], lit: Sequence[int]) -> Mask:
        """Return a mask of the pixels that can differ from the fixed things' picture, (h, w)."""
        mask = np.zeros(self._shape, np.uint8)
        for mover in movers.values() if lit else ():
            fill(mask, self._reach.outline(mover.corners_mm))
            for outline in self._reach.shadow_outlines(mover, lit):
                fill(mask, outline)
        wanted = mask.astype(bool)
        if movers and self.lamps.any_source(lit):
            wanted |= self._fixed_bodies()
        return wanted

    def _fixed_bodies(self) -> Mask:
        """Return a mask of the fixed things that are neither table nor panel, (h, w)."""
        if self._bodies is None:
            is_body = np.isin(self._fixed.material, self._body_materials)
            scene = ray_scene(self._fixed.vertices_mm, self._fixed.faces, robust=False)
            bodies = np.zeros(len(self.rays.directions), bool)
            for part in chunks(len(bodies), CHUNK):
                hits = self._caster.meet(scene, self.rays.directions[part])
                bodies[part] = (hits.triangle >= 0) & is_body[hits.triangle]
            wide = cv2.dilate(bodies.reshape(self._shape).astype(np.uint8), np.ones((3, 3)))
            self._bodies = wide.astype(bool)
        return self._bodies

    def depends_on(self, poses: Mapping[str, Array], lit: Sequence[int]) -> bytes:
        """Return the key of a picture: poses of all movers in sight or throwing a shadow there."""
        movers = self._place(poses)
        return b"".join(
            mover.surface.name.encode() + mover.T_world.tobytes()
            for mover in self._in_play(movers, lit)
        )

    def _in_play(self, movers: Mapping[str, Mover], lit: Sequence[int]) -> list[Mover]:
        return [
            mover
            for mover in movers.values()
            if lit
            and (
                self._reach.outline(mover.corners_mm) is not None
                or self._may_shade(mover, movers, lit)
            )
        ]

    def _may_shade(self, mover: Mover, movers: Mapping[str, Mover], lit: Sequence[int]) -> bool:
        """Whether a thing out of sight may stand between a lamp and something in sight."""
        if self._reach.shadow_outlines(mover, lit):
            return True
        if not self.lamps.any_source(lit):
            return False
        if self._fixed_bodies().any():
            return True
        return any(self._reach.outline(other.corners_mm) is not None for other in movers.values())

    def _place(self, poses: Mapping[str, Array]) -> dict[str, Mover]:
        movers: dict[str, Mover] = {}
        for name, mover in self._movers.items():
            if name in poses:
                mover.place(poses[name])
                movers[name] = mover
        return movers
