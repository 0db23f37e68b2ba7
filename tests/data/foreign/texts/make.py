"""Make the foreign texts: lists, settings and models as other programs write them.

python tests/data/foreign/texts/make.py writes the files beside it; truth.json, which is written by
hand, says what each one means or why it is refused.
"""

from pathlib import Path

FOLDER = Path(__file__).resolve().parent
RECIPE = "name: {name}\npart: part.stl\ndensity_g_cm3: {density}\n"
CSG = "unit: mm\npart:\n  block: {{size: [{size}]}}\n"
CAMERA = (
    '{{"size_px": [640, 480],\n "K": [[{fx}, 0, 320], [0, 800, 240], [0, 0, 1]],\n'
    ' "distortion": [0, 0, 0, 0, 0],\n'
    ' "T_world_cam": [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, {z}], [0, 0, 0, 1]]{end}}}\n'
)


def camera(fx: str = "800", z: str = "900", end: str = "") -> str:
    return CAMERA.format(fx=fx, z=z, end=end)


FILES = {
    # lists of parts
    "list_mark_crlf.csv": "recipe;serial\r\nwidget;Größe 1\r\n".encode("utf-8-sig"),
    "list_utf16_tabs.csv": "recipe\tserial\r\nwidget\tGröße 1\r\n".encode("utf-16"),
    "list_sep_line.csv": b"sep=;\r\nrecipe;serial\r\nwidget;A1\r\n",
    "list_cr.csv": b"recipe,serial\rwidget,A1\r",
    "list_latin1.csv": "recipe;serial\nwidget;Größe 1\n".encode("latin-1"),
    "list_column_twice.csv": b"recipe;serial;serial\nwidget;A1;A2\n",
    "list_trailing_comma.csv": b"recipe,serial,\nwidget,A1,\n",
    # reference values of a gauge study
    "reference_decimal_comma.csv": b"characteristic;value;U\r\nd1;12,345;0,004\r\n",
    "reference_utf16_sep.csv": "sep=;\r\ncharacteristic;value\r\nd1;12,345\r\n".encode("utf-16"),
    "reference_tabs.csv": b"characteristic\tvalue\nd1\t12.345\n",
    "reference_comma_between.csv": b"characteristic,value\nd1,12,345\n",
    "reference_nan.csv": b"characteristic,value\nd1,NaN\n",
    "reference_beyond.csv": b"characteristic,value\nd1,1e308\n",
    # recipes
    "recipe_mark_crlf.yaml": RECIPE.format(name="plate", density=2.7)
    .replace("\n", "\r\n")
    .encode("utf-8-sig"),
    "recipe_utf16.yaml": RECIPE.format(name="plate", density=2.7).encode("utf-16"),
    "recipe_cr_comment_latin1.yaml": ("# für Müller\n" + RECIPE.format(name="plate", density=2.7))
    .replace("\n", "\r")
    .encode("latin-1"),
    "recipe_decimal_comma.yaml": RECIPE.format(name="plate", density="2,7").encode(),
    "recipe_key_twice.yaml": (RECIPE.format(name="plate", density=2.7) + "name: other\n").encode(),
    "recipe_tab.yaml": b"name: plate\npart: part.stl\ninspection:\n\tmin_coverage: 0.9\n",
    "recipe_nan.yaml": RECIPE.format(name="plate", density=".nan").encode(),
    "recipe_latin1.yaml": RECIPE.format(name="Gehäuse", density=2.7).encode("latin-1"),
    # calibrations
    "camera_mark_crlf.json": camera().replace("\n", "\r\n").encode("utf-8-sig"),
    "camera_utf16.json": camera().encode("utf-16"),
    "camera_cr.json": camera().replace("\n", "\r").encode(),
    "camera_nan.json": camera(fx="NaN").encode(),
    "camera_beyond.json": camera(z="1e308").encode(),
    "camera_decimal_comma.json": camera(z="900,5").encode(),
    "camera_trailing_comma.json": camera(end=",").encode(),
    "camera_key_twice.json": camera(end=',\n "size_px": [1280, 1024]').encode(),
    # solids as text
    "block_mark_cr.csg.yaml": CSG.format(size="60, 40, 20").replace("\n", "\r").encode("utf-8-sig"),
    "block_utf16.csg.yaml": CSG.format(size="60, 40, 20").encode("utf-16"),
    "block_decimal_comma.csg.yaml": CSG.format(size='"60,5", 40, 20').encode(),
    "block_beyond.csg.yaml": CSG.format(size="1e308, 40, 20").encode(),
    "block_key_twice.csg.yaml": (CSG.format(size="60, 40, 20") + "unit: inch\n").encode(),
    "block_tab.csg.yaml": b"unit: mm\npart:\n\tblock: {size: [60, 40, 20]}\n",
}

if __name__ == "__main__":
    for name, data in FILES.items():
        (FOLDER / name).write_bytes(data)
