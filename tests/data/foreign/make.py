"""Writes the files of this folder as other programs would, and what each means: ``truth.json``.

Run it here: ``python make.py``. It needs no library, and nothing of the code under test.
"""

# ruff: noqa: ANN001, ANN002, ANN003, ANN201, ANN202, ANN204, B905
import json
import struct
import zipfile
from pathlib import Path

HERE = Path(__file__).parent
SIZE = (60.0, 40.0, 20.0)
BLOCK = {"size_mm": SIZE, "volume_mm3": 48_000.0}
QUADS = ((1, 4, 3, 2), (5, 6, 7, 8), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8))


def corners(size=SIZE, at=(0.0, 0.0, 0.0)):
    (a, b, c), (x, y, z) = size, at
    plan = ((0, 0), (a, 0), (a, b), (0, b))
    return [(x + u, y + v, z + w) for w in (0, c) for u, v in plan]


def triangles(quads=QUADS):
    return [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]


def stl(name="block", end="endsolid", number="{:.6e}", facet="  facet normal 0 0 0"):
    points = corners()
    lines = [f"solid {name}"]
    for triangle in triangles():
        lines += [facet, "    outer loop"]
        lines += [
            "      vertex " + " ".join(number.format(x) for x in points[k - 1]) for k in triangle
        ]
        lines += ["    endloop", "  endfacet"]
    return "\n".join([*lines, f"{end} {name}", ""])


def binary_stl(header):
    points = corners()
    data = header.ljust(80, b" ") + struct.pack("<I", 12)
    for triangle in triangles():
        numbers = (0.0, 0.0, 0.0, *(x for k in triangle for x in points[k - 1]))
        data += struct.pack("<12fH", *numbers, 0)
    return data


def v(points, number="{:g}"):
    return ["v " + " ".join(number.format(x) for x in p) for p in points]


def f(faces, form="{}"):
    return ["f " + " ".join(form.format(k) for k in face) for face in faces]


def obj(*groups):
    return "\n".join([line for group in groups for line in group] + [""])


def relative(faces, back):
    return [tuple(k - back - 1 for k in face) for face in faces]


def turned(faces):
    return [tuple(reversed(face)) for face in faces]


def ply(form, head_end="\n", comment="made by hand"):
    lines = ["ply", f"format {form} 1.0", f"comment {comment}", "element vertex 8"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += ["element face 6", "property list uchar int vertex_indices", "end_header", ""]
    return head_end.join(lines)


def ply_text(number="{:g}"):
    rows = [" ".join(number.format(x) for x in p) for p in corners()]
    rows += ["4 " + " ".join(str(k - 1) for k in quad) for quad in QUADS]
    return "\n".join([*rows, ""])


def ply_binary(order):
    data = b"".join(struct.pack(f"{order}3f", *p) for p in corners())
    return data + b"".join(struct.pack(f"{order}B4i", 4, *(k - 1 for k in q)) for q in QUADS)


def off(number="{:g}", head="OFF\n8 6 12", comment=""):
    rows = [" ".join(number.format(x) for x in p) for p in corners()]
    rows += ["4 " + " ".join(str(k - 1) for k in quad) + " 255 0 0" for quad in QUADS]
    return "\n".join([head + comment, *rows, ""])


def model(body, unit="millimeter"):
    space = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<model unit="{unit}" xmlns="{space}" '
        f'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06">{body}</model>'
    )


def mesh_object(number, points=None, faces=None, first_x=None):
    points = [[f"{x:g}" for x in p] for p in points or corners()]
    points[0][0] = first_x or points[0][0]
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in points)
    rows = "".join(
        '<triangle v1="{}" v2="{}" v3="{}"/>'.format(*(k - 1 for k in t))
        for t in faces or triangles()
    )
    return (
        f'<object id="{number}" type="model"><mesh><vertices>{vertices}</vertices>'
        f"<triangles>{rows}</triangles></mesh></object>"
    )


