"""Request numbers and struct layouts agree with the kernel's header."""

import shutil
import struct
import subprocess
from pathlib import Path

import pytest

from drivers.camera_v4l2.kernel import abi

HEADER = Path("/usr/include/linux/videodev2.h")

NUMBERS = {  # name in the header -> ours
    "VIDIOC_QUERYCAP": abi.VIDIOC_QUERYCAP,
    "VIDIOC_ENUM_FMT": abi.VIDIOC_ENUM_FMT,
    "VIDIOC_S_FMT": abi.VIDIOC_S_FMT,
    "VIDIOC_REQBUFS": abi.VIDIOC_REQBUFS,
    "VIDIOC_QUERYBUF": abi.VIDIOC_QUERYBUF,
    "VIDIOC_QBUF": abi.VIDIOC_QBUF,
    "VIDIOC_DQBUF": abi.VIDIOC_DQBUF,
    "VIDIOC_STREAMON": abi.VIDIOC_STREAMON,
    "VIDIOC_STREAMOFF": abi.VIDIOC_STREAMOFF,
    "VIDIOC_S_PARM": abi.VIDIOC_S_PARM,
    "VIDIOC_G_CTRL": abi.VIDIOC_G_CTRL,
    "VIDIOC_S_CTRL": abi.VIDIOC_S_CTRL,
    "VIDIOC_QUERYCTRL": abi.VIDIOC_QUERYCTRL,
    "VIDIOC_QUERYMENU": abi.VIDIOC_QUERYMENU,
    "V4L2_BUF_TYPE_VIDEO_CAPTURE": abi.BUF_TYPE_VIDEO_CAPTURE,
    "V4L2_MEMORY_MMAP": abi.MEMORY_MMAP,
    "V4L2_FIELD_ANY": abi.FIELD_ANY,
    "V4L2_FIELD_NONE": abi.FIELD_NONE,
    "V4L2_BUF_FLAG_TIMESTAMP_MASK": abi.TIMESTAMP_MASK,
    "V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC": abi.TIMESTAMP_MONOTONIC,
    "V4L2_BUF_FLAG_TSTAMP_SRC_MASK": abi.TSTAMP_SRC_MASK,
    "V4L2_BUF_FLAG_TSTAMP_SRC_EOF": abi.TSTAMP_SRC_EOF,
    "V4L2_BUF_FLAG_TSTAMP_SRC_SOE": abi.TSTAMP_SRC_SOE,
    "V4L2_CTRL_FLAG_NEXT_CTRL": abi.CTRL_FLAG_NEXT_CTRL,
    "V4L2_EXPOSURE_MANUAL": abi.EXPOSURE_MANUAL,
    "V4L2_CID_AUTO_WHITE_BALANCE": abi.ControlId.WHITE_BALANCE_AUTOMATIC,
    "V4L2_CID_AUTOGAIN": abi.ControlId.GAIN_AUTOMATIC,
    "V4L2_CID_GAIN": abi.ControlId.GAIN,
    "V4L2_CID_WHITE_BALANCE_TEMPERATURE": abi.ControlId.WHITE_BALANCE_TEMPERATURE,
    "V4L2_CID_EXPOSURE_AUTO": abi.ControlId.AUTO_EXPOSURE,
    "V4L2_CID_EXPOSURE_ABSOLUTE": abi.ControlId.EXPOSURE_TIME_ABSOLUTE,
    "V4L2_CID_EXPOSURE_AUTO_PRIORITY": abi.ControlId.EXPOSURE_AUTO_PRIORITY,
    "V4L2_CID_FOCUS_AUTO": abi.ControlId.FOCUS_AUTOMATIC,
    "V4L2_PIX_FMT_GREY": abi.fourcc("GREY"),
    "V4L2_PIX_FMT_Y10": abi.fourcc("Y10"),
    "V4L2_PIX_FMT_Y12": abi.fourcc("Y12"),
    "V4L2_PIX_FMT_Y16": abi.fourcc("Y16"),
    "V4L2_PIX_FMT_YUYV": abi.fourcc("YUYV"),
    "V4L2_PIX_FMT_MJPEG": abi.fourcc("MJPG"),
    "V4L2_PIX_FMT_JPEG": abi.fourcc("JPEG"),
    **{f"V4L2_CAP_{cap.name}": cap for cap in abi.Cap},
    **{f"V4L2_BUF_FLAG_{flag.name}": flag for flag in abi.BufFlag},
    **{f"V4L2_CTRL_FLAG_{flag.name}": flag for flag in abi.ControlFlag},
    **{f"V4L2_CTRL_TYPE_{kind.name}": kind for kind in abi.ControlType},
}

