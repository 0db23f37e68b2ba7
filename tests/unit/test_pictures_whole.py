"""Pictures that lost data are refused in every format read, whole ones give their pixels."""

import struct
import zlib
from itertools import pairwise

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.pictures import BrokenPictureError, decode

SHAPE = (256, 320)


def scene(seed: int) -> NDArray[np.uint8]:
    """A part before a bright table, with a sensor's noise."""
    rng = np.random.default_rng(seed)
    levels = np.full(SHAPE, 200.0)
    cv2.rectangle(levels, (90, 60), (240, 190), 25.0, -1)
    cv2.circle(levels, tuple(rng.integers(100, 180, 2).tolist()), 25, 180.0, -1)
    noisy = cv2.GaussianBlur(levels, (0, 0), 1.2) + rng.normal(0.0, 2.0, SHAPE)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def encoded(ending: str, image: NDArray[np.generic], *options: int) -> bytes:
    return cv2.imencode(ending, np.asarray(image), options)[1].tobytes()


def encodings() -> dict[str, bytes]:
    grey = scene(1)
    deep = grey.astype(np.uint16) * 257
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    tiff = cv2.IMWRITE_TIFF_COMPRESSION
    return {
        "png": encoded(".png", grey),
        "png of 16 bits": encoded(".png", deep),
        "png of two levels": encoded(".png", grey // 128 * 255, cv2.IMWRITE_PNG_BILEVEL, 1),
        "png in colour": encoded(".png", colour),
        "bmp": encoded(".bmp", grey),
        "bmp in colour": encoded(".bmp", colour),
        "tiff": encoded(".tiff", grey, tiff, 1),
        "tiff of 16 bits": encoded(".tiff", deep, tiff, 1),
        "tiff, lzw": encoded(".tiff", grey, tiff, 5),
        "tiff, deflate": encoded(".tiff", grey, tiff, 8),
        "pgm": encoded(".pgm", grey),
        "pgm of 16 bits": encoded(".pgm", deep),
        "pgm in text": encoded(".pgm", grey, cv2.IMWRITE_PXM_BINARY, 0),
        "ppm": encoded(".ppm", colour),
        "pbm": encoded(".pbm", grey // 128 * 255),
        "pbm in text": encoded(".pbm", grey // 128 * 255, cv2.IMWRITE_PXM_BINARY, 0),
        "webp": encoded(".webp", colour, cv2.IMWRITE_WEBP_QUALITY, 101),
    }


ENCODINGS = encodings()


def test_the_text_formats_are_text() -> None:
    assert ENCODINGS["pgm in text"].startswith(b"P2")
    assert ENCODINGS["pbm in text"].startswith(b"P1")


@pytest.mark.parametrize("name", ENCODINGS)
def test_a_whole_file_gives_its_pixels(name: str) -> None:
    image = decode(ENCODINGS[name], "stored")
    first = image if image.ndim == 2 else image[..., 0]
    expected = scene(1).astype(image.dtype) * (257 if image.dtype == np.uint16 else 1)
    if name.startswith(("pbm", "png of two")):
        expected = expected // 128 * 255
    assert np.array_equal(first, expected)


@pytest.mark.parametrize("name", ENCODINGS)
def test_a_file_cut_off_anywhere_is_refused(name: str) -> None:
    data = ENCODINGS[name]
    for share in np.linspace(0.02, 0.98, 25):
        with pytest.raises(BrokenPictureError):
            decode(data[: int(share * len(data))], "stored")


@pytest.mark.parametrize("name", ENCODINGS)
def test_a_file_that_lost_a_piece_of_its_middle_is_refused(name: str) -> None:
    data = ENCODINGS[name]
    for share in np.linspace(0.2, 0.8, 13):
        at = int(share * len(data))
        with pytest.raises(BrokenPictureError):
            decode(data[:at] + data[at + len(data) // 10 :], "stored")


def test_a_png_that_lost_a_whole_chunk_of_pixels_is_refused() -> None:
    rows = b"".join(b"\0" + row.tobytes() for row in scene(2))
    packed = zlib.compress(rows)
    parts = [packed[a:b] for a, b in pairwise(range(0, len(packed) + 9000, 9000))]

    def png(pieces: list[bytes]) -> bytes:
        head = struct.pack(">IIBBBBB", SHAPE[1], SHAPE[0], 8, 0, 0, 0, 0)
        chunks = [(b"IHDR", head), *((b"IDAT", p) for p in pieces), (b"IEND", b"")]
        return b"\x89PNG\r\n\x1a\n" + b"".join(
            struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d))
            for n, d in chunks
        )

    assert np.array_equal(decode(png(parts), "grey"), scene(2))
    with pytest.raises(BrokenPictureError):
        decode(png(parts[:2] + parts[3:]), "grey")
    with pytest.raises(BrokenPictureError, match="pixels unpack to"):
        decode(png([zlib.compress(rows[: len(rows) // 2])]), "grey")


def jpegs() -> list[tuple[bytes, NDArray[np.generic]]]:
    """JPEGs as cameras make them: grey or 4:2:2, with and without restart markers."""
    made = []
    for seed, (interval, in_colour) in enumerate(
        (interval, in_colour) for interval in (0, 1, 8) for in_colour in (False, True)
    ):
        image: NDArray[np.generic] = scene(10 + seed)
        options = [cv2.IMWRITE_JPEG_QUALITY, 90, cv2.IMWRITE_JPEG_RST_INTERVAL, interval]
        if in_colour:
            image = cv2.cvtColor(scene(10 + seed), cv2.COLOR_GRAY2BGR)
            options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422]
        data = encoded(".jpg", image, *options)
        levels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        made.append((data, np.asarray(levels)))
    return made


def test_a_whole_jpeg_gives_opencvs_levels() -> None:
    for data, levels in jpegs():
        assert np.array_equal(decode(data, "grey"), levels)
        assert np.array_equal(decode(data + bytes(700), "grey"), levels)  # a buffer's zeros


def test_a_jpeg_that_lost_data_between_its_ends_is_refused() -> None:
    rng = np.random.default_rng(3)
    for data, _ in jpegs():
        begin = data.rindex(b"\xff\xda") + 14
        for _ in range(40):
            at = int(rng.integers(begin, len(data) - 1100))
            for broken in (
                data[:at] + b"\xff\xd9",
                data[:at] + data[at + 1020 :],  # one packet of USB less
                data[:at] + data[at : at + 1020] + data[at:],  # one twice
            ):
                with pytest.raises(BrokenPictureError):
                    decode(broken, "grey")


def test_a_jpeg_without_tables_is_read_by_the_standard_ones() -> None:
    data, levels = jpegs()[0]
    bare, at = bytearray(data[:2]), 2
    while data[at + 1] != 0xDA:
        length = 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at + 1] != 0xC4:
            bare += data[at : at + length]
        at += length
    assert np.array_equal(decode(bytes(bare) + data[at:], "grey"), levels)
