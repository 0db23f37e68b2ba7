"""`cellctl recognise`: the objects in stored pictures of the table, one answer each."""

import time
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from controller.cad.compiled import CompileOptions, options_among, part_name
from controller.catalogue import Jobs, PartWork
from controller.config import CAD_FORMATS, ConfigError, is_cad_file
from controller.imaging import Camera
from controller.recognition import Library, Recognition, recognise
from controller.recognition.explain import explain
from controller.recognition.stored import open_library
from controller.stored.pictures import SaidOnce, StoredPicture, pictures_among, read_picture

from ..inputs.ahead import jobs_among, working_ahead
from ..inputs.calibration_file import load_calibration
from ..inputs.checks import require_files
from ..terminal.output import emit, print_line, warn
from ._explain_folder import ExplainFolder, show_tables
from .arguments import RecogniseOptions


def recognise_images(options: RecogniseOptions) -> int:
    """Recognise the objects in each picture.

    Returns
    -------
    exit code: 2 if a picture cannot be read, after answering for the others; 1 if no picture shows
    a known part; else 0

    Raises
    ------
    ConfigError : the pictures do not make whole scenes
    """
    lamps, unit, jobs = options.lamps, options.unit and options.unit.value, jobs_among(options.jobs)
    require_files([options.calibration, *options.parts, *options.images])
    camera = load_calibration(options.calibration)
    files = _cad_files(options.parts)
    paths, doubled = pictures_among(options.images)
    folder = ExplainFolder(options.explain) if options.explain is not None else None
    for remark in doubled:
        warn(remark)
    if len(paths) % lamps:
        raise ConfigError(
            f"--lamps {lamps}: {len(paths)} pictures cannot be divided into scenes of "
            f"{lamps}; give {lamps} for each scene"
        )
    once = SaidOnce()
    library: Library | None = None
    known, unread = 0, 0
    for first in range(0, len(paths), lamps):
        scene = paths[first : first + lamps]
        try:
            pictures = [read_picture(path, camera.size_px) for path in scene]
        except ConfigError as error:
            warn(f"cellctl: {error}")
            unread += 1
            continue
        if library is None:  # compiling takes long; a missing picture is reported first
            library = _library([(p, options_among(p, unit)) for p in files], camera, jobs)
        for path, picture in zip(scene, pictures, strict=True):
            for note in once.fresh(picture.notes):
                warn(f"{path.name}: {note}; reported once for all such pictures")
        known += _answer_one(options, scene, pictures, camera, library, folder)
    if unread:
        return 2
    return 0 if known else 1


def _answer_one(
    options: RecogniseOptions,
    scene: Sequence[Path],
    pictures: Sequence[StoredPicture],
    camera: Camera,
    library: Library,
    folder: ExplainFolder | None,
) -> int:
    """Print the objects in the pictures of one scene; return the number of known ones."""
    path, picture, as_json = scene[0], pictures[0], options.as_json
    others = [other.grey for other in pictures[1:]]
    started = time.perf_counter()
    seen = recognise(picture.grey, camera, library, options.lighting.value, lit=others)
    seconds = time.perf_counter() - started
    for remark in seen.segmentation.remarks:
        warn(f"{path.name}: {remark}")
    bodies = list(_bodies(scene, picture, seen, seconds))
    if not bodies:
        (warn if as_json else print_line)(f"{path.name}: nothing on the table")
    for body in bodies:
        if as_json:
            emit(body)
        else:
            print_line(_sentence(body))
    if folder is not None:
        explained = explain(picture.grey, camera, library, seen, path.name)
        drawing = folder.write(path, explained, with_json=as_json)
        if not as_json:
            show_tables(explained.tables)
            print_line(f"{path.name}: drawn in {drawing}")
    return sum(body["part"] is not None for body in bodies)


def _library(files: Sequence[tuple[Path, CompileOptions]], camera: Camera, jobs: Jobs) -> Library:
    """Return the library of CAD files, compiled by other processes if there are any."""
    with working_ahead(
        jobs, [PartWork(path, options, camera=camera) for path, options in files]
    ) as made:
        for number in range(len(files)):
            made(number)
    return open_library(files, camera)


