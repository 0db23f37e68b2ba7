"""Held parts with known truth, path-traced: view sets that judge the inspection.

    python benchmarks/trace_held.py FOLDER=SEED... [--count 12] [--until 21:40]

Writes into each FOLDER, specimen by specimen in turn, so that others may read while it grows:
    sNNNN/SET.json          what `cellctl inspect` reads: camera, lamps, views, pictures
    sNNNN/vNN_LAMP.png      1280 x 1024, 8 bit
    parts/NAME.stl          CAD models of parts drawn here; others are read from where they are
    sNNNN/golden/*.png      with --golden: the perfect part where it is expected, for rivals
    truth.json              for each specimen what it is, what is wrong with it and where, its true
                            poses, diameters and ends of holes, which views show the defect
A folder begun earlier is continued: what truth.json lists is kept. Specimen N of a folder depends
on its seed only, which is SEED + N.

Seeds from 100001 on are the held-out side: other parts, other lamps. Of twelve specimens four
are good (as built within part of the tolerance, or perfect), six have one defect, two are traps:
a good part whose pictures are not what they should be.

World of a set: as SET.json says; half of the held-out sets look along +y instead of down.
As-built parts: X_world = T (S (X_cad - c) + c), S = diag(scale), c = scale_about.

The tracer is mitsuba, no dependency of the project: pip install mitsuba, apt install libllvm19.
From the project it takes CAD reading only. One core, about a minute a specimen.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import cv2  # noqa: E402  (threads and path come first)
import numpy as np  # noqa: E402
import trimesh  # noqa: E402
from bench import ROOT, SHARED  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from trace_held_defects import (  # noqa: E402
    DEFECTS,
    Built,
    NoPlaceError,
    as_built,
    mesh_of,
    perfect,
    with_defect,
)
from trace_held_hold import (  # noqa: E402
    Grasp,
    NoHoldError,
    View,
    disturbed,
    find_grasps,
    find_views,
    shown,
)
from trace_held_light import (  # noqa: E402
    LAMPS,
    TILE_CELLS,
    TILE_MM,
    Look,
    Seen,
    Sight,
    Thing,
    changed_px,
    trace_view,
)
from trace_held_parts import (  # noqa: E402
    NOMINAL_SAG_MM,
    HeldPart,
    drawn,
    read_held_part,
    triangles_of,
    write_stl,
)
from trace_held_sensor import IN_FRONT, TRAPS, develop, draw_sensor, exposures  # noqa: E402
from trace_scene import NoTracerError, tracer, write_atomically  # noqa: E402

from controller.cad import CadError  # noqa: E402

Array = NDArray[np.float64]
Words = dict[str, Any]
Body = Any  # manifold3d's solid

HELD_OUT = 100_001  # the first seed of the side that nobody tunes on
ORDER = "GDGDTDGDGDTD"  # good, defect, trap: twelve specimens
GOOD = ("as_built", "as_built", "as_built", "perfect")
OURS = ROOT / "benchmarks" / "parts"
FAMILIES = {False: ("plate", "bracket", "hub"), True: ("step_block", "fork", "cover")}
FILES = {
    False: (
        OURS / "angle_bracket.csg.yaml",
        OURS / "t_slot_nut.csg.yaml",
        OURS / "cover_plate.csg.yaml",
        OURS / "spool.csg.yaml",
    ),
    True: (
        OURS / "clevis.csg.yaml",
        OURS / "l_profile.csg.yaml",
        OURS / "wedge_block.csg.yaml",
        OURS / "lever.csg.yaml",
        SHARED / "parts" / "angle_block.stl",
        SHARED / "parts" / "cycloidal_gear.stl",
    ),
}
FROM_FILE = 0.25  # share of specimens
SLIP_MM, SLIP_DEG = 1.2, 1.3  # of a part in the jaws, at most
ARM_MM, ARM_DEG = 0.1, 0.1  # of a view
PRIOR_MM, PRIOR_DEG = 1.5, 1.7
MIN_SHOWN_PX = 12  # a view with fewer changed pixels does not show a defect
MAX_TRIES = 25
TRACER = 2  # pictures of 1 have grain where a lamp is seen in part
GOLDEN_LAMPS = ("backlight", "ring")


def draw_sight(rng: np.random.Generator) -> Sight:
    f = rng.uniform(3450, 3750)
    K = np.diag([f, f * rng.uniform(0.9995, 1.0005), 1.0])
    K[:2, 2] = [640 + rng.uniform(-15, 15), 512 + rng.uniform(-15, 15)]
    distortion = np.array([rng.uniform(-0.09, 0.03), rng.uniform(-0.1, 0.1),
                           *rng.uniform(-1e-4, 1e-4, 2), 0.0])  # fmt: skip
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = [*rng.uniform(-4, 4, 2), rng.uniform(880, 930)]
    return Sight((1280, 1024), K, distortion, disturbed(T, T[:3, 3], 0.0, 0.5, rng))


def draw_station(rng: np.random.Generator, *, held_out: bool) -> Words:
    """Return lamps and panel [mm]."""
    if held_out:
        inner = float(rng.choice([rng.uniform(38, 55), rng.uniform(95, 115)]))
        width, ring_z = rng.uniform(8, 20), rng.uniform(560, 800)
        out, up, half = rng.uniform(330, 450), rng.uniform(420, 650), rng.uniform(15, 30, 2)
    else:
        inner, width, ring_z = rng.uniform(58, 85), rng.uniform(15, 30), rng.uniform(600, 720)
        out, up, half = rng.uniform(420, 560), rng.uniform(450, 600), rng.uniform(30, 55, 2)
    azimuth = rng.uniform(0, 2 * np.pi)
    return {
        "panel_mm": [float(rng.choice([420.0, 460.0, 500.0])), float(rng.choice([360.0, 400.0]))],
        "panel_albedo": 10 ** rng.uniform(-1.6, -0.7),
        "uneven": rng.uniform(0.02, 0.1),
        "tilt": rng.uniform(-0.05, 0.05),
        "held_mm": rng.uniform(195, 225),
        "ring": {
            "inner_mm": inner,
            "outer_mm": inner + width,
            "centre": [*rng.uniform(-4, 4, 2).tolist(), ring_z],
        },
        "side": {
            "centre": [out * np.cos(azimuth), out * np.sin(azimuth), up],
            "half_mm": half.tolist(),
        },
    }


def draw_hand(rng: np.random.Generator) -> Words:
    """Return sizes of fingers (thick, wide, long) and palm, and what a grip must touch."""
    return {
        "finger_mm": [rng.uniform(5, 9), rng.uniform(8, 14), rng.uniform(30, 42)],
        "tip_mm": rng.uniform(4.5, 7.5),
        "palm_side_mm": rng.uniform(12, 18),
        "palm_half_mm": [rng.uniform(14, 20), rng.uniform(11, 16)],
        "min_contact_mm2": 14.0,
    }


MATERIALS = {
    "steel": {"metal": (0.55, 0.75), "alpha": (0.18, 0.3), "specular": (0.35, 0.5),
              "diffuse": (0.18, 0.3)},
    "aluminium": {"metal": (0.5, 0.65), "alpha": (0.26, 0.42), "specular": (0.5, 0.7),
                  "diffuse": (0.35, 0.55)},
    "cast": {"metal": (0.2, 0.35), "alpha": (0.4, 0.55), "specular": (0.3, 0.45),
             "diffuse": (0.15, 0.32)},
    "black": {"metal": (0.45, 0.6), "alpha": (0.25, 0.4), "specular": (0.15, 0.25),
              "diffuse": (0.05, 0.09)},
}  # fmt: skip


def _noise(rng: np.random.Generator, along_mm: float, across_mm: float) -> NDArray[np.float32]:
    """Return noise (cells, cells) that goes on at its other side, of unit spread."""
    f = np.fft.fftfreq(TILE_CELLS, TILE_MM / TILE_CELLS)
    filtered = np.exp(-2 * np.pi**2 * ((f[None] * along_mm) ** 2 + (f[:, None] * across_mm) ** 2))
    out = np.real(np.fft.ifft2(np.fft.fft2(rng.normal(size=(TILE_CELLS,) * 2)) * filtered))
    return np.asarray(out / out.std(), np.float32)


def draw_look(rng: np.random.Generator, *, plain: bool) -> tuple[Look, Words]:
    """Return a part's material and marks, and the words for them."""
    kind = str(rng.choice(list(MATERIALS)))
    material = {k: float(rng.uniform(*v)) for k, v in MATERIALS[kind].items()}
    flat = np.zeros((TILE_CELLS,) * 2, np.float32)
    words: Words = {"kind": kind, **material}
    if plain:
        return Look(material, flat + 1, flat), words | {"finish": "plain"}
    finish = "cast" if kind == "cast" else str(rng.choice(["ground", "milled", "blasted"]))
    blotch, streak = rng.uniform(0.008, 0.03), rng.uniform(0.004, 0.02)
    albedo = 1 + blotch * _noise(rng, 6, 6) + streak * _noise(rng, 12, 0.25)
    if finish == "ground":
        height = rng.uniform(0.0002, 0.0008) * _noise(rng, 10, 0.2)
    elif finish == "milled":
        lines = round(TILE_MM / rng.uniform(0.5, 1.6))
        phase = 2 * np.pi * lines * np.arange(TILE_CELLS)[:, None] / TILE_CELLS
        wave = np.sin(phase + 0.5 * _noise(rng, 15, 3))
        height = rng.uniform(0.0005, 0.002) * wave + 0.0003 * _noise(rng, 8, 0.2)
    elif finish == "cast":
        height = rng.uniform(0.004, 0.01) * _noise(rng, 0.35, 0.35)
    else:
        height = rng.uniform(0.0005, 0.0015) * _noise(rng, 0.15, 0.15)
    if rng.random() < 0.5:
        albedo, height = albedo.T, height.T
    words |= {"finish": finish, "blotch": blotch, "streak": streak}
    clipped = np.clip(albedo, 0.7, 1.3).astype(np.float32)
    return Look(material, clipped, height.astype(np.float32)), words


