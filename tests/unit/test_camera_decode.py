"""Bytes of a buffer into grey values: pictures made here, packed here, compared exactly."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from drivers.camera_v4l2 import decode
from drivers.camera_v4l2.kernel.abi import PixFormat, fourcc
from drivers.pictures import BrokenPictureError

sides = st.integers(1, 12)
paddings = st.integers(0, 9)
fillers = st.integers(0, 255)


def raw_format(name: str, width: int, height: int, line: int) -> PixFormat:
    return PixFormat(width, height, fourcc(name), bytesperline=line, sizeimage=line * height)


def padded(rows: list[bytes], padding: int, filler: int) -> bytes:
    return b"".join(row + bytes([filler]) * padding for row in rows)


def read_only(image: np.ndarray) -> bool:
    return not image.flags.writeable and image.flags.c_contiguous


@given(picture=hnp.arrays(np.uint8, st.tuples(sides, sides)), padding=paddings, filler=fillers)
def test_grey_is_the_bytes_without_the_rows_padding(
    picture: np.ndarray, padding: int, filler: int
) -> None:
    height, width = picture.shape
    data = padded([row.tobytes() for row in picture], padding, filler)
    image = decode(data, raw_format("GREY", width, height, width + padding))
    assert image.dtype == np.uint8
    assert read_only(image)
    np.testing.assert_array_equal(image, picture)


@given(
    picture=hnp.arrays(np.uint8, st.tuples(sides, sides)),
    chroma=fillers,
    padding=paddings,
)
def test_yuyv_is_its_luma(picture: np.ndarray, chroma: int, padding: int) -> None:
    height, width = picture.shape
    rows = [bytes(b for luma in row for b in (luma, chroma)) for row in picture.tolist()]
    data = padded(rows, padding, 255 - chroma)
    image = decode(data, raw_format("YUYV", width, height, 2 * width + padding))
    assert read_only(image)
    np.testing.assert_array_equal(image, picture)


@pytest.mark.parametrize(("name", "bits"), [("Y10", 10), ("Y12", 12), ("Y16", 16)])
@given(picture=hnp.arrays(np.uint16, st.tuples(sides, sides)), padding=paddings)
def test_words_are_little_endian_and_cut_to_their_bits(
    name: str, bits: int, picture: np.ndarray, padding: int
) -> None:
    height, width = picture.shape
    rows = [b"".join(v.to_bytes(2, "little") for v in row) for row in picture.tolist()]
    image = decode(padded(rows, padding, 255), raw_format(name, width, height, 2 * width + padding))
    assert image.dtype == np.uint16
    assert read_only(image)
    np.testing.assert_array_equal(image, picture.astype(int) % 2**bits)


def test_a_driver_that_gives_no_row_length_means_packed_rows() -> None:
    packed = PixFormat(3, 2, fourcc("GREY"), bytesperline=0, sizeimage=6)
    assert decode(bytes(range(6)), packed).tolist() == [[0, 1, 2], [3, 4, 5]]


@pytest.mark.parametrize("size", [0, 1, 11, 13])
def test_a_raw_picture_of_another_size_is_broken(size: int) -> None:
    with pytest.raises(BrokenPictureError, match=f"{size} bytes of 12"):
        decode(bytes(size), raw_format("GREY", 4, 3, 4))


WIDTH, HEIGHT = 64, 48
JPEG = PixFormat(WIDTH, HEIGHT, fourcc("MJPG"), sizeimage=WIDTH * HEIGHT * 2)


def ramp() -> np.ndarray:
    return np.linspace(0, 255, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH).astype(np.uint8)


def jpeg_of(picture: np.ndarray, quality: int = 100) -> bytes:
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def test_a_jpeg_gives_its_picture_back_within_its_loss() -> None:
    image = decode(jpeg_of(ramp()), JPEG)
    assert image.shape == (HEIGHT, WIDTH)
    assert read_only(image)
    assert np.abs(image.astype(int) - ramp()).max() <= 3


def test_a_colour_jpeg_gives_its_luma() -> None:
    blue = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    blue[..., 0] = 255
    image = decode(jpeg_of(blue), JPEG)
    assert np.abs(image.astype(int) - 29).max() <= 2  # JFIF: Y = 0.114 B


def test_zeros_behind_a_jpeg_do_no_harm() -> None:
    plain = decode(jpeg_of(ramp()), JPEG)
    np.testing.assert_array_equal(decode(jpeg_of(ramp()) + bytes(100), JPEG), plain)


def test_a_cameras_jpeg_without_huffman_tables_decodes_by_the_usual_ones() -> None:
    # UVC cameras leave the tables out; libjpeg then takes those of the standard's annex K
    data, kept, at = jpeg_of(ramp()), b"", 2
    while data[at + 1] != 0xDA:  # segments before the scan: marker, length, body
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at + 1] != 0xC4:
            kept += data[at : at + 2 + length]
        at += 2 + length
    without = data[:2] + kept + data[at:]
    assert len(without) < len(data)
    np.testing.assert_array_equal(decode(without, JPEG), decode(data, JPEG))


def test_an_orientation_tag_does_not_turn_the_sensors_rows() -> None:
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    segment = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    data = jpeg_of(ramp())
    np.testing.assert_array_equal(decode(data[:2] + segment + data[2:], JPEG), decode(data, JPEG))


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "nothing"),
        (jpeg_of(ramp())[2:], "starts with"),
        (jpeg_of(ramp())[:-2], "without its end"),
        (jpeg_of(ramp())[:200], "without its end"),
        (b"\xff\xd8\xff\xd9", "not a readable picture"),
        (b"\xff\xd8" + bytes(range(1, 60)) + b"\xff\xd9", "not a readable picture"),
        (jpeg_of(ramp()[:40]), "64 x 40 px"),
    ],
)
def test_a_broken_jpeg_is_said_to_be(data: bytes, said: str) -> None:
    with pytest.raises(BrokenPictureError, match=said):
        decode(data, JPEG)


@given(st.binary(max_size=200))
def test_no_bytes_between_a_jpegs_ends_raise_anything_else(middle: bytes) -> None:
    try:
        image = decode(b"\xff\xd8" + middle + b"\xff\xd9", JPEG)
    except BrokenPictureError:
        return
    assert image.shape == (HEIGHT, WIDTH)
