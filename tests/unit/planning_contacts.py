"""What the arm, the cell and a part touch, and how well a grasp holds: by triangles and FCL.

Shares no geometry code with `controller.planning`: the arm's links are placed from the formulas
of umi_rtx.md 6.4 and its limits read from 5.1 and 5.2 again, the part is its mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import fcl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from controller.cad import Solid
from controller.planning import CellLayout, Grasp, Jaw

Array = NDArray[np.float64]
Named = tuple[str, str, Array, Array]  # name, frame, (4, 4) in that frame, half edges
Touches = Callable[[int], bool]

# a step of a checked line moves the tip by less than 9 mm
STEP = np.array([0.012, 0.012, 0.04, 7.0, 0.04, 0.04])
PAD_GIVE_MM = 0.5  # pads sink into what they hold, and it into them, by less
OPENING_MM = 0.5  # what a jaw's encoder must tell apart
MIN_CONTACT_MM2 = 15.0
COUNTS = {"elbow": 14.611, "shoulder": 29.221, "zed": 3.750, "wrist": 13.487, "yaw": 9.740}


def rz(angle: Array) -> Array:
    T = np.tile(np.eye(4), (*np.shape(angle), 1, 1))
    T[..., 0, 0] = T[..., 1, 1] = np.cos(angle)
    T[..., 0, 1], T[..., 1, 0] = -np.sin(angle), np.sin(angle)
    return T


def ry(angle: Array) -> Array:
    T = np.tile(np.eye(4), (*np.shape(angle), 1, 1))
    T[..., 0, 0] = T[..., 2, 2] = np.cos(angle)
    T[..., 0, 2], T[..., 2, 0] = np.sin(angle), -np.sin(angle)
    return T


def rx(angle: Array) -> Array:
    T = np.tile(np.eye(4), (*np.shape(angle), 1, 1))
    T[..., 1, 1] = T[..., 2, 2] = np.cos(angle)
    T[..., 1, 2], T[..., 2, 1] = -np.sin(angle), np.sin(angle)
    return T


def shift(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Array:
    x, y, z = np.broadcast_arrays(x, y, z)
    T = np.tile(np.eye(4), (*x.shape, 1, 1))
    T[..., 0, 3], T[..., 1, 3], T[..., 2, 3] = x, y, z
    return T


def frames(layout: CellLayout, q: Array) -> dict[str, Array]:
    """Return the world poses (..., 4, 4) of the arm's links for joints (..., 6)."""
    arm = layout.arm.geometry
    base = layout.T_world_arm @ shift(0.0, 0.0, arm.wrist_height_mm + q[..., 3])
    upper = base @ rz(q[..., 0])
    fore = upper @ shift(arm.upper_mm, 0, 0) @ rz(q[..., 1])
    # the yaw belt takes back half of the elbow's turn (umi_rtx.md 5.4)
    wrist = fore @ shift(arm.fore_mm, 0, 0) @ rz(q[..., 2] - q[..., 1] / 2)
    tip = wrist @ ry(-q[..., 4]) @ rx(q[..., 5]) @ shift(arm.tool_mm, 0, 0)
    return {"carriage": base, "upper": upper, "fore": fore, "tip": tip}


def _against_limits(q: Array) -> dict[str, tuple[Array, float, float]]:
    """Return per limit of umi_rtx.md 5.2 its counts (n,) by 5.1 and 5.3, and between what."""
    deg = np.degrees(q)
    elbow, yaw = COUNTS["elbow"] * deg[:, 1], COUNTS["yaw"] * deg[:, 2]
    return {
        "shoulder": (COUNTS["shoulder"] * deg[:, 0], -2630, 2630),
        "elbow": (elbow, -2630, 2206),
        "yaw to the forearm": (yaw - elbow / 3, -1071, 1071),
        "pitch": (2 * COUNTS["wrist"] * deg[:, 4], -2642, 108),
        "roll": (2 * COUNTS["wrist"] * deg[:, 5], -3560, 4882),
        "zed": (COUNTS["zed"] * q[:, 3], -3303, -20),
    }


def limits_passed(q: Array) -> list[str]:
    """Return which limits joints (n, 6) pass by more than a count of rounding."""
    return [
        f"{name} at {value[np.argmax(np.abs(value))]:.0f} counts"
        for name, (value, low, high) in _against_limits(q).items()
        if (value < low - 1.01).any() or (value > high + 1.01).any()
    ]