def package(name, models):
    with zipfile.ZipFile(HERE / name, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, text in models.items():
            entry = zipfile.ZipInfo(path, (2020, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, text)


def mesh_files():
    """Yield name, content and meaning of the text and binary mesh files."""
    plain, comma = "{:.6e}", lambda text: text.replace(".", ",")
    yield "stl_name_cp1252.stl", stl("Gehäuse").encode("cp1252"), BLOCK
    yield "stl_name_gbk.stl", stl("外壳").encode("gbk"), BLOCK
    yield "stl_name_vertex.stl", stl("vertex plate 3").encode(), BLOCK
    yield "stl_mark_utf8.stl", stl().encode("utf-8-sig"), BLOCK
    yield "stl_utf16.stl", stl().encode("utf-16"), BLOCK
    yield "stl_utf16_no_mark.stl", stl().encode("utf-16-le"), BLOCK
    yield "stl_end_solid.stl", stl(end="end solid").encode(), BLOCK
    yield "stl_cr.stl", stl().replace("\n", "\r").encode(), BLOCK
    yield "stl_upper.stl", stl().upper().encode(), BLOCK
    yield "stl_decimal_comma.stl", comma(stl(number="{:.4f}")).encode(), BLOCK
    yield "stl_nan_normals.stl", stl(facet="facet normal nan nan nan").encode(), BLOCK
    both = stl(number="{:.3f}").replace("vertex 60.000", "vertex 60,000", 1)
    yield "stl_comma_and_point.stl", both.encode(), {"refused": "comma.*line \\d+ a point"}
    nan = stl(number=plain).replace("vertex 6.000000e+01", "vertex nan", 1)
    yield "stl_nan_corner.stl", nan.encode(), {"refused": "line \\d+: nan is no finite number"}
    four = stl(number="{:g}").replace("vertex 60 0 0", "vertex 60 0 0 0", 1)
    yield "stl_four_coordinates.stl", four.encode(), {"refused": "other than three coordinates"}
    yield "stl_cut.stl", stl()[:-200].encode(), {"refused": "breaks off"}
    yield "stl_binary_solid.stl", binary_stl(b"solid Geh\xe4use"), BLOCK

    points = v(corners())
    yield "obj_relative.obj", obj(points, f(relative(QUADS, 8))).encode(), BLOCK
    wire = v(corners((10, 5, 5), (3, 3, 3)))
    data = obj(points, f(relative(QUADS, 8)), wire, ["l 9 10 11 12"])
    yield "obj_relative_then_line.obj", data.encode(), BLOCK
    void = v(corners((20, 20, 10), (20, 10, 5)))
    data = obj(points, f(relative(QUADS, 8)), void, f(relative(turned(QUADS), 8)))
    yield "obj_relative_hollow.obj", data.encode(), {"size_mm": SIZE, "volume_mm3": 44_000.0}
    data = obj(points, ["vt 0 0", "vt 1 1"], ["usemtl steel"], f(QUADS, "{}/1"))
    yield "obj_texture.obj", data.encode(), BLOCK
    data = obj(["mtllib none.mtl", "vn 0 0 1"], points, ["s off"], f(QUADS, "{}//1"))
    yield "obj_normals.obj", data.encode(), BLOCK
    data = obj(["o Gehäuse"], points, ["g Fläche"], f(QUADS)).encode("cp1252")
    yield "obj_names_cp1252.obj", data, BLOCK
    data = obj(["# by hand"], points, f(QUADS)).replace("\n", "\r").encode("utf-8-sig")
    yield "obj_mark_cr.obj", data, BLOCK
    yield "obj_decimal_comma.obj", comma(obj(v(corners(), "{:.3f}"), f(QUADS))).encode(), BLOCK
    data = obj(v(corners(), "{:.1f}")).replace(" ", ", ").replace("v,", "v") + obj(f(QUADS))
    yield "obj_comma_between.obj", data.encode(), {"refused": "kept apart by blanks"}
    continued = obj(points, [line.replace(" ", " \\\n", 1) for line in f(QUADS)])
    yield "obj_continued.obj", continued.encode(), BLOCK
    yield "obj_colours.obj", obj([p + " 0.5 0.5 0.5" for p in points], f(QUADS)).encode(), BLOCK
    outline = [(0, 0), (60, 0), (60, 10), (10, 10), (10, 40), (0, 40)]
    angle = v([(x, y, z) for z in (0, 20) for x, y in outline])
    sides = [(k, k % 6 + 1, k % 6 + 7, k + 6) for k in range(1, 7)]
    data = obj(angle, f([(6, 5, 4, 3, 2, 1), (7, 8, 9, 10, 11, 12), *sides]))
    yield "obj_concave.obj", data.encode(), {"size_mm": SIZE, "volume_mm3": 900 * 20.0}
    data = obj(points, f(relative(QUADS, 9)), v([(0, 0, 0)]))
    yield (
        "obj_relative_too_far.obj",
        data.encode(),
        {"refused": "line 9: .*'-9'; corners count from 1, or from -1 back to -8"},
    )
    yield "obj_index_0.obj", obj(points, ["f 0 1 2"]).encode(), {"refused": "line 9.*'0'"}

    yield (
        "ply_comment_cp1252.ply",
        (ply("ascii", comment="Maß") + ply_text()).encode("cp1252"),
        BLOCK,
    )
    data = ply("binary_little_endian", comment="Maß").encode("cp1252") + ply_binary("<")
    yield "ply_binary_cp1252.ply", data, BLOCK
    yield "ply_binary_big_cr.ply", ply("binary_big_endian", "\r").encode() + ply_binary(">"), BLOCK
    data = ply("binary_little_endian", "\r\n").encode("utf-8-sig") + ply_binary("<")
    yield "ply_binary_mark_crlf.ply", data, BLOCK
    yield "ply_decimal_comma.ply", (ply("ascii") + comma(ply_text("{:.2f}"))).encode(), BLOCK
    yield "ply_utf16.ply", (ply("ascii") + ply_text()).encode("utf-16"), BLOCK
    inf = (ply("ascii") + ply_text()).replace("60 0 0", "inf 0 0", 1)
    yield "ply_inf.ply", inf.encode(), {"refused": "inf is no finite number"}

    yield "off_mark_cr.off", off().replace("\n", "\r").encode("utf-8-sig"), BLOCK
    yield (
        "off_one_line_head.off",
        off(head="OFF 8 6 12", comment=" # Gehäuse").encode("cp1252"),
        BLOCK,
    )
    yield "off_decimal_comma.off", comma(off("{:.2f}")).encode(), BLOCK


class Step:
    """Records of a STEP file, numbered as they are added."""

    def __init__(self):
        self.lines = []

    def add(self, text):
        self.lines.append(f"#{len(self.lines) + 1}={text};")
        return f"#{len(self.lines)}"

    def vector(self, kind, numbers):
        return self.add(f"{kind}('',({','.join(f'{x:.6E}' for x in numbers)}))")

    def point(self, numbers):
        return self.vector("CARTESIAN_POINT", numbers)

    def frame(self, at, axis, ref):
        axis, ref = self.vector("DIRECTION", axis), self.vector("DIRECTION", ref)
        return self.add(f"AXIS2_PLACEMENT_3D('',{self.point(at)},{axis},{ref})")

    def solid(self, points, name=""):
        """Add a block's solid: six planes, twelve edges, eight corners."""
        corner = [self.add(f"VERTEX_POINT('',{self.point(p)})") for p in points]
        edges = {}
        for quad in QUADS:
            for a, b in zip(quad, quad[1:] + quad[:1]):
                if (b, a) not in edges:
                    way = [v - u for u, v in zip(points[a - 1], points[b - 1])]
                    length = sum(x * x for x in way) ** 0.5
                    along = self.vector("DIRECTION", [x / length for x in way])
                    vector = self.add(f"VECTOR('',{along},{length:.6E})")
                    line = self.add(f"LINE('',{self.point(points[a - 1])},{vector})")
                    ends = f"{corner[a - 1]},{corner[b - 1]}"
                    edges[a, b] = self.add(f"EDGE_CURVE('',{ends},{line},.T.)")
        faces = []
        for quad in QUADS:
            used = []
            for a, b in zip(quad, quad[1:] + quad[:1]):
                edge, sense = (edges[a, b], "T") if (a, b) in edges else (edges[b, a], "F")
                used.append(self.add(f"ORIENTED_EDGE('',*,*,{edge},.{sense}.)"))
            loop = self.add(f"EDGE_LOOP('',({','.join(used)}))")
            bound = self.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
            o, u, w = (points[k - 1] for k in (quad[0], quad[1], quad[3]))
            u, w = ([y - x for x, y in zip(o, p)] for p in (u, w))
            n = (u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0])
            plane = self.add(f"PLANE('',{self.frame(o, n, u)})")
            faces.append(self.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
        shell = self.add(f"CLOSED_SHELL('',({','.join(faces)}))")
        return self.add(f"MANIFOLD_SOLID_BREP('{name}',{shell})")

    def text(self, *products, header="by hand"):
        """Return the file of products, each a name and its solids."""
        app = self.add("APPLICATION_CONTEXT('automotive design')")
        whose = self.add(f"PRODUCT_CONTEXT('',{app},'mechanical')")
        what = self.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{app},'design')")
        mm = self.add("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))")
        rad = self.add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))")
        sr = self.add("(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT())")
        sure = self.add(
            f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-6),{mm},'distance','accuracy')"
        )
        context = self.add(
            "(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT"
            f"(({sure})) GLOBAL_UNIT_ASSIGNED_CONTEXT(({mm},{rad},{sr})) "
            "REPRESENTATION_CONTEXT('',''))"
        )
        for name, solids in products:
            product = self.add(f"PRODUCT('{name}','{name}','',({whose}))")
            formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
            definition = self.add(f"PRODUCT_DEFINITION('design','',{formation},{what})")
            of = self.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
            origin = self.frame((0, 0, 0), (0, 0, 1), (1, 0, 0))
            items = ",".join([origin, *solids])
            shape = self.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({items}),{context})")
            self.add(f"SHAPE_DEFINITION_REPRESENTATION({of},{shape})")
        head = (
            f"ISO-10303-21;\nHEADER;\n/* that's {header} */\nFILE_DESCRIPTION((''),'2;1');\n"
            "FILE_NAME('part','2020-01-01T00:00:00',(''),(''),'','','');\n"
            "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n"
        )
        return "\n".join(
            [head + self.lines[0], *self.lines[1:], "ENDSEC;", "END-ISO-10303-21;", ""]
        )