# Each value is written by C into the field named; the driver must read it back from the bytes.
FILLED = r"""
struct v4l2_capability cap = {.driver="d", .card="c", .bus_info="b", .version=1,
    .capabilities=2, .device_caps=3};
struct v4l2_fmtdesc desc = {.index=4, .type=V4L2_BUF_TYPE_VIDEO_CAPTURE,
    .pixelformat=V4L2_PIX_FMT_YUYV};
struct v4l2_format fmt = {.type=V4L2_BUF_TYPE_VIDEO_CAPTURE, .fmt.pix={.width=11, .height=12,
    .pixelformat=13, .field=14, .bytesperline=15, .sizeimage=16}};
struct v4l2_requestbuffers req = {.count=21, .type=V4L2_BUF_TYPE_VIDEO_CAPTURE,
    .memory=V4L2_MEMORY_MMAP};
struct v4l2_buffer buf = {.index=31, .type=V4L2_BUF_TYPE_VIDEO_CAPTURE, .bytesused=32, .flags=33,
    .timestamp={34, 35}, .sequence=36, .memory=V4L2_MEMORY_MMAP, .m.offset=37, .length=38};
struct v4l2_streamparm parm = {.type=V4L2_BUF_TYPE_VIDEO_CAPTURE,
    .parm.capture.timeperframe={1, 40}};
struct v4l2_control ctrl = {.id=51, .value=-52};
struct v4l2_queryctrl qc = {.id=61, .type=62, .name="n", .minimum=-63, .maximum=64, .step=65,
    .default_value=66, .flags=67};
struct v4l2_querymenu qm = {.id=71, .index=72, .name="item"};
"""
VARIABLES = ("cap", "desc", "fmt", "req", "buf", "parm", "ctrl", "qc", "qm")