@dataclass(frozen=True, eq=False)
class ArmReading:
    """One arm as the checker reads it.

    Attributes
    ----------
    frames : world poses of its links and of the tip, by name
    limits_passed : which limits joints (n, 6) pass, in words
    step : (6,) of a checked line
    rides : links that neither column nor table can come near
    kept_from : link -> what of the gripper may touch it, "hand" or "fingers"
    link_pairs : links that may touch each other
    """

    frames: Callable[[CellLayout, Array], dict[str, Array]]
    limits_passed: Callable[[Array], list[str]]
    step: Array
    rides: frozenset[str]
    kept_from: dict[str, str]
    link_pairs: frozenset[tuple[str, str]] = frozenset()


def within_limits(q: Array) -> NDArray[np.bool_]:
    """Tell which joints (n, 6) the arm would take, without the last count: (n,) bool."""
    ok = np.isfinite(q).all(axis=1)
    for value, low, high in _against_limits(q).values():
        ok &= (value >= low + 1) & (value <= high - 1)
    return ok


def joints_for(layout: CellLayout, T_world_tcp: Array) -> tuple[NDArray[np.int64], Array]:
    """Return all joints within limits that bring the tip to poses (n, 4, 4): index (m,), q (m, 6).

    By umi_rtx.md 6.5 in angles; where the hand points straight down, 24 headings are tried.
    """
    arm = layout.arm.geometry
    T = np.linalg.inv(layout.T_world_arm) @ T_world_tcp
    x_axis = T[:, :3, 0]
    wrist = T[:, :3, 3] - arm.tool_mm * x_axis
    level = np.hypot(x_axis[:, 0], x_axis[:, 1])
    tilt = np.arctan2(x_axis[:, 2], level)
    ahead = np.arctan2(x_axis[:, 1], x_axis[:, 0])
    steep = level < 1e-6
    hands = [(ahead, tilt, ~steep), (ahead + np.pi, np.sign(tilt) * np.pi - tilt, ~steep)]
    hands += [(np.full_like(tilt, a), tilt, steep) for a in np.arange(24) * np.pi / 12]
    reach = np.hypot(wrist[:, 0], wrist[:, 1])
    u, f = arm.upper_mm, arm.fore_mm
    cos_elbow = (reach**2 - u**2 - f**2) / (2 * u * f)
    index, rows = [], []
    for sign in (1.0, -1.0):
        elbow = sign * np.arccos(np.clip(cos_elbow, -1, 1))
        towards = np.arctan2(wrist[:, 1], wrist[:, 0])
        shoulder = towards - np.arctan2(f * np.sin(elbow), u + f * np.cos(elbow))
        shoulder = np.angle(np.exp(1j * shoulder))
        for heading, pitch, usable in hands:
            # what is left of the rotation once heading and pitch are taken out is the roll
            R = np.swapaxes(rz(heading) @ ry(-pitch), 1, 2)[:, :3, :3] @ T[:, :3, :3]
            roll = np.arctan2(R[:, 2, 1], R[:, 1, 1])
            to_fore = np.angle(np.exp(1j * (heading - shoulder - elbow)))
            for turn in (0.0, 2 * np.pi, -2 * np.pi):
                q = np.column_stack(
                    [
                        *(shoulder, elbow, to_fore + elbow / 2),
                        *(wrist[:, 2] - arm.wrist_height_mm, pitch, roll + turn),
                    ]
                )
                (ok,) = np.nonzero(usable & (np.abs(cos_elbow) <= 1) & within_limits(q))
                index.append(ok)
                rows.append(q[ok])
    order = np.argsort(np.concatenate(index), kind="stable")
    return np.concatenate(index)[order], np.concatenate(rows)[order]


def finger_boxes(jaw: Jaw, opening_mm: float) -> list[tuple[Array, Array]]:
    """Return the two fingers as poses in the tip frame and half edges."""
    half = np.array([jaw.finger_length_mm, jaw.finger_thickness_mm, jaw.finger_width_mm]) / 2
    away = opening_mm / 2 + half[1]
    return [(shift(-half[0], side * away, 0.0), half) for side in (1.0, -1.0)]


UMI = ArmReading(
    frames,
    limits_passed,
    STEP,
    rides=frozenset({"carriage", "upper"}),
    kept_from={"carriage": "hand", "upper": "hand", "fore": "fingers"},
)