def step_files():
    """Yield name, content and meaning of STEP files; a body is named where one is meant."""

    def one(**header):
        file = Step()
        return file.text(("block", [file.solid(corners())]), **header)

    def two(first, second):
        file = Step()
        angle = file.solid(corners((10.0, 40.0, 30.0), (0.0, 0.0, 20.0)))
        return file.text((first, [file.solid(corners())]), (second, [angle]))

    def both(at, name="block"):
        file = Step()
        solids = [file.solid(corners()), file.solid(corners((10.0, 40.0, 30.0), at))]
        return file.text((name, solids))

    angle = {"size_mm": (60.0, 40.0, 50.0), "volume_mm3": 60_000.0}
    names = two("Gehäuse", "Bügel").encode("cp1252")
    block = BLOCK | {"body": "Gehäuse", "caution": "code page 1252"}
    yield "step_names_cp1252.step", names, block
    yield "step_names_gbk.step", two("外壳", "支架").encode("gbk"), {"refused": "code page 1252"}
    yield "step_names_utf8.step", two("Gehäuse", "Bügel").encode(), BLOCK | {"body": "Gehäuse"}
    yield "step_header_cp1252.step", one(header="für Händler").encode("cp1252"), BLOCK
    yield "step_mark_cr.step", one().replace("\n", "\r").encode("utf-8-sig"), BLOCK
    yield "step_utf16.step", one().encode("utf-16"), BLOCK
    comma = one().replace("6.000000E+01", "6,000000E+01")
    yield "step_decimal_comma.step", comma.encode(), {"refused": "decimals written with commas"}
    far = one().replace("(6.000000E+01,", "(6.000000E+307,", 1)
    yield "step_beyond.step", far.encode(), {"refused": "#\\d+, a CARTESIAN_POINT, holds 6.0*E.307"}
    yield "step_touching.step", both((0.0, 0.0, 20.0)).encode(), angle | {"body": "*"}
    deeper = both((0.0, 0.0, 10.0)).encode()
    meaning = {"size_mm": (60.0, 40.0, 40.0), "volume_mm3": 56_000.0, "body": "*"}
    yield "step_overlapping.step", deeper, meaning | {"caution": "into each other by 4e.03 mm3"}
    yield "step_touching_unnamed.step", both((0.0, 0.0, 20.0)).encode(), {"refused": "They touch"}
    apart = both((0.0, 0.0, 25.0)).encode()
    yield "step_apart.step", apart, {"body": "*", "refused": "2 are left"}