def draw_dust(body: trimesh.Trimesh, rng: np.random.Generator) -> tuple[Array, int]:
    """Return triangles of grains that lie on a part, and how many there are."""
    count = int(rng.integers(2, 16))
    points, faces = trimesh.sample.sample_surface(body, count, seed=int(rng.integers(2**31)))
    grains = []
    for p, i in zip(points, faces, strict=True):
        grain = trimesh.creation.icosphere(1, float(rng.uniform(0.05, 0.16)))
        grain.apply_scale(rng.uniform(0.6, 1.6, 3))
        grain.apply_translation(p + 0.03 * body.face_normals[i])
        grains.append(grain)
    return np.asarray(trimesh.util.concatenate(grains).triangles, np.float64), count


def plain_look(**material: float) -> Look:
    flat = np.zeros((8, 8), np.float32)
    return Look(material, flat + 1, flat)


HAND_LOOK = plain_look(metal=0.5, alpha=0.35, specular=0.35, diffuse=0.2)


def draw_part(rng: np.random.Generator, *, held_out: bool) -> HeldPart:
    if rng.random() < FROM_FILE:
        files = FILES[held_out]
        return read_held_part(files[int(rng.integers(len(files)))])
    families = FAMILIES[held_out]
    number = int(rng.integers(1, 7)) + (1000 if held_out else 0)
    return drawn(str(rng.choice(families)), number)