class Checker:
    def __init__(self, layout: CellLayout, solid: Solid, arm: ArmReading = UMI) -> None:
        self.layout, self.arm = layout, arm
        self.vertices = np.asarray(solid.mesh.vertices)
        self.corners = np.asarray(solid.mesh.convex_hull.vertices)
        self.triangles = np.asarray(solid.mesh.triangles)
        self.centroid = np.asarray(solid.centroid_mm)
        self.volume = solid.volume_mm3
        model = fcl.BVHModel()
        model.beginModel(len(solid.mesh.faces), len(solid.mesh.vertices))
        model.addSubModel(self.vertices, np.asarray(solid.mesh.faces))
        model.endModel()
        self.part = fcl.CollisionObject(model)
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        self.middle = (low + high) / 2
        self.radius = float(np.linalg.norm(self.vertices - self.middle, axis=1).max())
        self.shapes: dict[tuple[float, ...], fcl.CollisionObject] = {}
        self.states = 0

    # ---- contacts -------------------------------------------------------------------------------
    def arm_parts(self, opening: float) -> list[Named]:
        cell = self.layout
        return [
            *((link.name, link.name, link.T, link.half_mm) for link in cell.arm.links),
            *(("hand", "tip", b.T, b.half_mm) for b in cell.arm_gripper.body),
            *(("finger", "tip", T, half) for T, half in finger_boxes(cell.arm_gripper, opening)),
        ]

    def still_parts(self, fixture_opening: float) -> list[Named]:
        cell = self.layout
        found: list[Named] = [
            ("column", "", cell.column.T, cell.column.half_mm),
            *((name, "", b.T, b.half_mm) for name, b in cell.obstacles.items()),
        ]
        if cell.fixed_gripper is not None:
            T_world_tcp = cell.T_world_fixed_tcp
            found += [
                ("fixture", "", T_world_tcp @ b.T, b.half_mm) for b in cell.fixed_gripper.body
            ]
            found += [
                ("fixture finger", "", T_world_tcp @ T, half)
                for T, half in finger_boxes(cell.fixed_gripper, fixture_opening)
            ]
        return found

    def touch(self, half_a: Array, T_a: Array, half_b: Array | None, T_b: Array) -> bool:
        """Tell whether a box touches another, or the part where `half_b` is None."""
        a = self._posed(half_a, T_a, "a")
        b = self._posed(half_b, T_b, "b")
        return bool(fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()))

    def _posed(self, half: Array | None, T: Array, who: str) -> fcl.CollisionObject:
        if half is None:
            thing = self.part
        else:
            key = (*np.round(half, 6).tolist(), float(ord(who)))
            if key not in self.shapes:
                self.shapes[key] = fcl.CollisionObject(fcl.Box(*(2 * np.asarray(half))))
            thing = self.shapes[key]
        thing.setTransform(fcl.Transform(np.ascontiguousarray(T[:3, :3]), T[:3, 3].copy()))
        return thing

    def contacts(
        self,
        q: Array,
        opening: float,
        fixture_opening: float,
        T_world_part: Array,
        held_by: tuple[str, ...],
    ) -> list[str]:
        """Return what touches what at joints (n, 6); the part stands at (4, 4) or (n, 4, 4)."""
        self.states += len(q)
        found: set[str] = set()
        for name, near, touches in self._pairs(
            q, opening, fixture_opening, T_world_part, held_by, 0.0
        ):
            if any(touches(k) for k in np.flatnonzero(near)):
                found.add(name)
        return sorted(found)

    def free(
        self,
        q: Array,
        opening: float,
        fixture_opening: float,
        T_world_part: Array,
        held_by: tuple[str, ...],
        margin_mm: float,
    ) -> NDArray[np.bool_]:
        """Tell which joints (n, 6) keep a margin from all that stands in the world: (n,) bool."""
        ok = np.ones(len(q), dtype=bool)
        for _, near, touches in self._pairs(
            q, opening, fixture_opening, T_world_part, held_by, margin_mm
        ):
            for k in np.flatnonzero(near & ok):
                ok[k] = not touches(k)
        return ok

    def _pairs(
        self,
        q: Array,
        opening: float,
        fixture_opening: float,
        T_world_part: Array,
        held_by: tuple[str, ...],
        margin_mm: float,
    ) -> Iterator[tuple[str, NDArray[np.bool_], Callable[[int], bool]]]:
        """Yield what might touch: its name, in which states it is near, and the exact answer."""
        n = len(q)
        f = self.arm.frames(self.layout, q)
        moving = self.arm_parts(opening)
        still = self.still_parts(fixture_opening)
        T_move = np.stack([f[frame] @ T for _, frame, T, _ in moving], axis=1)
        T_part = np.broadcast_to(T_world_part, (n, 4, 4))
        names = [m[0] for m in moving]

        def boxes(i: int, other: Named, T_other: Array, grow: float) -> tuple[Array, Touches]:
            half = moving[i][3] + grow
            T = np.broadcast_to(T_other, (n, 4, 4))
            near = _near(T_move[:, i, :3, 3], float(np.linalg.norm(half)), T, other[3])
            return near, lambda k: self.touch(half, T_move[k, i], other[3], T[k])

        for i in range(len(moving)):
            for s in still:
                if s[0] != "column" or names[i] not in self.arm.rides:
                    yield f"{names[i]} - {s[0]}", *boxes(i, s, s[2], margin_mm)
            for j in range(i):
                if self._may_touch(names[i], names[j]):
                    yield f"{names[i]} - {names[j]}", *boxes(i, moving[j], T_move[:, j], 0.0)

        middle = T_part[:, :3, :3] @ self.middle + T_part[:, :3, 3]

        def with_part(half: Array, T_other: Array) -> tuple[Array, Touches]:
            T = np.broadcast_to(T_other, (n, 4, 4))
            near = _near(middle, self.radius, T, half)
            return near, lambda k: self.touch(half, T[k], None, T_part[k])

        for s in still:
            if not (_is_jaw(s[0]) and "fixture" in held_by):
                yield f"part - {s[0]}", *with_part(s[3] + margin_mm, s[2])
        for i, m in enumerate(moving):
            if not (m[1] == "tip" and "arm" in held_by):
                yield f"part - {m[0]}", *with_part(m[3], T_move[:, i])
        for i, (name, _, _, half) in enumerate(moving):
            if name in self.arm.rides:
                continue
            low = T_move[:, i, 2, 3] - np.abs(T_move[:, i, 2, :3]) @ half
            yield f"{name} - table", low < margin_mm, lambda _: True
        low = T_part[:, 2, :3] @ self.corners.T + T_part[:, 2, 3:]
        yield "part - table", low.min(axis=1) < margin_mm - 0.2, lambda _: True

    def _may_touch(self, name: str, link: str) -> bool:
        of = self.arm.kept_from.get(link)
        if name in {"hand", "finger"}:
            return of == "hand" or (of == "fingers" and name == "finger")
        return (link, name) in self.arm.link_pairs

    def drive(
        self,
        path: Sequence[Array],
        opening: float,
        fixture_opening: float,
        carried: Grasp | None,
        T_still: Array | None,
        held_by: tuple[str, ...],
        what: str,
    ) -> list[str]:
        """Return what touches what along joint lines, and the limits they pass."""
        q = joint_lines(path, self.arm.step)
        if carried is not None:
            T_part = self.arm.frames(self.layout, q)["tip"] @ np.linalg.inv(carried.T_part_tcp)
        else:
            assert T_still is not None
            T_part = T_still
        found = self.contacts(q, opening, fixture_opening, T_part, held_by)
        return [f"{what}: {c}" for c in found + self.arm.limits_passed(np.asarray(path))]

    # ---- holding --------------------------------------------------------------------------------
    def hold(self, grasp: Grasp, jaw: Jaw, what: str) -> list[str]:
        """Return what speaks against a grip: where its pads meet walls, and what cuts into what."""
        trouble = []
        contact, width = self.pads(grasp, jaw)
        if abs(width - grasp.opening_mm) > OPENING_MM:
            trouble.append(
                f"{what}: grip {grasp.id} is to stop at {grasp.opening_mm:.2f} mm, "
                f"the walls between its pads are {width:.2f} mm apart"
            )
        if contact < MIN_CONTACT_MM2:
            trouble.append(f"{what}: a pad of grip {grasp.id} touches {contact:.0f} mm2")
        sign = -1.0 if grasp.is_inner else 1.0
        aside = grasp.opening_mm + sign * 2 * PAD_GIVE_MM
        backs = 2 * jaw.finger_thickness_mm if grasp.is_inner else 0.0
        solids = [(T, h, "finger") for T, h in finger_boxes(jaw, aside - backs)]
        solids += [(b.T, b.half_mm, "palm") for b in jaw.body]
        for T, half, name in solids:
            if self.touch(half, grasp.T_part_tcp @ T, None, np.eye(4)):
                trouble.append(f"{what}: the {name} of grip {grasp.id} is inside the part")
        if not 0 <= grasp.opening_mm <= jaw.max_mm or not 0 <= grasp.pre_open_mm <= jaw.max_mm:
            trouble.append(f"{what}: grip {grasp.id} opens wider than the jaw does")
        return sorted(set(trouble))

    def pads(self, grasp: Grasp, jaw: Jaw) -> tuple[float, float]:
        """Return the smaller contact [mm2] and the distance of the walls the pads stop at."""
        x = -(np.arange(24) + 0.5) * jaw.pad_length_mm / 24
        z = ((np.arange(13) + 0.5) / 13 - 0.5) * jaw.finger_width_mm
        cell = jaw.pad_length_mm * jaw.finger_width_mm / (len(x) * len(z))
        gx, gz = (g.ravel() for g in np.meshgrid(x, z, indexing="ij"))
        T = np.linalg.inv(grasp.T_part_tcp)
        walls = self.triangles @ T[:3, :3].T + T[:3, 3]
        first, area = [], []
        for side in (1.0, -1.0):
            wall = walls * np.array([1.0, side, 1.0])
            # outer pads come from beyond the jaw's opening inwards, inner ones from the middle out
            start = 0.0 if grasp.is_inner else grasp.opening_mm / 2 + 4.0
            y = wall_along_y(wall, gx, gz, start, outwards=grasp.is_inner)
            stop = np.min(y, initial=np.inf) if grasp.is_inner else np.max(y, initial=-np.inf)
            first.append(float(stop))
            area.append(float(cell * (np.abs(y - stop) <= PAD_GIVE_MM).sum()))
        return min(area), first[0] + first[1]


