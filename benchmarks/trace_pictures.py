"""Pictures of parts on a table with known truth, path-traced: a second opinion beside the emulator.

    python benchmarks/trace_pictures.py PART... -o FOLDER --count 40 --seed 1 --mode both
           [--unknown PART...] [--multi 0.2] [--front-share 0.5] [--camera truth.json]
           [--scene apart|touching|overlapping|leaving] [--spp 48] [--small] [--wide] [--lamps 3]

Writes into FOLDER, picture by picture, so that others may read while it grows:
    img_NNNN.png      1280 x 1024, 8 bit, as a camera with noise, blur and vignetting gives it
    lo/img_NNNN.png   the same at 256 x 256 with 64 levels (5 x 4 boxes; stored value 4 x level)
    truth.json        the camera, and for each picture what lies where, how lit, of what material
A folder begun earlier is continued: pictures that truth.json lists are kept, so the same seed and
parts with a larger --count add to it. Picture N depends on the seed and N only.

Modes: `back` is a light table (0.8 to 1.25 times white, uneven), `front` a ring lamp, often with
a side lamp, above a matte table. `--unknown` names parts that are in no catalogue: about every
seventh picture shows one of them (`known` false). `--multi` is the share of pictures of two to five
parts. A part lies in one of its stable poses of 1 % or more, drawn by the square root of their
odds, so that rare ones turn up; all of it is inside the picture, and parts are 4 mm apart.
`--wide` draws surfaces and lamps from further apart: painted, milled, brushed along one direction,
blackened or anodised parts; one to three bar lamps, a ring, or both, and a table with a grain.
`--lamps 3` takes every scene under each of so many lamps in turn, a ring first, then bars: pictures
`img_NNNN_0.png` and so on, of which truth.json says by `scene` which belong together. The room's
own light is the same in all of them. `cellctl recognise --lamps 3` judges them jointly.
`--scene touching` lays two to six parts against each other, `--scene leaving` one or two so that
the picture's edge cuts them (`trace_touching`), `--scene overlapping` lets some of two to six fall
on others (`trace_overlapping`); of these truth.json also has the `free_share`.
`--camera` takes the `camera` of another truth.json; `--small` traces a quarter of the rays and
writes only the small pictures.

The tracer is mitsuba, no dependency of the project: pip install mitsuba, apt install libllvm19.
From the project it takes the CAD room only (solids, stable poses, the camera model): it has to
judge recognition and must not share its mistakes. One core; 4 to 15 s a picture. benchmarks/parts
holds parts drawn for this, three with their mirror images.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import cv2  # noqa: E402  (threads and path come first)
import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from trace_overlapping import put_overlapping  # noqa: E402
from trace_placing import (  # noqa: E402
    NoRoomError,
    Part,
    Truth,
    camera_of,
    camera_words,
    put_down,
    read_part,
)
from trace_scene import (  # noqa: E402
    Body,
    NoTracerError,
    PixelRays,
    radiance,
    tracer,
    write_atomically,
)
from trace_touching import put_touching  # noqa: E402

from controller.cad import CadError  # noqa: E402

Array = NDArray[np.float64]

SCENES = ("apart", "touching", "overlapping", "leaving")
CAMERA_NOTE = (
    "pixel (0,0) is the centre of the first pixel; OpenCV distortion (k1,k2,p1,p2,k3); "
    "X_c = R_wc X_w + t_wc; lo/: u_lo = (u + 0.5) / 5 - 0.5, v_lo = (v + 0.5) / 4 - 0.5, 4 x level"
)
POSE_NOTE = (
    "X_w = Rz(theta) stable_pose_R (X_cad - c) + (x, y, h): c is the centroid of the volume, "
    "h puts the lowest point on the table z = 0"
)


def draw_light(mode: str, rng: np.random.Generator) -> Truth:
    """Return lamps and table as truth.json has them."""
    seed = int(rng.integers(1, 1_000_000))
    if mode == "back":
        return {
            "mode": "back",
            "table": 0.3,
            "table_var": 0.01,
            "table_seed": seed,
            "env": rng.uniform(0.006, 0.025),
            "glow": rng.uniform(0.80, 1.25),
            "uneven": rng.uniform(0.02, 0.08),
            "tilt_x": rng.uniform(-0.04, 0.04),
            "ring": 0.0,
            "side": 0.0,
        }
    return {
        "mode": "front",
        "table": float(np.exp(rng.uniform(np.log(0.05), np.log(0.30)))),
        "table_var": rng.uniform(0.01, 0.05),
        "table_seed": seed,
        "env": rng.uniform(0.03, 0.10),
        "ring": rng.uniform(0.7, 1.15),
        "ring_r0": rng.uniform(100.0, 112.0),
        "ring_r1": rng.uniform(132.0, 146.0),
        "ring_z": rng.uniform(470.0, 560.0),
        "ring_x": rng.uniform(-12.0, 12.0),
        "ring_y": rng.uniform(-12.0, 12.0),
        "side": rng.uniform(0.1, 0.45) if rng.random() < 0.4 else 0.0,
        "side_az": rng.uniform(0.0, 360.0),
        "side_el": rng.uniform(28.0, 50.0),
    }


def draw_wide_light(rng: np.random.Generator) -> Truth:
    """Return front lamps and a table that differ more than `draw_light`'s do."""
    light = draw_light("front", rng)
    kind = str(rng.choice(["ring", "bars", "both", "sky"]))
    light |= {
        "lamps": kind,
        "table": float(np.exp(rng.uniform(np.log(0.03), np.log(0.6)))),
        "grain": rng.uniform(0.02, 0.10) if rng.random() < 0.5 else 0.0,
        "grain_deg": rng.uniform(0.0, 180.0),
    }
    if kind == "bars":
        light |= {"ring": 0.0, "side": 0.0, "bars": _bars(rng, int(rng.integers(1, 4)), 1.0)}
    elif kind == "both":
        light |= {"ring": light["ring"] * 0.6, "side": 0.0, "bars": _bars(rng, 1, 0.4)}
    elif kind == "sky":  # a bright room, and the ring weak
        light |= {"ring": light["ring"] * 0.4, "env": rng.uniform(0.25, 0.55), "side": 0.0}
    return light


