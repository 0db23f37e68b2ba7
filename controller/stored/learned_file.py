"""The file of what good parts look like: arrays in a NumPy archive, with a header in JSON.

Form `cellctl.learned/1` (docs/learning.md). Nothing in it is run as code.
"""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from controller.arrays import Float32Array, FloatArray
from controller.config import ConfigError
from controller.config.view_set import PoseRows, SetCamera
from controller.inspection import Appearance, LearnedPicture, LearnedView

from .view_set import build_camera

SCHEMA: Final = "cellctl.learned/1"
HEADER: Final = "header"
MAX_FILE_BYTES: Final = 2**30  # a view under two lamps takes 1 MB
MAX_ARRAY_BYTES: Final = 2**29  # of one array: a view takes a hundredth
HOW: Final = "`cellctl learn` writes such a file"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class AcceptedPart(_Strict):
    """A part that was learned from.

    Attributes
    ----------
    name : run and number, or file of its views
    accepted_by : the person, or the verdict it passed with
    accepted_at : when
    """

    name: str
    accepted_by: str = ""
    accepted_at: datetime | None = None


class _Picture(_Strict):
    lamp: str
    usual: Annotated[float, Field(gt=0)]


class _View(_Strict):
    camera: SetCamera
    T_world_part: PoseRows
    corner_px: tuple[int, int]
    step_px: Annotated[int, Field(ge=1, le=16)]
    reach_mm: Annotated[float, Field(ge=0)]
    reach_rad: Annotated[float, Field(ge=0)]
    parts: Annotated[int, Field(ge=1)]
    pictures: tuple[_Picture, ...]


class LearnedHeader(_Strict):
    """Origin of a learned appearance.

    Attributes
    ----------
    schema_ : name and version of the form
    part, cad_sha256 : name of the part, and hash of its CAD file
    p_part_mm : middle of the part, CAD frame
    made : when it was learned
    software : version of cellctl
    parts : accepted parts that it was learned from
    left_out : parts that differed from the others
    compared, in_sight : share of the surface that each part compared by the others, and had in
        sight; the mean
    views : learned
    """

    schema_: Literal["cellctl.learned/1"] = Field(alias="schema")
    part: str
    cad_sha256: str
    p_part_mm: tuple[float, float, float]
    made: datetime
    software: str
    parts: tuple[AcceptedPart, ...]
    left_out: tuple[AcceptedPart, ...] = ()
    compared: float
    in_sight: float
    views: Annotated[tuple[_View, ...], Field(max_length=1000)] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Learned:
    """Appearance of good parts, with its origin.

    Attributes
    ----------
    appearance : by view
    header : whom and what it comes from
    """

    appearance: Appearance
    header: LearnedHeader

    @property
    def sentence(self) -> str:
        """Origin in words, for a report."""
        people = sorted({one.accepted_by for one in self.header.parts if one.accepted_by})
        by = f", accepted by {', '.join(people)}" if people else ""
        return (
            f"appearance learned on {self.header.made:%Y-%m-%d} from {len(self.header.parts)} "
            f"parts{by}"
        )


def write_learned(path: Path, appearance: Appearance, header: LearnedHeader) -> None:
    """Write a learned appearance; the file is complete, or as it was before.

    Parameters
    ----------
    path : the file
    appearance : by view
    header : its origin; the views of it are filled in here

    Raises
    ------
    OSError : the file cannot be written
    """
    arrays: dict[str, Any] = {}
    views = []
    for number, view in enumerate(appearance.views):
        arrays[f"{number}.depth"] = view.depth_mm
        for lamp, picture in view.pictures.items():
            arrays[f"{number}.{lamp}.mean"] = picture.mean.astype(np.float16)
            arrays[f"{number}.{lamp}.scatter"] = picture.scatter.astype(np.float16)
        views.append(_view(view))
    body = header.model_copy(update={"views": tuple(views)}).model_dump_json(by_alias=True)
    arrays[HEADER] = np.frombuffer(body.encode(), dtype=np.uint8)
    partial = path.with_name(f".{path.name}.partial")
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, **arrays)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _view(view: LearnedView) -> _View:
    camera = view.camera
    d = camera.distortion.tolist()
    return _View(
        camera=SetCamera(
            size_px=camera.size_px,
            K=_rows(camera.K),
            distortion=(d[0], d[1], d[2], d[3], d[4]),
            T_world_cam=_rows(camera.T_world_cam),
        ),
        T_world_part=_rows(view.T_world_part),
        corner_px=view.corner_px,
        step_px=view.step_px,
        reach_mm=view.reach_mm,
        reach_rad=view.reach_rad,
        parts=view.parts,
        pictures=tuple(_Picture(lamp=k, usual=p.usual) for k, p in view.pictures.items()),
    )


def _rows(matrix: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


def read_learned(path: Path) -> Learned:
    """Return a learned appearance.

    Parameters
    ----------
    path : the file

    Raises
    ------
    ConfigError : there is none, or it is damaged, or of another form
    """
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ConfigError(f"{path}: is larger than {MAX_FILE_BYTES >> 20} MB; {HOW}")
        with np.load(path, allow_pickle=False) as archive:
            return _learned(path, archive)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, ValidationError):
            raise ConfigError(f"{path}: its header is of another form; {HOW}") from error
        reason = getattr(error, "strerror", None) or "is no file of learned parts, or damaged"
        raise ConfigError(f"{path}: {reason}; {HOW}") from error


def _learned(path: Path, archive: Mapping[str, Any]) -> Learned:
    for info in archive.zip.infolist():  # type: ignore[attr-defined]  # numpy's NpzFile has it
        if info.file_size > MAX_ARRAY_BYTES:
            raise ConfigError(f"{path}: an array in it is too large; {HOW}")
    text = bytes(archive[HEADER]).decode()
    if json.loads(text).get("schema") != SCHEMA:
        raise ConfigError(f'{path}: `schema`: "{SCHEMA}" is expected; {HOW}')
    header = LearnedHeader.model_validate_json(text)
    views = []
    for number, view in enumerate(header.views):
        depth = _array(archive, f"{number}.depth", 2)
        pictures = {}
        for one in view.pictures:
            mean = _array(archive, f"{number}.{one.lamp}.mean", 2)
            if mean.shape != depth.shape:
                raise ValueError("arrays of different sizes")
            scatter = _array(archive, f"{number}.{one.lamp}.scatter", 3)
            pictures[one.lamp] = LearnedPicture(mean, scatter, one.usual)
        views.append(
            LearnedView(
                build_camera(view.camera),
                np.array(view.T_world_part),
                view.corner_px,
                view.step_px,
                depth,
                view.reach_mm,
                view.reach_rad,
                view.parts,
                pictures,
            )
        )
    return Learned(Appearance(tuple(views), np.array(header.p_part_mm)), header)


def _array(archive: Mapping[str, Any], name: str, dimensions: int) -> Float32Array:
    found = np.asarray(archive[name], np.float32)
    if found.ndim != dimensions:
        raise ValueError(f"{name} has {found.ndim} dimensions")
    return found
