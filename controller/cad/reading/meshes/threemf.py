"""3MF packages (references.md S5), read as a stream: only models are unpacked.

Neither the whole text of a model nor a tree of it is ever in memory: only its corners and triangles
are, whatever size a small file expands to.
"""

import io
import zipfile
import zlib
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.parsers import expat

import numpy as np

from controller.arrays import FloatArray, IntArray

from ...errors import CoordinatesCadError, LargeCadError, UnreadableCadError
from ...solid import MAX_TRIANGLES, check_count

MAX_BYTES: Final = 400_000_000  # two million triangles and their corners take 250 MB of XML
# Tags of all models: a corner or a triangle is one. Two million triangles have a million corners
# and fit; of a mesh that does not share its corners, with three to a triangle, half as many do.
MAX_TAGS: Final = 2 * MAX_TRIANGLES
MAX_DEPTH: Final = 32  # levels of nested elements; the core specification has seven
MAX_TOKEN_BYTES: Final = 4 << 20  # bytes of one tag; the parser holds it whole
# largest number; each may hold others twice, so that more of them would unfold without end
MAX_COMPONENTS: Final = 16
CHUNK_BYTES: Final = 1 << 20
DEFAULT_UNIT: Final = "millimeter"  # 3MF core specification 3.4
MAIN: Final = "3d/3dmodel.model"
# Errors that the readers of the package and of its XML raise; RuntimeError for encryption.
DAMAGED: Final = (
    zipfile.BadZipFile, zlib.error, expat.ExpatError, EOFError, OSError, ValueError, KeyError,
    NotImplementedError, RuntimeError,
)  # fmt: skip
ATTRIBUTES: Final = (("x", "y", "z"), ("v1", "v2", "v3"))


def read_3mf(data: bytes, path: Path) -> tuple[FloatArray, IntArray, str]:
    """Return corners (v, 3) in the file's unit, triangles (n, 3), and the unit as it is spelt.

    Raises
    ------
    UnreadableCadError : no package, damaged, without a model, or an assembly
    CoordinatesCadError : a number is not finite
    LargeCadError : unpacks to more than is read, or to more triangles
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return _Package(archive, path).build()
    except DAMAGED as error:
        reason = " ".join(str(error).split())
        raise UnreadableCadError(
            f"{path}: is not a whole 3MF package ({type(error).__name__}: {reason:.200}); "
            "copy or export it again"
        ) from error


@dataclass(frozen=True, slots=True)
class PlacedObject:
    """An object that a component or the build places: file and id, and its pose [file's unit]."""

    file: str
    id: str
    T: FloatArray


@dataclass(slots=True)
class ModelObject:
    """An object of a model: corners and triangles, or others that it holds."""

    numbers: "array[float]" = field(default_factory=lambda: array("d"))
    triangles: "array[int]" = field(default_factory=lambda: array("q"))
    holds: list[PlacedObject] = field(default_factory=list)


class _Package:
    """The models of one package, each read once."""

    def __init__(self, archive: zipfile.ZipFile, path: Path) -> None:
        self._archive = archive
        self._path = path
        self._names = {name.lower().lstrip("/"): name for name in archive.namelist()}
        self._bodies: dict[tuple[str, str], ModelObject] = {}
        self._read: set[str] = set()
        self._items: list[PlacedObject] = []
        self._unit = DEFAULT_UNIT
        self.tag_count = self.component_count = self.triangle_count = 0
        unpacked = sum(
            entry.file_size
            for entry in archive.infolist()
            if entry.filename.lower().endswith(".model")
        )
        if unpacked > MAX_BYTES:
            raise LargeCadError(
                f"{path}: unpacks to {unpacked / 1e6:,.0f} MB, the most is "
                f"{MAX_BYTES / 1e6:,.0f} MB; export it with a coarser chord error"
            )

    def build(self) -> tuple[FloatArray, IntArray, str]:
        main = next((name for name in self._names if MAIN in name), None)
        if main is None:
            raise UnreadableCadError(f"{self._path}: holds no 3D model; export it again")
        self._read_model(main, is_main=True)
        pieces: list[tuple[FloatArray, IntArray]] = []
        for item in self._items:
            self._place(item, np.eye(4), pieces, ())
        if not pieces:
            return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64), self._unit
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in pieces)])
        return (
            np.vstack([vertices for vertices, _ in pieces]),
            np.vstack([t + start for (_, t), start in zip(pieces, starts, strict=False)]),
            self._unit,
        )

    def _place(
        self,
        use: PlacedObject,
        T: FloatArray,
        pieces: list[tuple[FloatArray, IntArray]],
        within: tuple[tuple[str, str], ...],
    ) -> None:
        """Add the contents of an object, in the pose of the object around it."""
        if use.file not in self._read:
            self._read_model(use.file, is_main=False)
        key = (use.file, use.id)
        if key in within:
            raise UnreadableCadError(f"{self._path}: object {use.id} holds itself; export it again")
        body = self._bodies.get(key)
        if body is None:
            raise UnreadableCadError(
                f"{self._path}: names object {use.id:.40} and does not hold it; export it again"
            )
        T = T @ use.T
        if body.triangles:
            vertices = np.array(body.numbers).reshape(-1, 3)
            triangles = np.array(body.triangles, dtype=np.int64).reshape(-1, 3)
            if not 0 <= triangles.min() <= triangles.max() < len(vertices):
                raise UnreadableCadError(
                    f"{self._path}: a triangle names corner {int(triangles.max())} of "
                    f"{len(vertices)}; export it again"
                )
            self.triangle_count += len(triangles)
            check_count(self.triangle_count, str(self._path))
            turned = triangles[:, ::-1] if np.linalg.det(T[:3, :3]) < 0 else triangles
            pieces.append((vertices @ T[:3, :3].T + T[:3, 3], turned))
        for held in body.holds:
            self._place(held, T, pieces, (*within, key))

    def _read_model(self, name: str, *, is_main: bool) -> None:
        self._read.add(name)
        if name not in self._names:
            raise UnreadableCadError(
                f"{self._path}: names {name:.80} and does not hold it; export it again"
            )
        self._count_tags(name)
        reading = _Model(self, name, self._path)
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.StartElementHandler = reading.begin
        parser.EndElementHandler = reading.end
        parser.StartDoctypeDeclHandler = reading.refuse_entities
        fed = 0
        for chunk in self._chunks(name):
            parser.Parse(chunk, False)
            fed += len(chunk)
            if fed - parser.CurrentByteIndex > MAX_TOKEN_BYTES + CHUNK_BYTES:
                raise LargeCadError(
                    f"{self._path}: its model has a tag of more than "
                    f"{MAX_TOKEN_BYTES >> 20} MB; export it again"
                )
        parser.Parse(b"", True)
        for id_, body in reading.bodies.items():
            self._bodies[name, id_] = body
        if is_main:
            self._items, self._unit = reading.items, reading.unit

    def _chunks(self, name: str) -> Iterator[bytes]:
        """Yield a model's text; at most the declared size is unpacked."""
        with self._archive.open(self._names[name]) as model:
            while chunk := model.read(CHUNK_BYTES):
                yield chunk

    def _count_tags(self, name: str) -> None:
        """Check a model's tags before parsing, which takes ten times as long."""
        for chunk in self._chunks(name):
            self.tag_count += chunk.count(b"<")
            if self.tag_count > MAX_TAGS:
                raise LargeCadError(
                    f"{self._path}: its models have more than {MAX_TAGS:,} tags; "
                    "export it with a coarser chord error"
                )

    def count_component(self) -> None:
        self.component_count += 1
        if self.component_count > MAX_COMPONENTS:
            raise UnreadableCadError(
                f"{self._path}: is an assembly of more than {MAX_COMPONENTS} components; "
                "export the part alone"
            )


