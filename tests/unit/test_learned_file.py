"""The file of learned parts: what is written is read back; a wrong file is refused in words."""

from __future__ import annotations

import io
import json
import os
import pickle
import random
import struct
import zipfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cad_solids import box, mesh_of
from shown_part import CAMERA, shown

from controller.config import ConfigError
from controller.inspection import Appearance, LearnedPicture, LearnedView
from controller.inspection.lit import COARSE, FILTER_COUNT, STEP_PX
from controller.stored import (
    AcceptedPart,
    Learned,
    LearnedHeader,
    cad_sha256,
    learned_for,
    read_learned,
    write_learned,
)
from controller.stored.learned_file import BY_VERDICT, MAX_ARRAYS_BYTES, SCHEMA

SIZE = (21, 30)  # of the grid: rows, columns
WHEN = datetime(2026, 3, 14, 9, 26, tzinfo=UTC)


def view() -> LearnedView:
    rng = np.random.default_rng(5)
    mean = rng.normal(0.0, 0.1, SIZE).astype(np.float16).astype(np.float32)
    mean[:3] = np.nan
    coarse = (FILTER_COUNT, *(-(-n // COARSE) for n in SIZE))
    scatter = rng.uniform(0.01, 0.2, coarse).astype(np.float16).astype(np.float32)
    depth = rng.uniform(650.0, 700.0, SIZE).astype(np.float32)
    return LearnedView(
        camera=CAMERA,
        T_world_part=shown(8, 6),
        corner_px=(200, 150),
        step_px=STEP_PX,
        depth_mm=depth,
        reach_mm=0.8,
        reach_rad=0.01,
        parts=6,
        pictures={"ring": LearnedPicture(mean, scatter, 0.9)},
    )


def header(sha256: str = "00", **changes: Any) -> LearnedHeader:
    parts = (
        AcceptedPart(name="R1 part 1", accepted_by="Bert", accepted_at=WHEN),
        AcceptedPart(name="R1 part 2", accepted_by=BY_VERDICT, accepted_at=WHEN),
        AcceptedPart(name="R2 part 1", accepted_by="Ann", accepted_at=WHEN),
    )
    fields = {
        "schema": SCHEMA, "part": "shown", "cad_sha256": sha256, "p_part_mm": (0.0, 0.0, 1.0),
        "made": WHEN, "software": "1", "parts": parts, "compared": 0.9, "in_sight": 0.95,
    }  # fmt: skip
    return LearnedHeader.model_validate(fields | changes)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "shown.learned"
    write_learned(path, Appearance((view(),), np.array([0.0, 0.0, 1.0])), header())
    return path


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def rewritten(path: Path, content: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(name, data)


def npy(array: Any, *, allow_pickle: bool = False) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asanyarray(array), allow_pickle=allow_pickle)
    return stream.getvalue()


def with_header(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change the header in place, or put what `change` returns in its place."""
    content = members(path)
    tree = json.loads(bytes(np.load(io.BytesIO(content["header.npy"]))))
    text = json.dumps(change(tree) or tree)
    content["header.npy"] = npy(np.frombuffer(text.encode(), np.uint8))
    rewritten(path, content)


def with_array(path: Path, name: str, data: bytes | None) -> None:
    content = members(path)
    if data is None:
        del content[f"{name}.npy"]
    else:
        content[f"{name}.npy"] = data
    rewritten(path, content)


def refused(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        read_learned(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:")
    return message


def test_what_is_written_is_read_back(path: Path) -> None:
    learned = read_learned(path)
    assert learned.header == header(views=learned.header.views)
    assert learned.appearance.p_part_mm.tolist() == [0.0, 0.0, 1.0]
    (found,), own = learned.appearance.views, view()
    assert (found.corner_px, found.step_px, found.parts) == (own.corner_px, own.step_px, 6)
    assert (found.reach_mm, found.reach_rad) == (own.reach_mm, own.reach_rad)
    assert np.array_equal(found.camera.K, CAMERA.K)
    assert np.array_equal(found.camera.distortion, CAMERA.distortion)
    assert np.array_equal(found.T_world_part, own.T_world_part)
    assert np.array_equal(found.depth_mm, own.depth_mm)
    picture, mine = found.pictures["ring"], own.pictures["ring"]
    assert np.array_equal(picture.mean, mine.mean, equal_nan=True)
    assert np.array_equal(picture.scatter, mine.scatter)
    assert picture.usual == mine.usual
    assert {a.dtype for a in (picture.mean, picture.scatter, found.depth_mm)} == {
        np.dtype(np.float32)
    }


def test_its_sentence_says_when_from_how_many_parts_and_by_whom_they_were_accepted(
    path: Path,
) -> None:
    assert read_learned(path).sentence == (
        "appearance learned on 2026-03-14 from 3 parts, accepted by Ann, Bert and the cell's PASS"
    )


@pytest.mark.parametrize(("by", "end"), [(BY_VERDICT, ", accepted by the cell's PASS"), ("", "")])
def test_without_persons_the_sentence_names_the_verdict_or_nobody(by: str, end: str) -> None:
    own = header(parts=(AcceptedPart(name="a", accepted_by=by),))
    assert Learned(Appearance((), np.zeros(3)), own).sentence.endswith(f"from 1 parts{end}")


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = path.read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigError, match=r"shown\.learned: cannot be written: No space left"):
        write_learned(path, Appearance((), np.zeros(3)), header())
    assert path.read_bytes() == before
    assert [one.name for one in path.parent.iterdir()] == [path.name]


def test_a_folder_that_is_gone_is_made(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "a.learned"
    write_learned(path, Appearance((), np.zeros(3)), header())
    assert read_learned(path).appearance.views == ()


# -- files that are none --------------------------------------------------------------------------


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert "No such file" in refused(tmp_path / "none.learned")


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    assert "is a directory" in refused(tmp_path)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert "is not a plain file" in refused(tmp_path / "pipe")


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"no archive",
        npy(np.zeros((4, 4), np.float32)),
        npy(np.array({"a": 1}, dtype=object), allow_pickle=True),
        pickle.dumps([1, 2]),
    ],
    ids=["empty", "text", "an array alone", "a pickled array alone", "a pickle"],
)
def test_what_is_no_archive_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "a.learned"
    path.write_bytes(data)
    assert "`cellctl learn` writes such a file" in refused(path)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.99])
def test_a_cut_off_file_is_refused(path: Path, share: float) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    assert "damaged" in refused(path)


def test_a_flipped_bit_is_refused_or_changes_nothing(path: Path) -> None:
    """Wherever it is: CRCs cover the content, and names and sizes are compared."""
    data, mean = path.read_bytes(), read_learned(path).appearance.views[0].pictures["ring"].mean
    rng = random.Random(11)
    refusals = 0
    for _ in range(300):
        spoilt = bytearray(data)
        spoilt[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(spoilt)
        try:
            found = read_learned(path).appearance.views[0].pictures["ring"].mean
        except ConfigError:
            refusals += 1
        else:
            assert np.array_equal(found, mean, equal_nan=True)
    assert refusals > 200  # most of the file is content


def test_an_encrypted_archive_is_refused(path: Path) -> None:
    data = bytearray(path.read_bytes())
    at = data.index(b"PK\x01\x02")
    while at >= 0:  # the flag of every member, in its head and in the directory
        data[at + 8] |= 1
        (local,) = struct.unpack_from("<I", data, at + 42)
        data[local + 6] |= 1
        at = data.find(b"PK\x01\x02", at + 4)
    path.write_bytes(data)
    assert "damaged" in refused(path)


@pytest.mark.parametrize("kind", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_compression_that_learn_does_not_use_is_refused(path: Path, kind: int) -> None:
    content = members(path)
    with zipfile.ZipFile(path, "w", kind) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    assert "compression" in refused(path)


# -- headers --------------------------------------------------------------------------------------


def test_another_schema_is_named(path: Path) -> None:
    with_header(path, lambda tree: tree | {"schema": "cellctl.learned/2"})
    assert '`schema`: "cellctl.learned/1" is expected' in refused(path)


@pytest.mark.parametrize("tree", [[], "text", 3], ids=repr)
def test_a_header_that_is_no_object_is_refused(path: Path, tree: Any) -> None:
    with_array(path, "header", npy(np.frombuffer(json.dumps(tree).encode(), np.uint8)))
    assert "`schema`" in refused(path)


@pytest.mark.parametrize("text", [b"", b"{", b"\xff\xfe\xfa", b"[" * 100_000, b'{"a":NaN}'])
def test_a_header_that_is_no_json_is_refused(path: Path, text: bytes) -> None:
    with_array(path, "header", npy(np.frombuffer(text, np.uint8)))
    refused(path)


def set_in(tree: dict[str, Any], *keys_and_value: Any) -> None:
    *keys, last, value = keys_and_value
    at: Any = tree
    for key in keys:
        at = at[key]
    at[last] = value


@pytest.mark.parametrize(
    ("where", "value", "named"),
    [
        (("parts",), [], "`parts`"),
        (("made",), "yesterday", "`made`"),
        (("more",), 1, "`more`"),
        (("cad_sha256",), 7, "`cad_sha256`"),
        (("views", 0, "reach_mm"), -1, "`views.0.reach_mm`"),
        (("views", 0, "T_world_part"), np.zeros((4, 4)).tolist(), "`views.0.T_world_part`"),
        (("views", 0, "camera", "K"), np.zeros((3, 3)).tolist(), "`views.0.camera.K`"),
        (("views", 0, "pictures", 0, "usual"), 0, "`views.0.pictures.0.usual`"),
        (("views", 0, "step_px"), STEP_PX + 1, f"here they are {STEP_PX} px apart"),
        (("views", 0, "corner_px"), [-1, 0], "its grid is not in the picture"),
        (("views", 0, "corner_px"), [630, 0], "its grid is not in the picture"),
        (("views", 0, "pictures", 0, "lamp"), "side", "0.side.mean"),
    ],
)  # fmt: skip
def test_a_wrong_value_in_the_header_is_named(
    path: Path, where: tuple[Any, ...], value: Any, named: str
) -> None:
    with_header(path, lambda tree: set_in(tree, *where, value))
    assert named in refused(path)


# -- arrays ---------------------------------------------------------------------------------------

COARSE_SIZE = (FILTER_COUNT, *(-(-n // COARSE) for n in SIZE))


@pytest.mark.parametrize("name", ["header", "0.depth", "0.ring.mean", "0.ring.scatter"])
def test_a_missing_array_is_named(path: Path, name: str) -> None:
    with_array(path, name, None)
    assert name in refused(path)


WRONG: dict[str, tuple[str, Any]] = {
    "a depth of three dimensions": ("0.depth", np.ones((*SIZE, 1), np.float32)),
    "a depth that is none": ("0.depth", np.full(SIZE, np.nan, np.float32)),
    "a depth behind the camera": ("0.depth", np.full(SIZE, -1, np.float32)),
    "a depth in doubles": ("0.depth", np.ones(SIZE, np.float64)),
    "a mean of another size": ("0.ring.mean", np.ones((21, 29), np.float16)),
    "a mean without end": ("0.ring.mean", np.full(SIZE, np.inf, np.float16)),
    "a mean of names": ("0.ring.mean", np.full(SIZE, "a")),
    "a mean of records": ("0.ring.mean", np.zeros(SIZE, [("a", "f2"), ("b", "f2")])),
    "a mean of complex numbers": ("0.ring.mean", np.zeros(SIZE, np.complex64)),
    "a scatter of the fine size": ("0.ring.scatter", np.ones((FILTER_COUNT, *SIZE), np.float16)),
    "a scatter of fewer filters": ("0.ring.scatter", np.ones((2, *COARSE_SIZE[1:]), np.float16)),
    "a scatter of zero": ("0.ring.scatter", np.zeros(COARSE_SIZE, np.float16)),
    "a scatter that is none": ("0.ring.scatter", np.full(COARSE_SIZE, np.nan, np.float16)),
    "a scatter without dimensions": ("0.ring.scatter", np.float16(1)),
}


@pytest.mark.parametrize("what", WRONG)
def test_an_array_of_another_kind_is_refused(path: Path, what: str) -> None:
    name, array = WRONG[what]
    with_array(path, name, npy(array))
    refused(path)


class Tripwire:
    """Leaves a file behind where it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return (os.mkdir, (str(self.path),))


@pytest.mark.parametrize("name", ["header", "0.depth", "0.ring.mean"])
def test_nothing_in_it_is_run(path: Path, name: str) -> None:
    trap = path.parent / "sprung"
    pickled = npy(np.array([Tripwire(trap)], dtype=object), allow_pickle=True)
    with_array(path, name, pickled)
    refused(path)
    assert not trap.exists()
    np.load(io.BytesIO(pickled), allow_pickle=True)
    assert trap.exists()  # the trap works


def head(shape: str, kind: str = "<f2") -> bytes:
    """The beginning of an array file that claims a shape."""
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    text = text.ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


@pytest.mark.parametrize(
    "data",
    [
        head("(1000000, 1000000, 1000)") + b"\0" * 64,
        head("(-1, 30)") + b"\0" * 64,
        head("(-4, -15)") + b"\0" * 120,
        head("(9999999999999999999999, 2)"),
        head("(21, 30)") + b"\0" * 10,
        head("(21, 30)", "|O") + b"\0" * 1260,
        head("(21, 'a')"),
        head("(21, 30"),
        head("(((((((((") * 3,
        b"\x93NUMPY\x09\x00",
        b"\x93NUMPY\x01\x00\xff\xff",
        b"no array",
        b"",
    ],
)  # fmt: skip
def test_a_claimed_size_takes_no_memory(path: Path, data: bytes) -> None:
    with_array(path, "0.ring.mean", data)
    refused(path)


def test_an_archive_that_unpacks_to_more_than_a_gigabyte_is_refused_unread(path: Path) -> None:
    block = b"\0" * 2**24
    with (
        zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("0.more.npy", "w", force_zip64=True) as member,
    ):
        for _ in range(MAX_ARRAYS_BYTES // len(block) + 1):
            member.write(block)
    assert path.stat().st_size < 16 * 2**20
    assert "its arrays have more than 1024 MB" in refused(path)


def test_a_file_that_is_too_large_is_refused_unread(path: Path) -> None:
    os.truncate(path, 2**40)  # sparse: takes no room
    assert "KiB" in refused(path)


# -- the part it was learned from -----------------------------------------------------------------


def learned_of(folder: Path, cad: Path) -> Path:
    path = folder / "part.learned"
    write_learned(path, Appearance((view(),), np.zeros(3)), header(cad_sha256(cad)))
    return path


def test_a_part_of_another_cad_file_is_refused_with_what_to_do(tmp_path: Path) -> None:
    own, other = tmp_path / "own.stl", tmp_path / "other.stl"
    mesh_of(box(10, 10, 10)).export(own)
    mesh_of(box(10, 10, 11)).export(other)
    path = learned_of(tmp_path, own)
    assert len(learned_for(path, own).appearance.views) == 1
    with pytest.raises(ConfigError) as caught:
        learned_for(path, other)
    message = str(caught.value)
    assert str(path) in message
    assert str(other) in message
    assert "learn again with `cellctl learn`" in message


def test_another_body_of_one_file_is_another_part(tmp_path: Path) -> None:
    file = tmp_path / "rack.step"
    file.write_text("ISO-10303-21;")
    path = learned_of(tmp_path, tmp_path / "rack.step#left")
    learned_for(path, tmp_path / "rack.step#left")
    for other in ("rack.step#right", "rack.step"):
        with pytest.raises(ConfigError, match="another CAD model"):
            learned_for(path, tmp_path / other)


def test_a_file_written_anew_is_read_anew(path: Path) -> None:
    assert len(learned_for(path).appearance.views) == 1
    write_learned(path, Appearance((), np.zeros(3)), header())
    assert learned_for(path).appearance.views == ()


def test_a_learned_file_that_is_missing_names_the_command(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="`cellctl learn` writes this file"):
        learned_for(tmp_path / "none.learned")
