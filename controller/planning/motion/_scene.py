"""The arm among its surroundings: which configurations are free of contact.

Two stages. Links, hands and obstacles are boxes, and so is the part at first: the test of boxes
is vectorised, 0.02 ms a configuration, and what it finds free is free. Where nothing but the
part's box touches something and the part's triangles are known, they decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..boxes import BoolArray, lowest_z, overlap, stack
from ..layout import Box, CellLayout, FloatArray, IntArray, Jaw
from ._inverse import tip_pose
from ._shape import PartShape, PlacedShape, Triangles

STANDING = "the part standing there"
SELF_MARGIN_MM = 3.0  # links know each other's place better than the world's
_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
Hands = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What the arm may not touch just now, and what it carries.

    Attributes
    ----------
    hand_opening_mm, fixture_opening_mm : of the two jaws
    carried : the part as a box in the tip frame, or None
    standing : boxes in the world beside the layout's own, for instance the part in the fixture
    ignore : names of world boxes that may be touched
    carried_mesh : the part's triangles in the tip frame; decides where `carried` touches, which
        follows from it if None
    standing_meshes : triangles in the world that the empty hand or another part may not touch
    """

    layout: CellLayout
    hand_opening_mm: float
    fixture_opening_mm: float
    carried: Box | None = None
    standing: tuple[Box, ...] = ()
    ignore: frozenset[str] = field(default_factory=frozenset)
    carried_mesh: PlacedShape | None = None
    standing_meshes: tuple[PlacedShape, ...] = ()

    def __post_init__(self) -> None:
        if self.carried is None and self.carried_mesh is not None:
            object.__setattr__(self, "carried", self.carried_mesh.box)

    def with_carried(self, carried: Box | None, mesh: PlacedShape | None = None) -> Scene:
        """Return the scene with something else in the hand."""
        return replace(self, carried=carried, carried_mesh=mesh)

    def statics(self) -> list[tuple[str, Box]]:
        """Return the world boxes by name; those that bound `standing_meshes` come last."""
        named = [(name, box) for name, box in self._boxes() if name not in self.ignore]
        return named + [(STANDING, mesh.box) for mesh in self.standing_meshes]

    def _boxes(self) -> list[tuple[str, Box]]:
        layout = self.layout
        named = [(name, box) for name, box in layout.obstacles.items()]
        if (fixture := layout.fixture) is not None:
            named += self._fixture(fixture)
        return named + [(STANDING, b) for b in self.standing]

    def _fixture(self, fixture: Jaw) -> list[tuple[str, Box]]:
        T = self.layout.T_world_fixture
        fingers = fixture.fingers(self.fixture_opening_mm)
        return [
            *(("fixture", b.placed(T)) for b in fixture.body),
            *(("fixture fingers", b.placed(T)) for b in fingers),
        ]

    def reach_mm(self) -> tuple[float, float]:
        """Return how far hand and part reach from the wrist's centre and from the approach axis."""
        boxes = [*self.layout.hand.body, *self.layout.hand.fingers(self.hand_opening_mm)]
        if self.carried is not None:
            boxes.append(self.carried)
        T, half = stack(boxes)
        corners = T[:, None, :3, 3] + (half[:, None] * _SIGNS) @ np.swapaxes(T[:, :3, :3], 1, 2)
        corners[..., 0] += self.layout.arm.tool_mm
        away = np.linalg.norm(corners, axis=2), np.linalg.norm(corners[..., 1:], axis=2)
        return float(away[0].max()), float(away[1].max())

    def names(self) -> tuple[str, ...]:
        """Return what the indices of `contacts` stand for."""
        return ("table", *(name for name, _ in self.statics()), "the arm itself", "column")

    def free(
        self,
        q: FloatArray,
        margin_mm: float | FloatArray = 10.0,
        table_margin_mm: float | FloatArray | None = None,
        hand: Hands | None = None,
        part: tuple[PartShape, FloatArray] | None = None,
    ) -> BoolArray:
        """Tell which configurations (n, 6) keep the margins: (n,) bool; arguments as `contacts`."""
        return np.asarray(self.contacts(q, margin_mm, table_margin_mm, hand, part) < 0)

    def contacts(
        self,
        q: FloatArray,
        margin_mm: float | FloatArray = 10.0,
        table_margin_mm: float | FloatArray | None = None,
        hand: Hands | None = None,
        part: tuple[PartShape, FloatArray] | None = None,
    ) -> IntArray:
        """Return per configuration (n, 6) the index of a contact in `names`, -1 if free.

        Parameters
        ----------
        margin_mm, table_margin_mm : one for all, or (n,); the table's is the same if None
        hand : replaces body, fingers and `carried` by boxes of its own per row, in the tip frame:
            poses (n, m, 4, 4) and half edges (n, m, 3), the hand's body first
        part : replaces `carried_mesh` by triangles at a pose of its own per row, in the tip frame
            (n, 4, 4); the box that bounds them is added to `hand`
        """
        n = len(q)
        if n == 0:
            return np.zeros(0, dtype=np.int64)
        margin = np.broadcast_to(np.asarray(margin_mm, dtype=np.float64), (n,))
        floor = np.broadcast_to(
            margin if table_margin_mm is None else np.asarray(table_margin_mm, np.float64), (n,)
        )
        T_tip = tip_pose(self.layout, q)
        T, half, shape, T_part = self._moving(q, T_tip, hand, part)
        touching = self._touching(T, half, margin, floor)
        # the part is the last of what moves; any other contact between boxes is a contact
        loose = np.zeros(touching.shape[1:], dtype=bool)
        if shape is not None:
            loose[-1] = True
        if self.standing_meshes:
            first = loose.shape[1] - 2 - len(self.standing_meshes)
            loose[:, first : loose.shape[1] - 2] = True
        fixed = (touching & ~loose).any(axis=1)
        found = np.where(fixed.any(axis=1), fixed.argmax(axis=1), -1)
        rows = np.flatnonzero((found < 0) & touching.any(axis=(1, 2)))
        if len(rows):
            exact = _Exact(self, T, half, margin, floor, shape, T_part)
            for row in rows:
                found[row] = exact.first_contact(row, touching[row])
        return np.asarray(found)

    def _moving(
        self,
        q: FloatArray,
        T_tip: FloatArray,
        hand: Hands | None,
        part: tuple[PartShape, FloatArray] | None,
    ) -> tuple[FloatArray, FloatArray, PartShape | None, FloatArray]:
        """Return world poses (n, k, 4, 4), half edges of links, hand and part, and its triangles.

        The part's own pose comes per row (n, 4, 4), in the world; the shape is None where there
        are no triangles.
        """
        n = len(q)
        shape, T_part = None, np.zeros((0, 4, 4))
        in_tip: list[Box] = []
        if hand is None:
            in_tip = [*self.layout.hand.body, *self.layout.hand.fingers(self.hand_opening_mm)]
            if part is None and self.carried is not None:
                in_tip.append(self.carried)
                if self.carried_mesh is not None:
                    shape, T_part = self.carried_mesh.shape, T_tip @ self.carried_mesh.T
        T_hand, half_hand = stack(in_tip) if hand is None else hand
        T_links, half_links = self._links(q)
        poses = [T_links, T_tip[:, None] @ T_hand]
        halves = [
            np.broadcast_to(half_links, (n, 3, 3)),
            np.broadcast_to(half_hand, (n, T_hand.shape[-3], 3)),
        ]
        if part is not None:
            shape, T_part = part[0], T_tip @ part[1]
            poses.append((T_part @ shape.box.T)[:, None])
            halves.append(np.broadcast_to(shape.box.half_mm, (n, 1, 3)))
        return np.concatenate(poses, axis=1), np.concatenate(halves, axis=1), shape, T_part

    def _touching(
        self, T: FloatArray, half: FloatArray, margin: FloatArray, floor: FloatArray
    ) -> BoolArray:
        """Return which box of the arm touches what (n, k, names), all of them as boxes."""
        n, moving = T.shape[:2]
        body_n = len(self.layout.hand.body)
        T_static, half_static = stack([b for _, b in self.statics()])
        still = len(T_static)
        touching = np.zeros((n, moving, 3 + still), dtype=bool)
        touching[:, 2:, 0] = lowest_z(T[:, 2:], half[:, 2:]) < floor[:, None]

        grown = half + margin[:, None, None]
        pairs = [(i, j) for i in range(moving) for j in range(still)]
        hits = _pairs(T, grown, T_static[None], half_static[None], pairs)
        touching[:, :, 1 : 1 + still] = hits.reshape(n, moving, still)

        # neighbours along the chain are kept apart by the joint limits, not by these coarse boxes:
        # the palm beside the forearm's end, the neck inside it
        own = [(i, j) for i in range(3, moving) for j in (0, 1)]
        own += [(i, 2) for i in range(3 + body_n, moving)]
        hits = _pairs(T, half + SELF_MARGIN_MM, T, half, own)
        for column, (i, _) in enumerate(own):
            touching[:, i, 1 + still] |= hits[:, column]

        T_column, half_column = stack([self.layout.column])
        behind = [(i, 0) for i in range(2, moving)]
        touching[:, 2:, 2 + still] = _pairs(T, grown, T_column[None], half_column[None], behind)
        return touching

    def _links(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        layout = self.layout
        n = len(q)
        T = np.zeros((n, 3, 4, 4))
        T[:, :, 3, 3] = 1.0
        T[:, :, 2, 2] = 1.0
        T[:, :, 2, 3] = (layout.arm.wrist_height_mm + q[:, 3])[:, None]
        for link, angle in enumerate((np.zeros(n), q[:, 0], q[:, 0] + q[:, 1])):
            c, s = np.cos(angle), np.sin(angle)
            T[:, link, 0, 0], T[:, link, 0, 1] = c, -s
            T[:, link, 1, 0], T[:, link, 1, 1] = s, c
        T[:, 2, 0, 3] = layout.arm.upper_mm * np.cos(q[:, 0])
        T[:, 2, 1, 3] = layout.arm.upper_mm * np.sin(q[:, 0])
        T_box, half = stack([layout.carriage, layout.upper, layout.fore])
        return np.asarray(layout.T_world_arm @ T @ T_box), half

    def arm_boxes(self, q: FloatArray) -> list[Box]:
        """Return the world boxes of the links and the open or closed hand at one q (6,)."""
        T_links, half = self._links(q[None])
        boxes = [Box(T, h) for T, h in zip(T_links[0], half, strict=True)]
        T_tip = tip_pose(self.layout, q)
        hand = [*self.layout.hand.body, *self.layout.hand.fingers(self.hand_opening_mm)]
        return boxes + [b.placed(T_tip) for b in hand]


class _Exact:
    """The second stage: rows that only boxes round triangles have found touching, one by one."""

    def __init__(
        self,
        scene: Scene,
        T: FloatArray,
        half: FloatArray,
        margin: FloatArray,
        floor: FloatArray,
        shape: PartShape | None,
        T_part: FloatArray,
    ) -> None:
        self._T, self._half, self._margin, self._floor = T, half, margin, floor
        self._shape, self._T_part = shape, T_part
        self._part = None if shape is None else Triangles(shape)
        self._statics = [box for _, box in scene.statics()]
        self._column = scene.layout.column
        self._body_n = len(scene.layout.hand.body)
        self._standing = []
        for mesh in scene.standing_meshes:
            triangles = Triangles(mesh.shape)
            triangles.place(mesh.T)
            self._standing.append(triangles)

    def first_contact(self, row: int, touching: BoolArray) -> int:
        """Return the lowest index among contacts (k, names) of boxes that stands, -1 if none."""
        last = touching.shape[0] - 1
        if self._part is not None:
            self._part.place(self._T_part[row])
        for name, i in np.argwhere(touching.T):
            if self._stands(row, int(i), int(name), is_part=i == last):
                return int(name)
        return -1

    def _stands(self, row: int, i: int, name: int, *, is_part: bool) -> bool:
        part = self._part if is_part else None
        margin = float(self._margin[row])
        still = len(self._statics)
        if name == 0:
            if part is None or self._shape is None:
                return True
            T = self._T_part[row]
            return bool((self._shape.hull_mm @ T[2, :3]).min() + T[2, 3] < self._floor[row])
        if name == 1 + still:
            # reached for the part alone: the hand's own contacts with the arm are between boxes
            return part is not None and any(
                part.touch(self._T[row, j], self._half[row, j] + SELF_MARGIN_MM) for j in range(3)
            )
        if name == 2 + still:
            box = self._column
            return part is None or part.touch(box.T, box.half_mm + margin)
        box = self._statics[name - 1]
        if part is not None and not part.touch(box.T, box.half_mm + margin):
            return False
        mesh = name - 1 - (still - len(self._standing))
        if mesh < 0:
            return True
        # two parts: each against the box round the other, which errs on the safe side
        return self._standing[mesh].touch(self._T[row, i], self._half[row, i] + margin)


def _pairs(
    T_a: FloatArray,
    half_a: FloatArray,
    T_b: FloatArray,
    half_b: FloatArray,
    pairs: Sequence[tuple[int, int]],
) -> BoolArray:
    """Return (n, pairs) contacts of boxes a (n, a, 4, 4), (n, a, 3) with b (n or 1, b, ...)."""
    n, m = len(T_a), len(pairs)
    result = np.zeros((n, m), dtype=bool)
    if n == 0 or m == 0:
        return result
    i, j = np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])
    # spheres first: most pairs are far apart and need no copy of their poses
    radius = np.linalg.norm(half_a, axis=2)[:, i] + np.linalg.norm(half_b, axis=2)[:, j]
    offset = T_b[:, j][..., :3, 3] - T_a[:, i][..., :3, 3]
    near = np.einsum("nmk,nmk->nm", offset, offset) <= radius**2
    row, column = np.nonzero(near)
    if len(row):
        a, b = i[column], j[column]
        other = row if len(T_b) > 1 else np.zeros_like(row)
        result[row, column] = overlap(T_a[row, a], half_a[row, a], T_b[other, b], half_b[other, b])
    return result
