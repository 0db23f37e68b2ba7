"""A library of many parts, made by varying a few: as STL files in a folder that can be kept.

python benchmarks/recognition_library.py FOLDER [--count 1000] [--seed 4] [--parts PATH]

The originals come first, under their own names. Every other part is one of them, stretched along
its three axes by 0.8 to 1.25 each, every second one mirrored too. Two parts of one origin differ
by 1.5 % at least in their length or their width whichever way they lie, so that a picture can
tell them apart.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from recognition_parts import cad_files, read_mesh  # noqa: E402
from shared_files import SHARED  # noqa: E402  (path set above)

from controller.cad.compiled import part_name  # noqa: E402

Array = NDArray[np.float64]

MIN_FACTOR, MAX_FACTOR = 0.8, 1.25
APART = 0.005
APART_FROM_ORIGINAL = 0.03
LONGEST_MM = 190.0  # fits into the picture whichever way it is turned
TRIES = 2000


def make_library(folder: Path, originals: list[Path], count: int, seed: int) -> list[Path]:
    """Write the library and return its files; what is there already from the same recipe stays.

    Raises
    ------
    ValueError : fewer parts are asked for than there are originals, or too many to differ
    """
    if count < len(originals):
        raise ValueError(f"{count} parts asked, there are {len(originals)} originals already")
    recipe = {
        "originals": [p.name for p in originals],
        "bytes": [p.stat().st_size for p in originals],
        "count": count,
        "seed": seed,
        "span": [MIN_FACTOR, MAX_FACTOR, APART, APART_FROM_ORIGINAL],
    }
    note = folder / "library.json"
    if note.is_file():
        stored = json.loads(note.read_text())
        files = [folder / name for name in stored["files"]]
        if stored["recipe"] == recipe and all(f.is_file() for f in files):
            return files
    folder.mkdir(parents=True, exist_ok=True)
    meshes = {part_name(p): read_mesh(p) for p in originals}
    # mirror images and sisters of one size are one family: they too have to differ in size
    taken: dict[tuple[int, ...], list[tuple[Array, float]]] = {}
    files = []
    for path in originals:
        file = folder / f"{part_name(path)}.stl"
        meshes[part_name(path)].export(file)
        files.append(file)
        size = np.asarray(meshes[part_name(path)].extents)
        taken.setdefault(_family(size), []).append((np.sort(size), APART_FROM_ORIGINAL))
    names = list(meshes)
    for number in range(count - len(originals)):
        name = names[number % len(names)]
        mesh = meshes[name]
        family = taken[_family(np.asarray(mesh.extents))]
        rng = np.random.default_rng([seed, number])
        factors = _new_factors(np.asarray(mesh.extents), family, rng)
        family.append((np.sort(mesh.extents * factors), APART))
        varied = mesh.copy()
        if (number // len(names)) % 2:
            factors = factors * [-1, 1, 1]
        varied.apply_scale(factors)  # turns the triangles round where it mirrors
        file = folder / f"{name}_v{number // len(names):03d}.stl"
        varied.export(file)
        files.append(file)
    note.write_text(json.dumps({"recipe": recipe, "files": [f.name for f in files]}))
    return files


def _family(size: Array) -> tuple[int, ...]:
    return tuple(np.round(np.log(np.sort(size)) / 0.02).astype(int))


def _new_factors(size: Array, family: list[tuple[Array, float]], rng: np.random.Generator) -> Array:
    sizes = np.log(np.array([known for known, _ in family]))
    apart = np.array([least for _, least in family])
    for _ in range(TRIES):
        factors = np.exp(rng.uniform(np.log(MIN_FACTOR), np.log(MAX_FACTOR), 3))
        varied = np.sort(size * factors)
        if np.linalg.norm(varied) > LONGEST_MM:
            continue
        off = np.abs(sizes - np.log(varied))
        # lying on any side, two of the three sizes are seen
        seen = np.stack([off[:, [0, 1]], off[:, [1, 2]], off[:, [0, 2]]]).max(axis=2)
        if (seen >= apart).all():
            return factors
    raise ValueError(f"no room for another variation among {len(family)}; ask for fewer parts")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=4)
    parser.add_argument("--parts", type=Path, default=SHARED / "parts")
    args = parser.parse_args()
    originals = sorted(cad_files([args.parts]).values())
    files = make_library(args.folder, originals, args.count, args.seed)
    print(f"{len(files)} parts in {args.folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
