"""Plans and certificates kept between runs, each in a file of the cache.

A file is named by all that decides what is in it: the part, the cell as planning sees it, the
planner's options and source, the libraries it computes with, and where the part lies. So nothing
has to be found out about an old file: another key is another file.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import logging
import pickle
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from controller.cad import StablePose
from controller.cad.compiled import CompiledPart, cache_dir, source_hash
from controller.planning import (
    CellLayout,
    Certificate,
    NoPlanError,
    OnTable,
    Plan,
    PlanOptions,
    PreparedPart,
    certify,
    plan_from,
    prepare_part,
    resting_pose,
)

Array = NDArray[np.float64]
T = TypeVar("T")

FORMAT = 1  # raised when the meaning of kept plans changes
KEPT_PLANS, KEPT_PREPARED = 500, 30  # the oldest ones go first; each can be made again
ENDING = ".pickle"
DECIDING = ("numpy", "scipy", "shapely", "trimesh", "embreex", "python-fcl", "networkx")

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class KeptPlan:
    """A plan from one place, or why there is none.

    Attributes
    ----------
    T_world_part : (4, 4) where the part lies
    plan : None where `reason` says why
    """

    pose_index: int
    T_world_part: Array
    plan: Plan | None
    reason: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Certified:
    """What a stable pose of a part comes to in a cell.

    Attributes
    ----------
    arm_grip_count, fixture_grip_count : how many ways of holding it plans choose from
    """

    told: Certificate
    arm_grip_count: int
    fixture_grip_count: int


class Planning:
    """Plans of one part in one cell, from the cache where they are there.

    Parameters
    ----------
    use_cache : False to make everything anew and keep nothing
    """

    def __init__(
        self,
        part: CompiledPart,
        layout: CellLayout,
        options: PlanOptions | None = None,
        *,
        use_cache: bool = True,
    ) -> None:
        self._part = part
        self._layout = layout
        self._options = options or PlanOptions()
        self._use_cache = use_cache
        self._prepared: PreparedPart | None = None
        self._key = digest_of(
            FORMAT,
            part.solid.content_hash,
            part.solid.unit,
            layout,
            self._options,
            planner_hash(),
        )
        self._made = 0
        self._told: dict[Path, KeptPlan] = {}

    @property
    def is_from_cache(self) -> bool:
        """Tell whether all that was asked so far was there already."""
        return self._made == 0

    @property
    def is_prepared(self) -> bool:
        """Tell whether the long work has been done before."""
        if self._prepared is not None:
            return True
        return self._use_cache and PREPARED.file(self._part.solid.name, self._key).exists()

    def prepared(self) -> PreparedPart:
        """Return the part prepared for this cell.

        Raises
        ------
        NoPlanError : nothing can hold it
        """
        if self._prepared is None:
            file = PREPARED.file(self._part.solid.name, self._key)
            found = PREPARED.load(file) if self._use_cache else None
            if found is None:
                self._made += 1
                found = prepare_part(
                    self._part.solid, self._part.samples, self._layout, self._options
                )
                if self._use_cache:
                    PREPARED.save(file, found)
            self._prepared = found
        return self._prepared

    def lying(self, pose: StablePose, x_mm: float, y_mm: float, theta_rad: float) -> KeptPlan:
        """Return the plan for the part at rest at a place, or why there is none."""
        T = resting_pose(self._part.solid, pose, x_mm, y_mm, theta_rad)
        file = self._plan_file(pose.index, T)
        found = self._told.get(file)
        if found is None and self._use_cache:
            found = PLANS.load(file)
        if found is None:
            self._made += 1
            try:
                plan = plan_from(self.prepared(), self._layout, OnTable(pose.index, T))
                found = KeptPlan(pose.index, T, plan)
            except NoPlanError as error:
                found = KeptPlan(pose.index, T, None, str(error))
            if self._use_cache:
                PLANS.save(file, found)
        self._told[file] = found
        return found

    def certified(self, pose: StablePose) -> Certified:
        """Return what a pose comes to, lying in the middle of where parts may lie."""
        name = self._part.solid.name
        file = CERTIFICATES.file(name, digest_of(self._key, "certificate", pose.index))
        found = CERTIFICATES.load(file) if self._use_cache else None
        if found is None:
            self._made += 1
            found = self._certify(pose)
            if self._use_cache:
                CERTIFICATES.save(file, found)
        x_mm, y_mm = self._layout.set_down_mm.mean(axis=1).tolist()
        T = resting_pose(self._part.solid, pose, x_mm, y_mm)
        kept = KeptPlan(pose.index, T, found.told.plan, found.told.reason)
        self._told[self._plan_file(pose.index, T)] = kept
        return found

    def _certify(self, pose: StablePose) -> Certified:
        try:
            part = self.prepared()
        except NoPlanError as error:  # nothing can hold it, whichever way it lies
            told = Certificate(pose.index, pose.probability, None, str(error), 0.0)
            return Certified(told, 0, 0)
        (told,) = certify(part, self._layout, (pose,))
        return Certified(told, len(part.arm_grips), len(part.fixture_grips))

    def _plan_file(self, pose_index: int, T_world_part: Array) -> Path:
        return PLANS.file(self._part.solid.name, digest_of(self._key, pose_index, T_world_part))


class Shelf(Generic[T]):
    """Values of one type in files of the cache: a digest, then the pickled value.

    A pickle runs what it says. So these files are only ever written and read in the user's own
    cache folder, and one whose digest is not that of its content is made anew.

    Parameters
    ----------
    prefix : of the files' names; kept_n : how many of them there may be
    """

    def __init__(self, kind: type[T], prefix: str, kept_n: int) -> None:
        self._kind = kind
        self._prefix = prefix
        self._kept_n = kept_n

    def file(self, name: str, key: str) -> Path:
        """Return where a value is kept."""
        stem = name.encode()[:60].decode(errors="ignore")
        return cache_dir() / f"{self._prefix}-{stem}-{key[:32]}{ENDING}"

    def load(self, file: Path) -> T | None:
        """Return a kept value, None where nothing sound is there."""
        try:
            data = file.read_bytes()
        except OSError:
            return None
        digest, body = data[:32], data[32:]
        if hashlib.sha256(body).digest() != digest:
            log.warning("%s is damaged; it is made anew", file)
            return None
        try:
            found = pickle.loads(body)
        except (pickle.UnpicklingError, EOFError, AttributeError, ImportError, ValueError):
            return None
        return found if isinstance(found, self._kind) else None

    def save(self, file: Path, value: T) -> None:
        """Keep a value; a full or read-only disk costs time at the next start, not correctness."""
        body = pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)
        part = file.with_name(f"{file.name}.{hashlib.sha256(body).hexdigest()[:8]}.part")
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(hashlib.sha256(body).digest() + body)
            part.replace(file)
            self._tidy(file.parent)
        except OSError as error:
            log.warning("%s: cannot be kept (%s); the next start works it out again", file, error)

    def _tidy(self, folder: Path) -> None:
        ages = []
        for file in folder.glob(f"{self._prefix}-*{ENDING}"):
            try:
                ages.append((file.stat().st_mtime, file))
            except FileNotFoundError:
                continue  # another process tidies too
        for _, file in sorted(ages)[: -self._kept_n]:
            file.unlink(missing_ok=True)


PREPARED = Shelf(PreparedPart, "prepared", KEPT_PREPARED)
PLANS = Shelf(KeptPlan, "plan", KEPT_PLANS)
CERTIFICATES = Shelf(Certified, "certificate", KEPT_PLANS)


@lru_cache(maxsize=1)
def planner_hash() -> str:
    """Return a hash of all source that decides a plan, and of the libraries it computes with."""
    root = Path(__file__).parents[2]
    digest = hashlib.sha256(source_hash().encode())
    for folder in ("controller/planning", "drivers/umi_scara"):
        for source in sorted((root / folder).rglob("*.py")):
            digest.update(source.relative_to(root).as_posix().encode())
            digest.update(source.read_bytes())
    for package in DECIDING:
        try:
            digest.update(f"{package} {importlib.metadata.version(package)}".encode())
        except importlib.metadata.PackageNotFoundError:
            digest.update(f"{package} none".encode())
    return digest.hexdigest()


def digest_of(*values: object) -> str:
    """Return a hash of numbers, words, arrays, and of dataclasses and collections of these.

    Raises
    ------
    TypeError : anything else, which might not say all that it is
    """
    digest = hashlib.sha256()
    for piece in _pieces(values):
        digest.update(len(piece).to_bytes(8, "little"))
        digest.update(piece)
    return digest.hexdigest()


def _pieces(value: object) -> Iterable[bytes]:
    if isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif value is None or isinstance(value, bool | int | float | str | Enum | np.generic):
        yield f"{type(value).__name__} {value!r}".encode()
    elif is_dataclass(value):
        yield type(value).__name__.encode()
        for field in fields(value):
            yield field.name.encode()
            yield from _pieces(getattr(value, field.name))
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        for key, item in value.items():
            yield from _pieces(key)
            yield from _pieces(item)
    elif isinstance(value, tuple | list | frozenset):
        items = sorted(value, key=repr) if isinstance(value, frozenset) else value
        yield f"{type(value).__name__} {len(value)}".encode()
        for item in items:
            yield from _pieces(item)
    else:
        raise TypeError(f"{type(value).__name__} cannot be part of a key")