def _bars(rng: np.random.Generator, count: int, strength: float) -> list[dict[str, float]]:
    start = rng.uniform(0.0, 360.0)
    return [
        {
            "strength": strength / count * rng.uniform(0.8, 1.2),
            "az": start + i * 360.0 / count + rng.uniform(-25.0, 25.0),
            "el": rng.uniform(40.0, 68.0),
            "long_mm": rng.uniform(150.0, 300.0),
        }
        for i in range(count)
    ]


def draw_lamps(count: int, light: Truth, rng: np.random.Generator) -> list[Truth]:
    """Return what of a table's light each of its lamps gives, one at a time; the room's is apart.

    Parameters
    ----------
    count : of lamps: a ring first, then bars from different sides
    light : the table and its ring, as `draw_light` has them
    """
    start = rng.uniform(0.0, 360.0)
    bare = {**light, "side": 0.0, "env": 0.0, "bars": []}
    lamps = [bare | {"lamps": "ring"}]
    for number in range(count - 1):
        az = start + number * 360.0 / max(count - 1, 2)
        bar = {**_bars(rng, 1, 1.0)[0], "az": (az + rng.uniform(-35.0, 35.0)) % 360.0}
        lamps.append(bare | {"lamps": "bar", "ring": 0.0, "bars": [bar]})
    return lamps