def _cad_files(parts: list[Path]) -> list[Path]:
    found: list[Path] = []
    for path in parts:
        found += _parts_in(path) if path.is_dir() else [path]
    if not found:
        raise ConfigError(f"--parts {', '.join(map(str, parts))}: no CAD file there")
    return found


def _parts_in(folder: Path) -> list[Path]:
    """Return a folder's CAD files, one per part: of several formats, the quickest to read."""
    files = sorted(
        (file for file in folder.iterdir() if is_cad_file(file)),
        key=lambda file: (part_name(file), CAD_FORMATS.index(file.suffix.lower())),
    )
    return [next(same) for _, same in groupby(files, part_name)]


def _bodies(
    scene: Sequence[Path], picture: StoredPicture, seen: Recognition, seconds: float
) -> Iterator[dict[str, Any]]:
    """Yield each object, ready for JSON."""
    about = {
        "lighting": seen.segmentation.lighting,
        "remarks": [*picture.notes, *seen.segmentation.remarks],
        "seconds": seconds / max(1, len(seen.sightings)),
        "seconds_picture": seconds,
    }
    for s in seen.sightings:
        is_known = s.covariance is not None
        yield {
            "image": scene[0].name,
            "images": [path.name for path in scene],
            "part": s.part,
            "stable_pose_R": None if s.R is None else s.R.tolist(),
            "pose_index": s.pose_index,
            "x_mm": s.x_mm,
            "y_mm": s.y_mm,
            "theta_deg": float(np.degrees(s.theta_rad)),
            "sigma_mm": s.sigma_mm if is_known else None,
            "sigma_deg": float(np.degrees(s.sigma_rad)) if is_known else None,
            "is_turn_free": s.is_turn_free,
            "is_roll_free": s.is_roll_free,
            "T_world_part": None if s.T_world_part is None else s.T_world_part.tolist(),
            "score": s.score,
            "ambiguous_with": [
                {
                    "part": a.part,
                    "pose_index": a.pose_index,
                    "theta_deg": float(np.degrees(a.theta_rad)),
                }
                for a in s.ambiguous_with
            ],
            "reason": s.reason,
            "free_share": s.free_share,
            "touching_count": s.touching_count,
            "is_cut": s.is_cut,
            "lies_on": list(s.lies_on),
            "is_covered": s.is_covered,
            **about,
        }


def _sentence(body: dict[str, Any]) -> str:
    where = f"x {body['x_mm']:.1f} mm, y {body['y_mm']:.1f} mm"
    if body["part"] is None:
        return f"{body['image']}: unknown object at {where}: {body['reason']}"
    turn = "turn not seen" if body["is_turn_free"] else f"{body['theta_deg']:.1f} deg"
    if body["is_roll_free"]:
        turn += ", roll not seen"
    others = body["ambiguous_with"]
    also = ""
    if others:
        others_text = "; ".join(
            f"{a['part']}, pose {a['pose_index']}, {a['theta_deg']:.1f} deg" for a in others
        )
        also = f"; could also be {others_text}"
    return (
        f"{body['image']}: {body['part']}, pose {body['pose_index']}, at {where}, "
        f"{turn}, score {body['score']:.3f}{_in_part(body)}{also}"
    )


def _in_part(body: dict[str, Any]) -> str:
    """Return the reasons why an outline is partly hidden, in words; empty if it is not."""
    count, reasons = body["touching_count"], []
    if count:
        reasons.append("touches another object" if count == 1 else f"one of {count + 1} that touch")
    if body["lies_on"]:
        reasons.append("lies on another object")
    if body["is_covered"]:
        reasons.append("another object lies on it")
    if body["is_cut"]:
        reasons.append("partly outside the picture")
    if not reasons:
        return ""
    return f", {100 * body['free_share']:.0f} % of its outline free ({', '.join(reasons)})"
