"""Codes on parts: which of them are read, by module width, by the cell's reader and by others.

    python benchmarks/bench_codes.py [--count 60] [--seed 40] [--json]

Codes are drawn as laser and printer mark them, and seen as the cell's cameras see them: tilted up
to 35 degrees, in any turn, dim, blurred, on brushed metal (`printed_codes.py`; its symbols come
from other encoders than the readers'). The cell's reader is tried beside zxing-cpp on the picture
as it is, and OpenCV's for QR codes. What a camera sees of a code: a module of 0.5 mm is 1.4 pixels
wide on the table of the emulated cell and 2.7 before the inspection camera. Seeds below 40 were
used to develop with.

Exit 1: a code was read wrong, or of those from `MIN_MODULE_PX` on fewer than nine in ten.
"""

import sys
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from bench import Arguments, need_module, show

WIDTHS_PX = (1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 8.0)
SHARE = 0.9  # of codes that are wide enough


def main() -> int:
    """Draw codes, have them read, print the table."""
    parser = Arguments(__doc__, count=12)
    parser.add_argument("--count", type=int, default=60, help="codes of each kind and width")
    parser.add_argument("--seed", type=int, default=40)
    args = parser.parse_args()
    for name in ("zxingcpp", "segno", "ppf.datamatrix"):
        need_module(name)
    import zxingcpp

    from benchmarks.printed_codes import Kind, markings, printed
    from controller.arrays import Grey
    from controller.imaging.codes import MIN_MODULE_PX, read_codes

    formats = zxingcpp.BarcodeFormats(
        [zxingcpp.BarcodeFormat.DataMatrix, zxingcpp.BarcodeFormat.QRCode]
    )
    opencv = cv2.QRCodeDetector()

    def by_opencv(picture: Grey) -> list[str]:
        try:
            return [opencv.detectAndDecode(picture)[0]]
        except cv2.error:  # it raises on some pictures without a code
            return []

    readers: dict[str, Callable[[Grey], list[str]]] = {
        "cell": lambda picture: [one.text for one in read_codes(picture, ("data_matrix", "qr"))],
        "zxing": lambda picture: [
            one.text for one in zxingcpp.read_barcodes(picture, formats=formats)
        ],
        "opencv": by_opencv,
    }
    kinds: tuple[Kind, ...] = ("data_matrix", "qr")
    table: list[dict[str, Any]] = []
    wrong, taken_s, right = 0, 0.0, [0, 0]
    for kind in kinds:
        for dots in (False, True):
            for width_px in WIDTHS_PX:
                rng = np.random.default_rng([args.seed, int(10 * width_px), dots])
                found = dict.fromkeys(readers, 0)
                for marking in markings(rng, args.count, width_px, kind, dots=dots):
                    picture = printed(rng, marking).image
                    for name, read in readers.items():
                        began = time.perf_counter()
                        texts = read(picture)
                        if name == "cell":
                            taken_s += time.perf_counter() - began
                            wrong += any(text != marking.text for text in texts)
                        found[name] += marking.text in texts
                if width_px >= MIN_MODULE_PX:
                    right[0] += found["cell"]
                    right[1] += args.count
                shares = {f"{name} %": round(100 * n / args.count) for name, n in found.items()}
                if kind == "data_matrix":
                    shares["opencv %"] = None  # it reads none
                mark = "dots" if dots else "squares"
                table.append({"code": kind, "marks": mark, "module px": width_px, **shares})
    blank = sum(bool(read_codes(picture, kinds)) for picture in _blanks(args.seed, args.count))
    share = right[0] / right[1]
    sums = {
        "codes": len(table) * args.count,
        "read wrong": wrong,
        "pictures without a code": args.count,
        "codes read there": blank,
        f"read from {MIN_MODULE_PX:g} px on": round(share, 3),
        "ms a picture": round(1000 * taken_s / (len(table) * args.count)),
    }
    show(args, table, sums)
    return 0 if not wrong and not blank and share >= SHARE else 1


def _blanks(seed: int, count: int) -> list[Any]:
    """Return pictures of brushed metal, with edges and holes, and no code."""
    rng = np.random.default_rng([seed, 1])
    found = []
    for _ in range(count):
        streaks = cv2.blur(rng.normal(0, 1, (220, 220)), (31, 1)) * np.sqrt(31)
        picture = rng.uniform(15, 140) * (1 + rng.uniform(0.03, 0.3) * streaks)
        for _ in range(12):
            centre = tuple(int(v) for v in rng.integers(0, 220, 2))
            cv2.circle(picture, centre, int(rng.integers(2, 20)), rng.uniform(0, 200), -1)
        found.append(np.clip(picture, 0, 255).astype(np.uint8))
    return found


if __name__ == "__main__":
    sys.exit(main())