def wall_along_y(walls: Array, x: Array, z: Array, start: float, outwards: bool) -> Array:
    """Return at which y lines at (x, z), parallel to y, first meet triangles (m, 3, 3).

    They run outwards (y grows) or inwards from `start`; lines that meet nothing are left out.
    """
    low, high = walls.min(axis=1), walls.max(axis=1)
    near = (low[:, 0] <= x.max()) & (high[:, 0] >= x.min())
    near &= (low[:, 2] <= z.max()) & (high[:, 2] >= z.min())
    near &= (high[:, 1] >= start) if outwards else (low[:, 1] <= start)
    a, b, c = (walls[near, k] for k in range(3))

    def side(p: Array, r: Array) -> Array:
        return np.asarray(
            (r[:, 0] - p[:, 0])[:, None] * (z[None] - p[:, 2:])
            - (r[:, 2] - p[:, 2])[:, None] * (x[None] - p[:, :1])
        )

    u, v, w = side(b, c), side(c, a), side(a, b)
    total = u + v + w
    inside = ((u >= 0) & (v >= 0) & (w >= 0)) | ((u <= 0) & (v <= 0) & (w <= 0))
    inside &= np.abs(total) > 1e-9
    safe = np.where(inside, total, 1.0)
    y = (u * a[:, 1:2] + v * b[:, 1:2] + w * c[:, 1:2]) / safe
    if outwards:
        y = np.where(inside & (y >= start), y, np.inf).min(axis=0, initial=np.inf)
    else:
        y = np.where(inside & (y <= start), y, -np.inf).max(axis=0, initial=-np.inf)
    return np.asarray(y[np.isfinite(y)])


