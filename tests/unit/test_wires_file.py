"""The file of wires: what was written comes back, and a kill costs what was not yet whole."""

import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.recorded_wires import WireFileError, WireReader, WireWriter

Written = tuple[float, str, str, object, bytes]


def written(path: Path, rows: list[Written]) -> Path:
    writer = WireWriter(path)
    for row in rows:
        writer.write(*row)
    writer.close()
    return path


def read(path: Path) -> list[Written]:
    reader = WireReader(path)
    try:
        return [(r.at_s, r.wire, r.kind, r.info, reader.data(r)) for r in reader.rows]
    finally:
        reader.close()


@given(
    rows=st.lists(
        st.tuples(
            st.floats(0, 1e6),
            st.text(max_size=20),
            st.sampled_from(["sent", "got", "turn"]),
            st.none() | st.text(max_size=30) | st.lists(st.integers(), max_size=3),
            st.binary(max_size=200),
        ),
        max_size=20,
    )
)
def test_what_was_written_comes_back(
    rows: list[Written], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("wires") / "run.wires"
    assert read(written(path, rows)) == rows


@pytest.mark.parametrize("share", [0.3, 0.7, 0.95])
def test_a_file_cut_anywhere_is_read_up_to_its_last_whole_block(
    tmp_path: Path, share: float
) -> None:
    # each picture of 5 MB fills a block of its own
    rows: list[Written] = [
        (float(n), "overhead", "picture", None, bytes([n]) * 5_000_000) for n in range(6)
    ]
    whole = written(tmp_path / "whole.wires", rows).read_bytes()
    cut = tmp_path / "cut.wires"
    cut.write_bytes(whole[: int(share * len(whole))])
    found = read(cut)
    assert found == rows[: len(found)]
    assert 0 < len(found) < 6
    reader = WireReader(cut)
    assert not reader.is_whole
    reader.close()


def test_a_damaged_block_ends_the_file(tmp_path: Path) -> None:
    rows: list[Written] = [(float(n), "arm", "sent", None, bytes(5_000_000)) for n in range(4)]
    path = written(tmp_path / "run.wires", rows)
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 2] ^= 0x01
    path.write_bytes(damaged)
    found = read(path)
    assert found == rows[: len(found)]
    assert len(found) < 4


def test_rows_are_on_the_disk_before_the_writer_is_closed(tmp_path: Path) -> None:
    writer = WireWriter(tmp_path / "run.wires")
    writer.write(1.0, "arm", "sent", None, b"\x41")
    until = time.monotonic() + 60  # a guard against a hang
    while not read(writer.path) and time.monotonic() < until:
        pass
    assert read(writer.path) == [(1.0, "arm", "sent", None, b"\x41")]
    writer.close()


def test_only_a_file_whose_writer_ended_its_run_is_whole(tmp_path: Path) -> None:
    path = written(tmp_path / "run.wires", [(1.0, "run", "end", None, b"")])
    reader = WireReader(path)
    assert reader.is_whole
    reader.close()


def test_other_files_are_refused(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.write_bytes(b"SQLite format 3\0")
    with pytest.raises(WireFileError, match="no file that `cellctl run --record` writes"):
        WireReader(other)
    with pytest.raises(WireFileError, match="No such file"):
        WireReader(tmp_path / "none")
    with pytest.raises(WireFileError, match="exists already"):
        WireWriter(other)