def draw_wide_material(rng: np.random.Generator) -> Truth:
    """Return one of the surfaces that machined parts have.

    `across` is the roughness across the tool marks, as a multiple of the one along them.
    """
    kind = str(rng.choice(["painted", "milled", "brushed", "blackened", "anodised"]))
    shares: dict[str, tuple[tuple[float, float], ...]] = {
        "painted": ((0.0, 0.1), (0.25, 0.4), (0.3, 0.5), (0.08, 0.75), (1.0, 1.0)),
        "milled": ((0.6, 0.9), (0.2, 0.4), (0.5, 0.75), (0.2, 0.45), (1.0, 1.0)),
        "brushed": ((0.6, 0.9), (0.1, 0.2), (0.45, 0.7), (0.2, 0.4), (2.0, 4.0)),
        "blackened": ((0.3, 0.6), (0.2, 0.4), (0.08, 0.25), (0.02, 0.08), (1.0, 1.0)),
        "anodised": ((0.1, 0.3), (0.15, 0.35), (0.3, 0.6), (0.05, 0.5), (1.0, 1.0)),
    }
    names = "metal", "alpha", "specular", "diffuse", "across"
    drawn = {n: rng.uniform(*bounds) for n, bounds in zip(names, shares[kind], strict=True)}
    return {"kind": kind, "marks_deg": rng.uniform(0.0, 180.0), **drawn}


def draw_material(rng: np.random.Generator) -> Truth:
    """Return what a part is made of: somewhere between matte paint and rough metal."""
    return {
        "metal": rng.uniform(0.15, 0.53),
        "alpha": rng.uniform(0.30, 0.45),
        "specular": rng.uniform(0.4, 0.6),
        "diffuse": rng.uniform(0.3, 0.55),
    }


def draw_sensor(mode: str, rng: np.random.Generator) -> dict[str, float]:
    """Return the camera's sensor; noise in grey levels, shot noise as variance a grey level."""
    return {
        "gain": 1.0 if mode == "back" else rng.uniform(0.88, 1.12),
        "blur_px": rng.uniform(0.55, 0.90),
        "vignette": rng.uniform(0.08, 0.16),
        "read": 0.22,
        "shot": 0.0009,
    }