def packages():
    """Write 3MF packages; yield name and meaning."""
    item, main = '<build><item objectid="1"/></build>', "3D/3dmodel.model"
    resources = f"<resources>{mesh_object(1)}</resources>"
    package("3mf_plain.3mf", models={main: model(resources + item)})
    yield "3mf_plain.3mf", BLOCK
    mirror = '<build><item objectid="1" transform="-1 0 0 0 1 0 0 0 1 5 0 0"/></build>'
    package("3mf_mirrored.3mf", models={main: model(resources + mirror)})
    yield "3mf_mirrored.3mf", BLOCK
    nested = (
        '<resources><object id="2"><components><component p:path="/3D/other.model" objectid="1" '
        'transform="0 1 0 -1 0 0 0 0 1 0 0 0"/></components></object></resources>'
        '<build><item objectid="2"/></build>'
    )
    package(
        "3mf_component_elsewhere.3mf",
        models={main: model(nested), "3D/other.model": model(resources + "<build/>")},
    )
    yield "3mf_component_elsewhere.3mf", {"size_mm": (40.0, 60.0, 20.0), "volume_mm3": 48_000.0}
    wild = f"<resources>{mesh_object(1, first_x='1e999')}</resources>"
    package("3mf_not_finite.3mf", models={main: model(wild + item)})
    yield "3mf_not_finite.3mf", {"refused": "`x` of a vertex is '1e999'"}
    itself = (
        '<resources><object id="1"><components><component objectid="1"/></components></object>'
        "</resources>"
    )
    package("3mf_holds_itself.3mf", models={main: model(itself + item)})
    yield "3mf_holds_itself.3mf", {"refused": "holds itself"}


def main():
    """Write all files and the truth."""
    truth = {}
    for name, data, meaning in (*mesh_files(), *step_files()):
        (HERE / name).write_bytes(data)
        truth[name] = meaning
    truth.update(packages())
    text = json.dumps(truth, indent=1, sort_keys=True)
    (HERE / "truth.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