def joint_lines(path: Sequence[Array], step: Array) -> Array:
    """Return joint lines through waypoints in steps short enough to check (n, 6)."""
    rows = [np.asarray(path[:1])]
    for a, b in pairwise(path):
        n = max(1, int(np.ceil((np.abs(b - a) / step).max())))
        rows.append(a + np.linspace(0, 1, n + 1)[1:, None] * (b - a))
    return np.vstack(rows)


def _is_jaw(name: str) -> bool:
    return name in {"fixture", "fixture finger"}


def _near(centre: Array, radius: float, T_box: Array, half: Array) -> Array:
    """Tell which spheres (n, 3) reach into a box at (4, 4) or (n, 4, 4)."""
    offset = centre - T_box[..., :3, 3]
    local = np.einsum("...ij,...i->...j", T_box[..., :3, :3], offset)
    beyond = np.maximum(np.abs(local) - half, 0.0)
    return np.asarray(np.einsum("ij,ij->i", beyond, beyond) <= radius**2)


def apart(T_a: Array, T_b: Array) -> tuple[float, float]:
    """Return distance [mm] and angle [rad] between two poses."""
    turn = (np.trace(T_a[:3, :3].T @ T_b[:3, :3]) - 1) / 2
    return float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3])), float(np.arccos(np.clip(turn, -1, 1)))