@pytest.fixture(scope="module")
def header(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What a C compiler makes of the header: numbers in decimal, structs in hex."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or not HEADER.exists():
        pytest.skip("no C compiler or no linux/videodev2.h here: request numbers not refereed")
    folder = tmp_path_factory.mktemp("abi")
    lines = [f'printf("{name}=%llu\\n", (unsigned long long)(__u32){name});' for name in NUMBERS]
    for name in VARIABLES:
        lines.append(f'printf("{name}="); dump(&{name}, sizeof {name});')
    source = (
        "#include <stdio.h>\n#include <linux/videodev2.h>\n"
        + FILLED
        + "static void dump(void *p, unsigned n) { unsigned char *c = p;"
        ' while (n--) printf("%02x", *c++); printf("\\n"); }\n'
        + "int main(void) {\n"
        + "\n".join(lines)
        + "\nreturn 0; }\n"
    )
    (folder / "abi.c").write_text(source)
    subprocess.run([compiler, "-o", folder / "abi", folder / "abi.c"], check=True, timeout=600)
    told = subprocess.run([folder / "abi"], check=True, capture_output=True, text=True, timeout=600)
    return dict(line.split("=", 1) for line in told.stdout.splitlines())


@pytest.mark.parametrize("name", NUMBERS)
def test_each_number_is_the_kernel_headers(name: str, header: dict[str, str]) -> None:
    assert int(NUMBERS[name]) == int(header[name])


def test_structs_filled_by_the_compiler_are_read_field_by_field(header: dict[str, str]) -> None:
    raw = {name: bytes.fromhex(header[name]) for name in VARIABLES}
    assert abi.Capability.unpack(raw["cap"]) == abi.Capability("d", "c", "b", 1, 2, 3)
    assert abi.fourcc_name(abi.unpack_fmtdesc(raw["desc"])) == "YUYV"
    assert abi.PixFormat.unpack(raw["fmt"]) == abi.PixFormat(11, 12, 13, 14, 15, 16)
    assert abi.unpack_requestbuffers(raw["req"]) == 21
    assert abi.Buffer.unpack(raw["buf"]) == abi.Buffer(31, 32, 33, 34_000_035, 36, 37, 38)
    assert abi.unpack_streamparm(raw["parm"]) == pytest.approx(1 / 40)
    assert abi.unpack_control(raw["ctrl"]) == -52
    assert abi.QueryCtrl.unpack(raw["qc"]) == abi.QueryCtrl(61, 62, "n", -63, 64, 65, 66, 67)
    assert abi.unpack_querymenu(raw["qm"], abi.ControlType.MENU) == "item"


def test_structs_to_send_are_the_compilers_own_bytes(header: dict[str, str]) -> None:
    raw = {name: bytes.fromhex(header[name]) for name in VARIABLES}
    assert abi.PixFormat(11, 12, 13, 14, 15, 16).pack() == raw["fmt"]
    assert abi.pack_requestbuffers(21) == raw["req"]
    assert abi.pack_streamparm(1, 40) == raw["parm"]
    assert abi.pack_control(51, -52) == raw["ctrl"]
    asked = abi.Buffer.query(31)
    assert len(asked) == len(raw["buf"])
    assert asked[:8] == raw["buf"][:8]  # index and type
    assert asked[60:64] == raw["buf"][60:64]  # memory
    assert len(abi.Capability.query()) == len(raw["cap"])
    assert abi.QueryCtrl.query(61)[:4] == raw["qc"][:4]
    assert len(abi.QueryCtrl.query(61)) == len(raw["qc"])
    assert abi.pack_querymenu(71, 72)[:8] == raw["qm"][:8]
    assert len(abi.pack_querymenu(71, 72)) == len(raw["qm"])
    assert abi.pack_fmtdesc(4)[:8] == raw["desc"][:8]
    assert len(abi.pack_fmtdesc(4)) == len(raw["desc"])


def test_request_numbers_carry_the_sizes_the_reference_states() -> None:
    # v4l2.md 1, used against three clients
    sizes = {
        abi.VIDIOC_QUERYCAP: 104,
        abi.VIDIOC_ENUM_FMT: 64,
        abi.VIDIOC_S_FMT: 208,
        abi.VIDIOC_REQBUFS: 20,
        abi.VIDIOC_DQBUF: 88,
        abi.VIDIOC_S_PARM: 204,
        abi.VIDIOC_QUERYCTRL: 68,
        abi.VIDIOC_QUERYMENU: 44,
    }
    assert {request: request >> 16 & 0x3FFF for request in sizes} == sizes


def test_a_menu_of_numbers_is_read_as_numbers() -> None:
    raw = struct.pack("<IIq28x", 71, 0, -5_000_000_000)
    assert abi.unpack_querymenu(raw, abi.ControlType.INTEGER_MENU) == "-5000000000"


@pytest.mark.parametrize("name", ["GREY", "Y10", "YUYV"])
def test_a_fourcc_comes_back_as_its_name(name: str) -> None:
    assert abi.fourcc_name(abi.fourcc(name)) == name


@pytest.mark.parametrize("name", ["", "GREYS", "Gré"])
def test_what_is_no_fourcc_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="FourCC"):
        abi.fourcc(name)
