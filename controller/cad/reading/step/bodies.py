"""The bodies of a STEP file: listed by name, size and place, and available by name.

A body is a solid, in the coordinates of its own product, as if that had been exported alone. Bodies
of one shape are listed once. The kernel works in a child process (`controller.step_kernel`).
"""

import hashlib
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray
from controller.config.cad_files import body_name

from ...errors import UnreadableCadError
from .congruent import Marks, placing
from .kernel import KernelLimits, KernelRun
from .references import References
from .texts import for_kernel, has_code_page

# Files whose bodies stay in memory, for callers that ask for one after the other.
MAX_KEPT: Final = 2


@dataclass(frozen=True, eq=False, slots=True)
class Occurrence:
    """One placement of a body in the file.

    Attributes
    ----------
    within : names of the products it is in, outermost first; empty where it stands alone
    T_file_body : (4, 4) its pose in the coordinates of the file [mm]
    """

    within: tuple[str, ...]
    T_file_body: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class StepBody:
    """One body of a STEP file.

    Attributes
    ----------
    name : unique in the file, as it is written behind the ``#``
    also : names of other bodies of the same shape
    size_mm : (3,) along its own axes
    volume_mm3 : exact
    occurrences : placements of the body and of others with its shape
    product, number : product and number in the kernel
    shape : the kernel's own format
    """

    name: str
    also: tuple[str, ...]
    size_mm: FloatArray
    volume_mm3: float
    occurrences: tuple[Occurrence, ...]
    product: str
    number: int
    shape: bytes


@dataclass(frozen=True, eq=False, slots=True)
class Bodies:
    """The bodies of a file.

    Attributes
    ----------
    distinct : one for each shape, in the file's order
    others : further bodies of these shapes, with names of their own
    open_names : products whose surfaces enclose nothing
    unit : unit of length, in the kernel's spelling
    missing : files it names that are not there
    is_in_code_page : whether its names are no UTF-8, and were read as code page 1252
    """

    distinct: tuple[StepBody, ...]
    others: tuple[StepBody, ...]
    open_names: tuple[str, ...]
    unit: str
    missing: tuple[str, ...]
    is_in_code_page: bool = False

    @property
    def count(self) -> int:
        """Number of placed bodies."""
        return sum(len(body.occurrences) for body in self.distinct)


_kept: dict[str, Bodies] = {}


def open_bodies(path: Path, files: References, limits: KernelLimits | None = None) -> Bodies:
    """Return the bodies of a STEP file.

    Parameters
    ----------
    path : path of the file, for messages
    files : its content, with that of the files it names
    limits : on memory and time of the kernel; None for the usual ones

    Raises
    ------
    UnreadableCadError : the kernel does not read it
    """
    each = (f"{name}:{hashlib.sha256(data).hexdigest()}" for name, data in files.found.items())
    key = hashlib.sha256("\n".join((*each, *files.missing)).encode()).hexdigest()
    if key in _kept:
        return _kept[key]
    try:
        found = _listed(path, files, limits, with_names=True)
    except UnreadableCadError:
        if len(files.found) > 1:
            raise
        found = _listed(path, files, limits, with_names=False)
    while len(_kept) >= MAX_KEPT:
        del _kept[next(iter(_kept))]
    _kept[key] = found
    return found


def written(files: References, folder: Path) -> Path:
    """Copy a file and its references, as the kernel reads them; return the first copy.

    Parameters
    ----------
    files : content by name
    folder : folder for them; it is made
    """
    folder.mkdir()
    main, *rest = files.found
    source = folder / ("part.step" if not rest else main)
    source.write_bytes(for_kernel(files.found[main]))
    for name in rest:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(for_kernel(files.found[name]))
    return source


def _listed(
    path: Path, files: References, limits: KernelLimits | None, *, with_names: bool
) -> Bodies:
    """Run the kernel on copies of the files, so that it reads the bytes that were hashed."""
    with tempfile.TemporaryDirectory(prefix="cellctl-step-") as folder:
        shapes = Path(folder) / "shapes"
        shapes.mkdir()
        source = written(files, Path(folder) / "inputs")
        arguments = (str(shapes), "1" if with_names else "0")
        with KernelRun("bodies", source, Path(folder) / "bodies.npz", arguments, limits) as run:
            found = run.result(str(path))
        stated = json.loads(str(found["listing"]))
        content = [(shapes / f"{i}.bin").read_bytes() for i in range(len(stated["bodies"]))]
    distinct, others = _grouped(stated["bodies"], found, content)
    is_in_code_page = any(map(has_code_page, files.found.values()))
    return Bodies(
        distinct,
        others,
        tuple(stated["open"]),
        str(stated["unit"]),
        files.missing,
        is_in_code_page,
    )


def _grouped(
    stated: Sequence[Mapping[str, Any]],
    found: Mapping[str, NDArray[np.generic]],
    content: Sequence[bytes],
) -> tuple[tuple[StepBody, ...], tuple[StepBody, ...]]:
    """Return one body for each shape, and bodies of one shape with different names."""
    firsts: list[int] = []
    into: list[tuple[int, FloatArray]] = []  # for each body: the first of its shape, and the pose
    marks = [_marks(one, found, i) for i, one in enumerate(stated)]
    for i, one in enumerate(marks):
        for first in firsts:
            T = placing(marks[first], one)
            if T is not None:
                into.append((first, T))
                break
        else:
            firsts.append(i)
            into.append((i, np.eye(4)))
    taken: set[str] = set()
    names = {i: _unique(str(stated[i]["name"]), taken) for i in firsts}
    also: dict[int, list[int]] = {i: [] for i in firsts}
    for i, (first, _) in enumerate(into):
        own = body_name(str(stated[i]["name"]))
        if i != first and own and own not in taken:
            names[i] = _unique(own, taken)
            also[first].append(i)
    built = {i: _body(stated[i], name, content[i]) for i, name in names.items()}
    distinct = []
    for i in firsts:
        places = tuple(
            Occurrence(tuple(place["in"]), np.array(place["T"]) @ T)
            for k, (first, T) in enumerate(into)
            if first == i
            for place in stated[k]["placed"]
        )
        names_too = tuple(names[k] for k in also[i])
        distinct.append(replace(built[i], also=names_too, occurrences=places))
    return tuple(distinct), tuple(built[k] for i in firsts for k in also[i])


def _unique(name: str, taken: set[str]) -> str:
    """Return a name as written, with a number if it is already taken."""
    plain = body_name(name) or "body"
    found, number = plain, 1
    while found in taken:
        number += 1
        found = f"{plain}~{number}"
    taken.add(found)
    return found


def _marks(one: Mapping[str, Any], found: Mapping[str, NDArray[np.generic]], i: int) -> Marks:
    return Marks(
        float(one["volume_mm3"]),
        float(one["area_mm2"]),
        np.array(one["centroid_mm"], dtype=float),
        np.array(one["moments_mm5"], dtype=float),
        np.asarray(found[f"points_{i}"], dtype=float),
        np.asarray(found[f"sizes_{i}"], dtype=float),
    )


def _body(one: Mapping[str, Any], name: str, shape: bytes) -> StepBody:
    places = tuple(Occurrence(tuple(p["in"]), np.array(p["T"])) for p in one["placed"])
    return StepBody(
        name=name,
        also=(),
        size_mm=np.array(one["size_mm"], dtype=float),
        volume_mm3=float(one["volume_mm3"]),
        occurrences=places,
        product=str(one["product"]),
        number=int(one["number"]),
        shape=shape,
    )