class _Model:
    """Handler of a model's elements as the parser reaches them."""

    def __init__(self, package: _Package, name: str, path: Path) -> None:
        self._package = package
        self._name = name
        self._path = path
        self._depth = 0
        self._body: ModelObject | None = None
        self.bodies: dict[str, ModelObject] = {}
        self.items: list[PlacedObject] = []
        self.unit = DEFAULT_UNIT

    def refuse_entities(self, *_: object) -> None:
        raise UnreadableCadError(
            f"{self._path}: its model declares a document type, as no 3MF does; export it again"
        )

    def begin(self, tag: str, given: Mapping[str, str]) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise UnreadableCadError(
                f"{self._path}: its elements are nested deeper than {MAX_DEPTH}; export it again"
            )
        kind = tag.rpartition(" ")[2]
        body = self._body
        if kind == "vertex" and body is not None:
            body.numbers.extend([self._number(kind, key, given) for key in ATTRIBUTES[0]])
        elif kind == "triangle" and body is not None:
            body.triangles.extend([self._index(key, given) for key in ATTRIBUTES[1]])
        elif kind == "object":
            self._body = self.bodies[given["id"]] = ModelObject()
        elif kind == "component" and body is not None:
            self._package.count_component()
            body.holds.append(self._use(kind, given))
        elif kind == "item":
            self._package.count_component()
            self.items.append(self._use(kind, given))
        elif kind == "model":
            self.unit = given.get("unit", DEFAULT_UNIT)

    def end(self, tag: str) -> None:
        self._depth -= 1
        if tag.rpartition(" ")[2] == "object":
            self._body = None

    def _use(self, kind: str, given: Mapping[str, str]) -> PlacedObject:
        file = next((v for k, v in given.items() if k.rpartition(" ")[2] == "path"), self._name)
        T = np.eye(4)
        if words := given.get("transform", "").split():
            if len(words) != 12:
                raise UnreadableCadError(
                    f"{self._path}: `transform` of an {kind} has {len(words)} numbers, not 12"
                )
            rows = [self._number(kind, "transform", {"transform": word}) for word in words]
            T[:3] = np.array(rows).reshape(4, 3).T  # the file has rows times a matrix
        return PlacedObject(file.lower().lstrip("/"), given["objectid"], T)

    def _number(self, kind: str, key: str, given: Mapping[str, str]) -> float:
        word = given.get(key, "")
        try:
            value = float(word)
        except ValueError:
            value = float("nan")
        if "_" in word or value - value != 0.0:
            what = f"is {word!r:.40}, no finite number" if word else "is missing"
            raise CoordinatesCadError(f"{self._path}: `{key}` of a {kind} {what}; export it again")
        return value

    def _index(self, key: str, given: Mapping[str, str]) -> int:
        word = given.get(key, "")
        if not (word.strip().isascii() and word.strip().isdigit() and len(word) < 16):
            raise UnreadableCadError(
                f"{self._path}: `{key}` of a triangle is {word!r:.40}, no corner; export it again"
            )
        return int(word)
