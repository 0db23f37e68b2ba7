"""Make the pictures of docs/commissioning.md from the folder of a commissioning.

cellctl commission --cell recipes/cells/emulated.yaml --out FOLDER --yes --as-built 3 --seed 1
python benchmarks/picture_commissioning.py FOLDER
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import cv2
import plutoprint

OUT: Final = Path(__file__).parents[1] / "docs" / "pictures"
WIDTH_PX: Final = 480
QUALITY: Final = 80
# picture of the docs: step, and picture of its evidence
WANTED: Final[Mapping[str, tuple[str, str]]] = {
    "commissioning_lamp": ("light", "table_side_overhead"),
    "commissioning_board": ("arm", "mark"),
    "commissioning_plate_table": ("arm", "overhead_*"),
    "commissioning_plate_station": ("arm", "inspection_*"),
    "commissioning_fingers": ("arm", "fingers_03"),
}


def write(name: str, source: Path) -> None:
    """Write one picture, made smaller."""
    picture = cv2.imread(str(source))
    height = round(picture.shape[0] * WIDTH_PX / picture.shape[1])
    small = cv2.resize(picture, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(OUT / f"{name}.jpg"), small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="of a commissioning whose steps are done")
    folder: Path = parser.parse_args().folder
    OUT.mkdir(exist_ok=True)
    for name, (step, pattern) in WANTED.items():
        evidence = max((folder / "evidence").glob(f"*-{step}"))
        found = sorted(evidence.glob(f"{pattern}.png"))
        if not found:
            raise SystemExit(f"{evidence}: no picture {pattern}")
        write(name, found[len(found) // 2])
    page = plutoprint.Book(plutoprint.PAGE_SIZE_A4)
    page.load_url((folder / "commissioning.html").resolve().as_uri())
    png = OUT / "commissioning_page.png"
    canvas = plutoprint.ImageCanvas(794, 700)
    canvas.clear_surface(1.0, 1.0, 1.0)
    page.render_page(canvas, 0)
    canvas.write_to_png(str(png))
    write("commissioning_page", png)
    png.unlink()


if __name__ == "__main__":
    main()
