"""Request numbers and struct layouts against the kernel's header, and written-out numbers."""

import shutil
import subprocess
from pathlib import Path
from struct import Struct

import emu_camera_client as client
import pytest

from emulators.camera_v4l2.kernel import abi

HEADER = Path("/usr/include/linux/videodev2.h")
STRUCTS = {
    "v4l2_capability": abi.CAPABILITY,
    "v4l2_fmtdesc": abi.FMTDESC,
    "v4l2_format": abi.FORMAT,
    "v4l2_requestbuffers": abi.REQUESTBUFFERS,
    "v4l2_buffer": abi.BUFFER,
    "v4l2_streamparm": abi.STREAMPARM,
    "v4l2_input": abi.INPUT,
    "v4l2_control": abi.CONTROL,
    "v4l2_queryctrl": abi.QUERYCTRL,
    "v4l2_querymenu": abi.QUERYMENU,
    "v4l2_query_ext_ctrl": abi.QUERY_EXT_CTRL,
    "v4l2_ext_controls": abi.EXT_CONTROLS,
    "v4l2_ext_control": abi.EXT_CONTROL,
    "v4l2_frmsizeenum": abi.FRMSIZEENUM,
    "v4l2_frmivalenum": abi.FRMIVALENUM,
    "v4l2_event_subscription": abi.EVENT_SUBSCRIPTION,
    "v4l2_event": abi.EVENT,
}
# a field of the header, and the position of the same field in ours: packing it shows its offset
FIELDS = {
    ("v4l2_capability", "device_caps"): 5,
    ("v4l2_fmtdesc", "pixelformat"): 4,
    ("v4l2_format", "fmt.pix.sizeimage"): 6,
    ("v4l2_format", "fmt.pix.xfer_func"): 12,
    ("v4l2_buffer", "bytesused"): 2,
    ("v4l2_buffer", "timestamp.tv_sec"): 5,
    ("v4l2_buffer", "timestamp.tv_usec"): 6,
    ("v4l2_buffer", "sequence"): 8,
    ("v4l2_buffer", "memory"): 9,
    ("v4l2_buffer", "m.offset"): 10,
    ("v4l2_buffer", "length"): 11,
    ("v4l2_streamparm", "parm.capture.timeperframe.numerator"): 3,
    ("v4l2_input", "type"): 2,
    ("v4l2_input", "capabilities"): 7,
    ("v4l2_queryctrl", "flags"): 7,
    ("v4l2_query_ext_ctrl", "step"): 5,
    ("v4l2_query_ext_ctrl", "nr_of_dims"): 10,
    ("v4l2_ext_controls", "error_idx"): 2,
    ("v4l2_ext_controls", "controls"): 5,
    ("v4l2_ext_control", "value64"): 3,
    ("v4l2_frmsizeenum", "discrete.height"): 4,
    ("v4l2_frmivalenum", "discrete.denominator"): 6,
    ("v4l2_event", "pending"): 2,
    ("v4l2_event", "timestamp.tv_sec"): 4,
    ("v4l2_event", "id"): 6,
}


def offset_of(layout: Struct, position: int) -> int:
    zeros = layout.unpack(bytes(layout.size))
    values = [value if isinstance(value, bytes) else 0 for value in zeros]
    values[position] = 1
    return layout.pack(*values).index(1)


def ask_compiler(tmp_path: Path, expressions: list[str]) -> list[int]:
    lines = "".join(f'printf("%lu\\n", (unsigned long)({text}));' for text in expressions)
    source = tmp_path / "ask.c"
    source.write_text(
        "#include <linux/videodev2.h>\n#include <stddef.h>\n#include <stdio.h>\n"
        f"int main(void) {{ {lines} return 0; }}\n"
    )
    program = tmp_path / "ask"
    subprocess.run(["cc", "-o", program, source], check=True, timeout=600)
    answers = subprocess.run([program], check=True, timeout=600, capture_output=True, text=True)
    return [int(line) for line in answers.stdout.split()]


@pytest.mark.skipif(
    not HEADER.exists() or shutil.which("cc") is None, reason="no kernel header or no C compiler"
)
def test_every_number_is_that_of_the_kernels_header(tmp_path: Path) -> None:
    requests = list(abi.Request)
    asked = [f"VIDIOC_{request.name}" for request in requests]
    asked += [f"sizeof(struct {name})" for name in STRUCTS]
    asked += [f"offsetof(struct {name}, {field})" for name, field in FIELDS]
    asked += ["V4L2_BUF_FLAG_ERROR", "V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC"]
    asked += ["V4L2_BUF_FLAG_TSTAMP_SRC_SOE", "V4L2_BUF_FLAG_DONE", "V4L2_PIX_FMT_Y16"]
    expected = [int(request) for request in requests]
    expected += [layout.size for layout in STRUCTS.values()]
    expected += [offset_of(STRUCTS[name], place) for (name, _), place in FIELDS.items()]
    expected += [abi.BufferFlag.ERROR, abi.BufferFlag.TIMESTAMP_MONOTONIC]
    expected += [abi.BufferFlag.TSTAMP_SRC_SOE, abi.BufferFlag.DONE, abi.fourcc("Y16")]
    answers = ask_compiler(tmp_path, asked)
    assert dict(zip(asked, expected, strict=True)) == dict(zip(asked, answers, strict=True))


@pytest.mark.parametrize("request_", list(abi.Request), ids=lambda request: request.name)
def test_every_request_has_the_number_that_programs_use(request_: abi.Request) -> None:
    assert getattr(client, request_.name) == request_


@pytest.mark.parametrize("name", STRUCTS)
def test_every_struct_is_as_long_as_its_request_says(name: str) -> None:
    sizes = {abi.size_of_request(request) for request in abi.Request}
    assert STRUCTS[name].size in sizes or name == "v4l2_ext_control"  # an array behind a pointer
