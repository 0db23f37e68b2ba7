"""pybullet as the world uses it: boxes that are moved, parts that fall; metres stay in here."""

from typing import Final

import numpy as np

from ..layout import MM_PER_M
from ..poses import invert, quat_xyzw_of, rotation_of
from ..shapes import Array, Box
from .engine import load_engine
from .solid import Solid

STEP_S: Final = 1.0 / 240.0
GRAVITY_M_PER_S2: Final = 9.81
FRICTION: Final = 0.5
_ROLLING_M: Final = 2e-4  # rolling and spinning resistance: a disc that rolls comes to rest
_CONTACT_ERP: Final = 0.4  # a finger that moves 0.4 mm a step sinks in no deeper than 1 mm
_FAR_MM: Final = np.array((0.0, 0.0, -50_000.0))


class Bodies:
    """One pybullet client; bodies are its numbers, poses are 4x4 in mm.

    Raises
    ------
    EngineError : pybullet is not installed
    RuntimeError : it has no free client
    """

    def __init__(self) -> None:
        pybullet = self._pybullet = load_engine()
        self._client = pybullet.connect(pybullet.DIRECT)
        # where boxes are due: most are moved many times before pybullet is asked about them
        self._due: dict[int, tuple[Array, Array]] = {}
        if self._client < 0:
            raise RuntimeError("pybullet has no free client")
        c = self._client
        pybullet.setGravity(0.0, 0.0, -GRAVITY_M_PER_S2, physicsClientId=c)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=STEP_S,
            contactERP=_CONTACT_ERP,
            numSolverIterations=30,
            deterministicOverlappingPairs=1,
            physicsClientId=c,
        )
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=c)
        self.table = pybullet.createMultiBody(0.0, plane, physicsClientId=c)
        self._rub(self.table)

    def close(self) -> None:
        """Give the client back."""
        if self._client >= 0:
            self._pybullet.disconnect(physicsClientId=self._client)
            self._client = -1

    def _rub(self, body: int) -> None:
        self._pybullet.changeDynamics(
            body,
            -1,
            lateralFriction=FRICTION,
            rollingFriction=_ROLLING_M,
            spinningFriction=_ROLLING_M,
            restitution=0.0,
            physicsClientId=self._client,
        )

    def add_box(self, box: Box, T_world_frame: Array) -> int:
        """Add a box that stays put, its frame its own (see `place_box`); return its body."""
        half = [float(v) / MM_PER_M for v in box.half_mm]
        shape = self._pybullet.createCollisionShape(
            self._pybullet.GEOM_BOX, halfExtents=half, physicsClientId=self._client
        )
        body = int(self._pybullet.createMultiBody(0.0, shape, physicsClientId=self._client))
        self._rub(body)
        self.place_box(body, box.centre_mm, T_world_frame)
        self._reset_due()
        return body

    def place_box(self, body: int, centre_mm: Array, T_world_frame: Array) -> None:
        """Put a box into a frame.

        Parameters
        ----------
        body : pybullet's number of the box
        centre_mm : (3,) its centre in the frame
        T_world_frame : (4, 4) the frame [mm]; not changed afterwards
        """
        self._due[body] = (centre_mm, T_world_frame)

    def _reset_due(self, *bodies: int) -> None:
        """Put these boxes at their places; all of them if none is named."""
        for body in bodies or tuple(self._due):
            if (due := self._due.pop(body, None)) is not None:
                centre_mm, T = due
                self._reset(body, T[:3, :3] @ centre_mm + T[:3, 3], T[:3, :3])

    def add_part(self, solid: Solid) -> tuple[int, int]:
        """Add a part twice, far away; return the body that falls and the one that is carried."""
        shape = self._pybullet.createCollisionShape(
            self._pybullet.GEOM_MESH, fileName=str(solid.pieces_path), physicsClientId=self._client
        )
        c = self._client
        far = [float(v) / MM_PER_M for v in _FAR_MM]
        falling = int(
            self._pybullet.createMultiBody(solid.mass_kg, shape, -1, far, physicsClientId=c)
        )
        carried = int(self._pybullet.createMultiBody(0.0, shape, -1, far, physicsClientId=c))
        for body in (falling, carried):
            self._rub(body)
        self._pybullet.changeDynamics(
            falling,
            -1,
            localInertiaDiagonal=[float(v) for v in solid.inertia_kg_m2],
            physicsClientId=c,
        )
        self.switch(falling, False)
        self.switch(carried, False)
        return falling, carried

    def switch(self, body: int, on: bool) -> None:
        """Let a body touch others, or take it out of the world."""
        group = 1 if on else 0
        self._pybullet.setCollisionFilterGroupMask(
            body, -1, group, group, physicsClientId=self._client
        )
        if not on:
            self._reset(body, _FAR_MM, np.eye(3))

    def pair(self, one: int, other: int, touch: bool) -> None:
        """Let two bodies touch each other, or pass through each other.

        Parameters
        ----------
        one, other : pybullet's numbers of the bodies
        touch : True: contacts between them act
        """
        flag = 1 if touch else 0
        self._pybullet.setCollisionFilterPair(
            one, other, -1, -1, flag, physicsClientId=self._client
        )

    def place_part(self, body: int, solid: Solid, T_world_part: Array) -> None:
        """Put a part at rest at a pose of its CAD frame.

        Parameters
        ----------
        body : pybullet's number of the part
        solid : gives where the body's frame is in the CAD frame
        T_world_part : (4, 4) pose of the CAD frame [mm]
        """
        T = T_world_part @ solid.T_part_body
        self._reset(body, T[:3, 3], T[:3, :3])

    def _reset(self, body: int, position_mm: Array, R: Array) -> None:
        x, y, z = position_mm.tolist()
        self._pybullet.resetBasePositionAndOrientation(
            body,
            (x / MM_PER_M, y / MM_PER_M, z / MM_PER_M),
            quat_xyzw_of(R),
            physicsClientId=self._client,
        )

    def halt(self, body: int) -> None:
        """Take a body's speed away."""
        zero = (0.0, 0.0, 0.0)
        self._pybullet.resetBaseVelocity(body, zero, zero, physicsClientId=self._client)

    def part_pose(self, body: int, solid: Solid) -> Array:
        """Return the pose of a falling part, T_world_part [mm]."""
        position, quat = self._pybullet.getBasePositionAndOrientation(
            body, physicsClientId=self._client
        )
        T = np.eye(4)
        T[:3, :3] = rotation_of(quat)
        T[:3, 3] = np.array(position) * MM_PER_M
        pose: Array = T @ invert(solid.T_part_body)
        return pose

    def speed(self, body: int) -> tuple[float, float]:
        """Return the linear and angular speed of a body [mm/s, rad/s]."""
        v, w = self._pybullet.getBaseVelocity(body, physicsClientId=self._client)
        return MM_PER_M * sum(a * a for a in v) ** 0.5, sum(a * a for a in w) ** 0.5

    def step(self) -> None:
        """Let one `STEP_S` pass."""
        self._reset_due()
        self._pybullet.stepSimulation(physicsClientId=self._client)

    def deepest(
        self, one: int, other: int, within_mm: float = 0.0
    ) -> tuple[float, Array, Array] | None:
        """Return the nearest points of two bodies: distance [mm], point on one, normal to one.

        None when they are further apart than ``within_mm``; the distance is negative when they
        overlap.

        Parameters
        ----------
        one, other : pybullet's numbers of the bodies
        within_mm : distance within which pairs are examined
        """
        self._reset_due(one, other)
        contacts = self._pybullet.getClosestPoints(
            one, other, within_mm / MM_PER_M, physicsClientId=self._client
        )
        if not contacts:
            return None
        best = min(contacts, key=lambda contact: contact[8])
        return best[8] * MM_PER_M, np.array(best[5]) * MM_PER_M, np.array(best[7])
