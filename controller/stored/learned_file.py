"""The file of what good parts look like: arrays in a NumPy archive, with a header in JSON.

Form `cellctl.learned/1` (docs/learning.md). Nothing in it is run as code.
"""

import io
import tokenize
import zipfile
import zlib
from dataclasses import dataclass
from datetime import datetime
from math import prod
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from controller.arrays import Float32Array, FloatArray
from controller.config import ConfigError
from controller.config.files import parse_json, read_bytes, write_whole
from controller.config.view_set import PoseRows, SetCamera
from controller.config.yaml_models import Section
from controller.inspection import Appearance, LearnedPicture, LearnedView, require_usable
from messages import joined, key, say

from .view_set import build_camera

SCHEMA: Final = "cellctl.learned/1"
HEADER: Final = "header"
MAX_FILE_BYTES: Final = 2**28  # a view under two lamps takes 1 MB
MAX_ARRAYS_BYTES: Final = 2**30  # of all arrays as they are in memory
HOW: Final = "`cellctl learn` writes such a file"
# What a damaged archive makes the readers of zip, npy and dtypes raise.
DAMAGED: Final = (
    *(ValueError, KeyError, EOFError, RuntimeError, SyntaxError, tokenize.TokenError),
    *(zipfile.BadZipFile, zlib.error, OSError, TypeError),
)
BY_VERDICT: Final = key("the cell's PASS")  # in place of a person


class AcceptedPart(Section):
    """A part that was learned from.

    Attributes
    ----------
    name : run and number, or file of its views
    accepted_by : the person, or `BY_VERDICT`; empty if it is not known
    accepted_at : when
    """

    name: str
    accepted_by: str = ""
    accepted_at: datetime | None = None


class _Picture(Section):
    lamp: str
    usual: Annotated[float, Field(gt=0)]


class _View(Section):
    camera: SetCamera
    T_world_part: PoseRows
    corner_px: tuple[int, int]
    step_px: Annotated[int, Field(ge=1)]
    reach_mm: Annotated[float, Field(ge=0)]
    reach_rad: Annotated[float, Field(ge=0)]
    parts: Annotated[int, Field(ge=1)]
    pictures: tuple[_Picture, ...]


class LearnedHeader(Section):
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
    parts: Annotated[tuple[AcceptedPart, ...], Field(min_length=1)]
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
        by = {one.accepted_by for one in self.header.parts if one.accepted_by}
        people = joined(", ", sorted(by - {BY_VERDICT}))
        who = joined(" and ", filter(None, (people, BY_VERDICT if BY_VERDICT in by else "")))
        made = f"{self.header.made:%Y-%m-%d}"
        return say(
            "appearance learned on {made} from {parts_count} parts{who}",
            made=made,
            parts_count=len(self.header.parts),
            who=who and say(", accepted by {who}", who=who),
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
    ConfigError : the file cannot be written
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
    archive = io.BytesIO()
    np.savez_compressed(archive, **arrays)
    write_whole(path, archive.getvalue())


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
    data = read_bytes(path, MAX_FILE_BYTES, "a file of learned parts")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            _require_small(path, archive)
            return _learned(path, archive)
    except DAMAGED as error:
        raise ConfigError(
            f"{path}: is no file of learned parts, or damaged ({error!s:.80}); {HOW}"
        ) from error


def _require_small(path: Path, archive: zipfile.ZipFile) -> None:
    """Raise ConfigError if the arrays take too much memory; zipfile reads no more than they say."""
    files = archive.infolist()
    if sum(one.file_size for one in files) > MAX_ARRAYS_BYTES:
        raise ConfigError(
            f"{path}: its arrays have more than {MAX_ARRAYS_BYTES >> 20} MB, learned ones are "
            f"smaller; {HOW}"
        )
    if any(one.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for one in files):
        raise ValueError("a compression that numpy does not write")


def _learned(path: Path, archive: zipfile.ZipFile) -> Learned:
    text = _values(archive, HEADER, "u1").tobytes()
    tree = parse_json(text, path, "a header of learned parts")
    if not isinstance(tree, dict) or tree.get("schema") != SCHEMA:
        raise ConfigError(f'{path}: `schema`: "{SCHEMA}" is expected; {HOW}')
    try:
        header = LearnedHeader.model_validate(tree)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise ConfigError(f"{path}: `{key}` of its header: {first['msg']}; {HOW}") from error
    views = tuple(_learned_view(archive, i, view) for i, view in enumerate(header.views))
    return Learned(Appearance(views, np.array(header.p_part_mm)), header)


def _learned_view(archive: zipfile.ZipFile, number: int, view: _View) -> LearnedView:
    """Return one view; raise ValueError if its arrays do not belong together."""
    found = LearnedView(
        build_camera(view.camera),
        np.array(view.T_world_part),
        view.corner_px,
        view.step_px,
        _array(archive, f"{number}.depth", "f4"),
        view.reach_mm,
        view.reach_rad,
        view.parts,
        {
            one.lamp: LearnedPicture(
                _array(archive, f"{number}.{one.lamp}.mean", "f2"),
                _array(archive, f"{number}.{one.lamp}.scatter", "f2"),
                one.usual,
            )
            for one in view.pictures
        },
    )
    require_usable(found)
    return found


def _array(archive: zipfile.ZipFile, name: str, kind: str) -> Float32Array:
    return np.asarray(_values(archive, name, kind), np.float32)


def _values(archive: zipfile.ZipFile, name: str, kind: str) -> NDArray[Any]:
    """Return an array of the archive; raise ValueError if it is of another kind or size.

    Sizes are compared before memory is taken for them, which `numpy.load` does not do.

    Parameters
    ----------
    archive : its file
    name : of the array
    kind : type of its values, as NumPy spells it
    """
    data = archive.read(f"{name}.npy")
    stream = io.BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError(f"{name} is of another version")
    shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    at = stream.tell()
    if dtype != np.dtype(kind) or prod(shape) * dtype.itemsize != len(data) - at:
        raise ValueError(f"{name} is of another kind or size")
    flat = np.frombuffer(data, dtype, offset=at)
    return flat.reshape(shape, order="F" if is_fortran else "C")