def kind_of(number: int) -> tuple[str, str]:
    """Return class and kind of a folder's specimen, by its number from 0."""
    block, place = divmod(number, len(ORDER))
    letter = ORDER[place]
    nth = block * ORDER.count(letter) + ORDER[:place].count(letter)
    if letter == "G":
        return "good", GOOD[nth % len(GOOD)]
    if letter == "D":
        return "defect", list(DEFECTS)[nth % len(DEFECTS)]
    return "trap", [*TRAPS, IN_FRONT][nth % (len(TRAPS) + 1)]


class Specimen:
    """One specimen: drawn, held, shown, traced, told."""

    def __init__(self, seed: int, cls: str, kind: str) -> None:
        self.seed, self.cls, self.kind = seed, cls, kind
        self.held_out = seed >= HELD_OUT
        self.rng = np.random.default_rng(seed)
        self.sight = draw_sight(self.rng)
        self.station = draw_station(self.rng, held_out=self.held_out)
        self.hand = draw_hand(self.rng)
        self.sensor = draw_sensor(self.rng)
        for _ in range(MAX_TRIES):
            try:
                self._draw()
                return
            except (NoPlaceError, NoHoldError) as error:
                print(f"    seed {seed}: {error}; drawn again", flush=True)
        raise NoHoldError(f"seed {seed}: {kind} on no part")

    def _draw(self) -> None:
        rng = self.rng
        self.part = draw_part(rng, held_out=self.held_out)
        self.built = self._built()
        self.body = scaled(mesh_of(self.built.body), self.built)
        self.grasps = find_grasps(self.body, self.hand, rng)
        places = np.array([self.built.truth["place_mm"]]) if self._is_local() else np.zeros((0, 3))
        held = self.station["held_mm"]
        self.views, self.coverage = find_views(
            self.body, self.grasps, self.sight, held, rng, places
        )
        self.hidden: list[int] = []
        if self.kind == IN_FRONT:
            self.hidden = sorted(rng.choice(len(self.views), 2, replace=False).tolist())
            middle = self.body.bounding_box.centroid
            for i in self.hidden:
                grasp = self.views[i].grasp
                T = shown(-self.grasps[grasp].approach, middle, held, rng)
                self.views[i] = View(grasp, T)
        self.look, self.material = draw_look(rng, plain=self.kind == "perfect")
        self.dust = (
            (np.zeros((0, 3, 3)), 0) if self.kind == "perfect" else draw_dust(self.body, rng)
        )

    def _is_local(self) -> bool:
        return self.cls == "defect" and self.kind not in ("mirrored", "wrong_part")

    def _built(self) -> Built:
        if self.kind == "perfect":
            return perfect(self.part)
        if self.cls == "defect":
            return with_defect(self.part, self.kind, self.rng)
        return as_built(self.part, self.rng)

    def things(self, view: View, body: Body | None = None) -> list[Thing]:
        """Return what stands before the camera, the part first."""
        grasp: Grasp = self.grasps[view.grasp]
        triangles = self.built.scaled(triangles_of(body or self.built.body))
        stain = None if body is not None else self.built.stain
        out = [Thing(triangles, view.T, self.look, stain=stain)]
        for box in grasp.boxes:
            out.append(Thing(box.triangles_mm(), view.T @ box.T, HAND_LOOK, is_smooth=False))
        if self.dust[1]:
            grey = plain_look(metal=0.05, alpha=0.5, specular=0.3, diffuse=0.4)
            out.append(Thing(self.dust[0], view.T, grey, is_smooth=False))
        return out

    def trace(self) -> tuple[list[dict[str, Any]], list[Words]]:
        """Return pictures view by view, and what each view shows."""
        seen: list[Seen] = []
        shows: list[Words] = []
        for number, view in enumerate(self.views):
            things = self.things(view)
            seen.append(
                trace_view(self.sight, things, self.station, LAMPS, self.seed * 100 + number)
            )
            words: Words = {"view": f"v{number:02d}", "grasp": view.grasp}
            if self.cls == "defect":
                count, middle = changed_px(self.sight, things, self.things(view, self.built.sound))
                words |= {"shows_px": count, "at_px": np.round(middle, 1).tolist()}
                words["visible"] = count >= MIN_SHOWN_PX
            words["T_world_part_true"] = rounded(self._world() @ view.T)
            shows.append(words)
        self.gains = self.exposed(seen)
        rng = np.random.default_rng([self.seed, 1])
        pictures = [
            {lamp: develop(s.radiance[lamp], self.gains[lamp], self.sensor, rng) for lamp in LAMPS}
            for s in seen
        ]
        self.trap: Words = {}
        if self.cls == "trap" and self.kind in TRAPS:
            self.trap = TRAPS[self.kind](pictures, rng)
        elif self.kind == IN_FRONT:
            self.trap = {"views": self.hidden}
        return pictures, shows

    def exposed(self, seen: Sequence[Seen]) -> dict[str, float]:
        """Return a gain by lamp for these views."""
        return exposures([s.radiance for s in seen], [s.label for s in seen])

    def expected(self) -> list[tuple[Array, list[Array]]]:
        """Return where the cell believes part and gripper's boxes are, view by view."""
        rng = np.random.default_rng([self.seed, 2])
        middle = self.body.bounding_box.centroid
        slips = [disturbed(np.eye(4), middle, SLIP_MM, SLIP_DEG, rng) for _ in self.grasps]
        out = []
        for view in self.views:
            pivot = view.T[:3, :3] @ middle + view.T[:3, 3]
            T = disturbed(view.T @ slips[view.grasp], pivot, ARM_MM, ARM_DEG, rng)
            arm = disturbed(np.eye(4), pivot, ARM_MM, ARM_DEG, rng)
            out.append((T, [arm @ view.T @ box.T for box in self.grasps[view.grasp].boxes]))
        return out

    def trace_golden(self, gains: Words) -> list[dict[str, NDArray[np.uint8]]]:
        """Return pictures of the perfect part of the same material where it is expected."""
        triangles = triangles_of(self.part.build())
        flat = np.zeros((8, 8), np.float32)
        look = Look(self.look.material, flat + 1, flat)
        rng = np.random.default_rng([self.seed, 3])
        out = []
        for number, (T, boxes) in enumerate(self.expected()):
            things = [Thing(triangles, T, look)]
            held_by = self.grasps[self.views[number].grasp].boxes
            for box, at in zip(held_by, boxes, strict=True):
                things.append(Thing(box.triangles_mm(), at, HAND_LOOK, is_smooth=False))
            seed = self.seed * 100 + 50 + number
            seen = trace_view(self.sight, things, self.station, GOLDEN_LAMPS, seed, is_coarse=True)
            out.append(
                {
                    k: develop(light, gains[k], self.sensor, rng)
                    for k, light in seen.radiance.items()
                }
            )
        return out

    def _world(self) -> Array:
        """Return the pose of the station in the set's world."""
        T = np.eye(4)
        if self.held_out and self.seed % 2:
            T[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # panel's normal is -y
            T[:3, 3] = [430.0, 250.0, 450.0]
        return T

    def set_words(self, part: str) -> Words:
        """Return SET.json: what the cell believes."""
        T_world = self._world()
        ring, side = self.station["ring"], self.station["side"]
        views = []
        for number, (T, boxes) in enumerate(self.expected()):
            halves = [box.half_mm for box in self.grasps[self.views[number].grasp].boxes]
            views.append(
                {
                    "id": f"v{number:02d}",
                    "T_world_part": rounded(T_world @ T),
                    "prior_mm": PRIOR_MM,
                    "prior_deg": PRIOR_DEG,
                    "gripper_boxes": [
                        {"T": rounded(T_world @ box), "half_mm": np.round(half, 4).tolist()}
                        for box, half in zip(boxes, halves, strict=True)
                    ],
                    "pictures": {lamp: f"v{number:02d}_{lamp}.png" for lamp in LAMPS},
                }
            )

        def at(p: Sequence[float]) -> list[float]:
            point: list[float] = np.round(
                T_world[:3, :3] @ np.asarray(p) + T_world[:3, 3], 3
            ).tolist()
            return point

        return {
            "schema": "cellctl.views/1",
            "part": part,
            "unit": "mm",
            "camera": {
                "size_px": list(self.sight.size_px),
                "K": self.sight.K.tolist(),
                "distortion": self.sight.distortion.tolist(),
                "T_world_cam": rounded(T_world @ self.sight.T_world_cam, 9),
            },
            "lamps": {
                "backlight": {
                    "kind": "panel",
                    "centre": at([0, 0, 0]),
                    "normal": (T_world[:3, :3] @ [0, 0, 1]).tolist(),
                    "up": (T_world[:3, :3] @ [0, 1, 0]).tolist(),
                    "size": self.station["panel_mm"],
                },
                "ring": {
                    "kind": "ring",
                    "centre": at(ring["centre"]),
                    "radius": round((ring["inner_mm"] + ring["outer_mm"]) / 2, 2),
                },
                "side": {"kind": "spot", "centre": at(side["centre"])},
            },
            "views": views,
        }

    def truth_words(self, shows: list[Words]) -> Words:
        """Return what is true of it."""
        built = self.built
        expected = {"good": "not_fail", "defect": "fail", "trap": "indeterminate"}[self.cls]
        return {
            "part": self.part.name,
            "cls": self.cls,
            "kind": self.kind,
            "expected": expected,
            "size_mm": built.truth.get("size_mm"),
            "place_mm": built.truth.get("place_mm"),
            "faces": built.truth.get("faces", []),
            "dims": built.truth.get("dims", {}),
            "visible_views": [s["view"] for s in shows if s.get("visible")],
            "coverage": round(self.coverage, 4),
            "scale": built.scale.tolist(),
            "scale_about": built.about_mm.tolist(),
            "poses": shows,
            "holes": self._holes(),
            "grasps": [
                {"closing": g.closing.tolist(), "approach": g.approach.tolist(),
                 "width_mm": g.width_mm, "contact_mm2": g.contact_mm2}
                for g in self.grasps
            ],
            "material": self.material,
            "dust": self.dust[1],
            "station": self.station,
            "sensor": self.sensor,
            "gains": self.gains,
            "trap": self.trap,
            "seed": self.seed,
        }  # fmt: skip

    def _holes(self) -> list[Words]:
        out = []
        for nominal in self.part.holes:
            now = self.built.holes.get(nominal.id)
            words: Words = {
                "id": nominal.id,
                "axis": nominal.axis.tolist(),
                "nominal_d_mm": nominal.diameter_mm,
                "nominal_ends": [nominal.mouth_mm.tolist(), nominal.bottom_mm.tolist()],
                "exists": now is not None,
            }
            if now is not None:
                ends = self.built.scaled(np.array([now.mouth_mm, now.bottom_mm]))
                # across an axis the part is stretched; its area tells the mean diameter
                stretch = np.prod(self.built.scale) / np.linalg.norm(now.axis * self.built.scale)
                shift = now.mouth_mm - nominal.mouth_mm
                shift -= (shift @ nominal.axis) * nominal.axis
                words |= {
                    "true_d_mm": round(float(now.diameter_mm * np.sqrt(stretch)), 5),
                    "true_ends": ends.tolist(),
                    "shift_mm": np.round(shift, 5).tolist(),
                }
            out.append(words)
        return out


def scaled(mesh: trimesh.Trimesh, built: Built) -> trimesh.Trimesh:
    return trimesh.Trimesh(built.scaled(mesh.vertices), mesh.faces, process=False)


def rounded(T: Array, digits: int = 7) -> list[list[float]]:
    out: list[list[float]] = np.round(T, digits).tolist()
    return out


def write_pictures(folder: Path, pictures: Sequence[Mapping[str, NDArray[np.uint8]]]) -> None:
    """Write the pictures of a set, view by view, named as its SET.json names them."""
    for view, lamps in enumerate(pictures):
        for lamp, picture in lamps.items():
            write_picture(folder / f"v{view:02d}_{lamp}.png", picture)


def write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    partial = path.with_suffix(".partial.png")
    cv2.imwrite(str(partial), picture)
    partial.replace(path)


class Folder:
    """A folder of specimens that is begun or continued."""

    def __init__(self, path: Path, seed: int) -> None:
        self.path, self.seed = path, seed
        (path / "parts").mkdir(parents=True, exist_ok=True)
        self.file = path / "truth.json"
        self.truth: Words = {
            "schema": "heldout.inspect/1",
            "conventions": "places in the CAD frame of the nominal part, mm; "
            "X_world = T (S (X_cad - c) + c), S = diag(scale), c = scale_about",
            "specimens": [],
        }
        if self.file.exists():
            self.truth = json.loads(self.file.read_text())
        self.done = {s["specimen"] for s in self.truth["specimens"]}

    def next_number(self) -> int:
        number = 0
        while self.name(number) in self.done:
            number += 1
        return number

    @staticmethod
    def name(number: int) -> str:
        return f"s{number + 1:04d}"

    def specimen(self, number: int) -> Specimen:
        """Return one specimen, not traced yet."""
        return Specimen(self.seed + number, *kind_of(number))

    def add(self, number: int) -> None:
        """Make one specimen."""
        start = time.perf_counter()
        specimen = self.specimen(number)
        pictures, shows = specimen.trace()
        folder = self.path / self.name(number)
        folder.mkdir(exist_ok=True)
        write_pictures(folder, pictures)
        part = self._cad(specimen.part, folder)
        write_atomically(folder / "SET.json", json.dumps(specimen.set_words(part)))
        seconds = round(time.perf_counter() - start, 1)
        words = {"specimen": self.name(number), **specimen.truth_words(shows), "render_s": seconds}
        every = [*self.truth["specimens"], {**words, "tracer": TRACER}]
        self.truth["specimens"] = sorted(every, key=lambda s: str(s["specimen"]))
        self.done.add(self.name(number))
        write_atomically(self.file, json.dumps(self.truth))
        seen = (
            f"{len(words['visible_views'])} of {len(shows)} views show it"
            if specimen.cls == "defect"
            else ""
        )
        print(f"{self.path.name} {self.name(number)} {specimen.kind:16} {specimen.part.name:18} "
              f"{specimen.material['kind']:9} {seconds:5.1f} s  {seen}", flush=True)  # fmt: skip

    def add_golden(self) -> bool:
        """Add golden views to the first specimen without; return False where all have them."""
        for words in self.truth["specimens"]:
            folder = self.path / words["specimen"] / "golden"
            if folder.exists():
                continue
            start = time.perf_counter()
            specimen = Specimen(words["seed"], words["cls"], words["kind"])
            views = specimen.trace_golden(words["gains"])
            partial = folder.with_suffix(".partial")
            partial.mkdir(exist_ok=True)
            for view, lamps in enumerate(views):
                for lamp, picture in lamps.items():
                    cv2.imwrite(str(partial / f"v{view:02d}_{lamp}.png"), picture)
            partial.rename(folder)
            seconds = time.perf_counter() - start
            print(f"{self.path.name} {words['specimen']} golden {seconds:5.1f} s", flush=True)
            return True
        return False

    def _cad(self, part: HeldPart, folder: Path) -> str:
        if part.path is not None:
            return os.path.relpath(part.path, folder)
        path = self.path / "parts" / f"{part.name}.stl"
        if not path.exists():
            write_stl(part.build(sag_mm=NOMINAL_SAG_MM), path)
        return os.path.relpath(path, folder)


def is_late(until: str | None) -> bool:
    now = datetime.datetime.now().astimezone().strftime("%H:%M")
    return until is not None and now >= until


def main(argv: Sequence[str] | None = None) -> int:
    """Parse, trace, and turn an error into one sentence."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", metavar="FOLDER=SEED", help="filled in turn")
    parser.add_argument("--count", type=int, default=12, help="specimens a folder")
    parser.add_argument("--until", help="HH:MM; no specimen is begun later")
    parser.add_argument("--golden", action="store_true", help="add golden views, for rivals")
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    try:
        tracer()
        folders = []
        for word in args.folders:
            path, _, seed = word.rpartition("=")
            folders.append(Folder(Path(path), int(seed)))
        while any(f.next_number() < args.count for f in folders) and not is_late(args.until):
            folder = min(folders, key=Folder.next_number)
            folder.add(folder.next_number())
        while args.golden and not is_late(args.until):
            added = [folder.add_golden() for folder in folders]
            if not any(added):
                break
    except (NoTracerError, NoHoldError, CadError, OSError, ValueError) as error:
        print(f"trace_held: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