def develop(
    light: NDArray[np.float32], sensor: dict[str, float], rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Return the 8-bit picture of radiance (height, width)."""
    height, width = light.shape
    v, u = np.mgrid[0:height, 0:width]
    middle = (width - 1) / 2, (height - 1) / 2
    r2 = ((u - middle[0]) ** 2 + (v - middle[1]) ** 2) / (middle[0] ** 2 + middle[1] ** 2)
    grey = cv2.GaussianBlur(light.astype(np.float64), (0, 0), sensor["blur_px"])
    grey *= 255.0 * sensor["gain"] * (1.0 - sensor["vignette"] * r2)
    noise = np.sqrt(sensor["read"] ** 2 + sensor["shot"] * np.maximum(grey, 0.0))
    grey += noise * rng.standard_normal(grey.shape)
    out: NDArray[np.uint8] = np.clip(np.round(grey), 0, 255).astype(np.uint8)
    return out


def digitised(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the picture at 256 x 256 with 64 levels, stored as 4 x level."""
    height, width = picture.shape
    boxes = picture.reshape(256, height // 256, 256, width // 256).mean(axis=(1, 3))
    out: NDArray[np.uint8] = (4 * np.round(boxes * 63.0 / 255.0)).astype(np.uint8)
    return out


def make_pictures(
    index: int,
    args: argparse.Namespace,
    known: Sequence[Part],
    unknown: Sequence[Part],
    sight: PixelRays,
) -> list[tuple[NDArray[np.uint8], Truth]]:
    """Return scene number index, a picture for each of its lamps, and the truth about each."""
    camera = sight.camera
    rng = np.random.default_rng([args.seed, index])
    mode = args.mode
    is_front = rng.random() < args.front_share
    if mode == "both":
        mode = "front" if is_front else "back"
    if args.scene == "apart":
        kind, placed = put_down(known, unknown, args.multi, camera, rng)
    elif args.scene == "overlapping":
        kind, placed = put_overlapping(known, unknown, camera, rng)
    else:
        kind, placed = put_touching(known, unknown, args.scene == "leaving", camera, rng)
    is_wide_light = args.wide and mode == "front"
    light = draw_wide_light(rng) if is_wide_light else draw_light(mode, rng)
    sensor = draw_sensor(mode, rng)
    materials = [draw_wide_material(rng) if args.wide else draw_material(rng) for _ in placed]
    bodies = [Body(one.triangles_mm, m) for one, m in zip(placed, materials, strict=True)]
    spp = max(4, args.spp // 4) if args.small else args.spp
    truth = {
        "image": f"img_{index:04d}.png",
        "kind": kind,
        "mode": mode,
        "seed": [args.seed, index],
        "objects": [one.words for one in placed],
        "material": materials,
        "light": light,
        "sensor": sensor,
    }
    if args.lamps == 1 or mode == "back":
        traced = radiance(sight, bodies, light, spp, int(rng.integers(2**31)))
        return [(develop(traced, sensor, rng), truth)]
    lamps = draw_lamps(args.lamps, draw_light("front", rng) | _table_of(light), rng)
    room_light = {**lamps[0], "ring": 0.0, "env": light["env"]}
    room = radiance(sight, bodies, room_light, spp, int(rng.integers(2**31)))
    made = []
    for number, lamp in enumerate(lamps):
        traced = room + radiance(sight, bodies, lamp, spp, int(rng.integers(2**31)))
        about = {"image": f"img_{index:04d}_{number}.png", "scene": index}
        words = truth | about | {"light": lamp | {"env": light["env"]}}
        made.append((develop(traced, sensor, rng), words))
    return made


def _table_of(light: Truth) -> Truth:
    """Return what of a light is the table's."""
    return {name: value for name, value in light.items() if name.startswith(("table", "grain"))}


def trace_all(args: argparse.Namespace) -> None:
    """Make the pictures that FOLDER does not have yet."""
    tracer()
    known, unknown = map(read_part, args.parts), map(read_part, args.unknown)
    known_parts, unknown_parts = list(known), list(unknown)
    words = camera_words(args.camera)
    sight = PixelRays(camera_of(words))
    (args.output / "lo").mkdir(parents=True, exist_ok=True)
    truth_file = args.output / "truth.json"
    truth: Truth = {
        "camera": words,
        "camera_note": CAMERA_NOTE,
        "pose_note": POSE_NOTE,
        "images": [],
    }
    if truth_file.exists():
        truth = json.loads(truth_file.read_text())
    done = {int(entry["seed"][1]) for entry in truth["images"]}
    for index in range(args.count):
        if index in done:
            continue
        start = time.perf_counter()
        made = make_pictures(index, args, known_parts, unknown_parts, sight)
        for picture, entry in made:
            if not args.small:
                cv2.imwrite(str(args.output / entry["image"]), picture)
            cv2.imwrite(str(args.output / "lo" / entry["image"]), digitised(picture))
        truth["images"] += [entry for _, entry in made]
        write_atomically(truth_file, json.dumps(truth, indent=1))
        first = made[0][1]
        names = ", ".join(f"{o['part']} #{o['pose_id']}" for o in first["objects"])
        seconds = time.perf_counter() - start
        print(f"{first['image']} {first['mode']:5} {seconds:5.1f} s  {names}", flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Parse, trace, and turn an error into one sentence."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="+", type=Path, help="CAD files of the catalogue")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mode", choices=("back", "front", "both"), default="both")
    parser.add_argument("--front-share", type=float, default=0.5, help="with --mode both")
    parser.add_argument("--unknown", nargs="+", type=Path, default=[], metavar="PART")
    parser.add_argument("--multi", type=float, default=0.2, help="share with several parts")
    parser.add_argument("--scene", choices=SCENES, default="apart")
    parser.add_argument("--camera", type=Path, help="a truth.json whose camera is used")
    parser.add_argument("--spp", type=int, default=48, help="rays a pixel")
    parser.add_argument("--wide", action="store_true", help="more kinds of surfaces and lamps")
    parser.add_argument("--lamps", type=int, default=1, help="pictures of a front-lit scene")
    parser.add_argument("--small", action="store_true", help="small pictures only, fewer rays")
    args = parser.parse_args(argv)
    cv2.setNumThreads(1)
    try:
        trace_all(args)
    except (NoTracerError, NoRoomError, CadError, OSError) as error:
        print(f"trace_pictures: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
