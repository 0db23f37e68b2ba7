"""STEP files: the solid, its exact surfaces, its tolerances, and what becomes of damaged files."""

from __future__ import annotations

import importlib.util
import random
import re
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from step_files import needs_kernel, write_all

from controller.cad import CadError, EmptyCadError, ManySolidsCadError, OpenCadError, load_solid
from controller.cad.boundary import Curve, Face
from controller.cad.errors import UnreadableCadError
from controller.cad.reading.step.files import StepPart, list_bodies, read_step_part
from controller.cad.reading.step.kernel import KernelLimits, KernelRun
from controller.cad.reading.step.part21 import Part21, Part21Error
from controller.cad.surfaces.features import find_features
from controller.cad.surfaces.tolerances import Datum, Dimension, GeometricTolerance

PI = np.pi
# a diameter of 12 mm, -0.254 / +0.508, a position of 0.127 at maximum material to A, in inches, and
# a distance by limits; {shape}, {frame} and the faces are numbers of the plate's own records
TOLERANCES = """
#9001=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#9002=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#9001);
#9003=(CONVERSION_BASED_UNIT('INCH',#9002)LENGTH_UNIT()NAMED_UNIT(#9004));
#9004=DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);
#9010=SHAPE_ASPECT('bore','',{shape},.T.);
#9011=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#9010,{brep},{bore});
#9012=DIMENSIONAL_SIZE(#9010,'diameter');
#9013=(LENGTH_MEASURE_WITH_UNIT()MEASURE_REPRESENTATION_ITEM()
MEASURE_WITH_UNIT(LENGTH_MEASURE(0.4724409448818898),#9003)
REPRESENTATION_ITEM('nominal value'));
#9014=SHAPE_DIMENSION_REPRESENTATION('',(#9013),{frame});
#9015=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#9012,#9014);
#9016=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(-0.01),#9003);
#9017=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.02),#9003);
#9018=TOLERANCE_VALUE(#9016,#9017);
#9019=PLUS_MINUS_TOLERANCE(#9018,#9012);
#9020=DATUM_FEATURE('a','',{shape},.T.);
#9021=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#9020,{brep},{top});
#9022=DATUM('','',{shape},.F.,'A');
#9023=SHAPE_ASPECT_RELATIONSHIP('','',#9020,#9022);
#9030=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.005),#9003);
#9031=DATUM_REFERENCE_COMPARTMENT('','',{shape},.F.,#9022,$);
#9032=DATUM_SYSTEM('','',{shape},.F.,(#9031));
#9033=(GEOMETRIC_TOLERANCE('p','',#9030,#9010)
GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE((#9032))
GEOMETRIC_TOLERANCE_WITH_MODIFIERS((.MAXIMUM_MATERIAL_REQUIREMENT.))
POSITION_TOLERANCE());
"""


def _with_tolerances(step: str) -> str:
    """Return a plate's text with tolerances written in by hand."""
    part = Part21(step)

    def number_of(keyword: str) -> str:
        reference, _ = next(iter(part.all_of(keyword)))
        return f"#{reference.number}"

    faces = {}
    for reference, record in part.all_of("ADVANCED_FACE"):
        surface = part.record(record["ADVANCED_FACE"][2])
        if "CYLINDRICAL_SURFACE" in surface:
            faces["bore"] = f"#{reference.number}"
        elif "PLANE" in surface:
            place = part.record(surface["PLANE"][1])["AXIS2_PLACEMENT_3D"]
            at = part.record(place[1])["CARTESIAN_POINT"][1]
            normal = part.record(place[2])["DIRECTION"][1]
            if abs(normal[2]) == 1 and at[2] == 10:
                faces["top"] = f"#{reference.number}"
    frame = next(
        f"#{reference.number}"
        for reference, record in part.all_of("GEOMETRIC_REPRESENTATION_CONTEXT")
        if record["GEOMETRIC_REPRESENTATION_CONTEXT"] == [3.0]
    )
    records = TOLERANCES.format(
        shape=number_of("PRODUCT_DEFINITION_SHAPE"),
        brep=number_of("ADVANCED_BREP_SHAPE_REPRESENTATION"),
        frame=frame,
        **faces,
    )
    head, data, tail = step.rpartition("ENDSEC;")
    return head + records.strip() + "\n" + data + tail


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_all(tmp_path_factory.mktemp("step"))


@pytest.fixture(scope="module")
def plate(files: dict[str, Path]) -> StepPart:
    """The plate with a bore, and with tolerances."""
    path = files["plate"].with_name("toleranced.step")
    path.write_text(_with_tolerances(files["plate"].read_text()))
    return read_step_part(path)


def _by_kind(part: StepPart, kind: str) -> list[Face]:
    return [face for face in part.solid.faces if face.kind == kind]


@needs_kernel
def test_volume_area_centroid_and_inertia_are_exact(plate: StepPart) -> None:
    bore = PI * 36 * 10
    volume = 60 * 40 * 10 - bore
    centroid = (np.array([30.0, 20, 5]) * 24000 - np.array([20.0, 15, 5]) * bore) / volume
    # about the origin: a box a b c with its corner there has a b c (b^2 + c^2) / 3 about x
    about_z = 24000 * (60**2 + 40**2) / 3 - bore * (36 / 2 + 20**2 + 15**2)
    about_z -= volume * (centroid[0] ** 2 + centroid[1] ** 2)
    assert plate.solid.volume_mm3 == pytest.approx(volume, rel=1e-9)
    assert plate.solid.centroid_mm == pytest.approx(centroid, abs=1e-9)
    assert plate.inertia_mm5[2, 2] == pytest.approx(about_z, rel=1e-9)
    surface = 2 * (60 * 40 + 60 * 10 + 40 * 10) - 2 * PI * 36 + 2 * PI * 6 * 10
    assert plate.area_mm2 == pytest.approx(surface, rel=1e-9)


@needs_kernel
def test_each_step_face_is_one_face_largest_first(plate: StepPart) -> None:
    faces = plate.solid.faces
    assert len(faces) == 7
    assert sorted(plate.step_face) == list(range(7))
    areas = [face.area_mm2 for face in faces]
    expected = [2400 - PI * 36] * 2 + [600] * 2 + [400] * 2 + [2 * PI * 60]
    assert areas == pytest.approx(sorted(expected, reverse=True), rel=1e-9)
    assert [face.id for face in faces] == list(range(7))
    mesh_areas = np.bincount(plate.solid.face_of_triangle, weights=plate.solid.mesh.area_faces)
    assert mesh_areas == pytest.approx(areas, rel=0.01)


@needs_kernel
def test_a_bore_keeps_its_axis_and_radius(plate: StepPart) -> None:
    (bore,) = _by_kind(plate, "cylinder")
    assert bore.radius_mm == pytest.approx(6, abs=1e-12)
    assert bore.centre_mm == pytest.approx([20, 15, 5], abs=1e-9)
    assert abs(bore.axis) == pytest.approx([0, 0, 1], abs=1e-12)
    assert bore.concave
    assert bore.normal == pytest.approx(np.zeros(3))


@needs_kernel
def test_edges_keep_their_curves_and_both_faces(plate: StepPart) -> None:
    edges = plate.edges
    circle = edges.curve == Curve.CIRCLE
    assert circle.sum() == 2
    assert (edges.curve == Curve.LINE).sum() == 12 + 1  # and the seam of the bore
    assert edges.radius_mm[circle] == pytest.approx([6, 6])
    (bore,) = _by_kind(plate, "cylinder")
    assert (edges.faces[circle] == bore.id).any(axis=1).all()
    assert (edges.faces[:, 0] == edges.faces[:, 1]).sum() == 1
    for edge in np.flatnonzero(circle):
        run = edges.chain[edges.chain_start[edge] : edges.chain_start[edge + 1]]
        radii = np.linalg.norm((edges.vertices_mm[run] - edges.centre_mm[edge])[:, :2], axis=1)
        assert radii == pytest.approx(6, abs=1e-9)


@needs_kernel
def test_a_dimension_in_inches_has_signed_deviations_in_mm(plate: StepPart) -> None:
    (size,) = [t for t in plate.tolerances if isinstance(t, Dimension)]
    (bore,) = _by_kind(plate, "cylinder")
    assert size.kind == "size_diameter"
    assert size.nominal == pytest.approx(12.0, abs=1e-9)
    assert (size.lower, size.upper) == pytest.approx((-0.254, 0.508), abs=1e-12)
    assert size.faces == (bore.id,)


@needs_kernel
def test_a_position_knows_its_width_datum_and_material(plate: StepPart) -> None:
    (position,) = [t for t in plate.tolerances if isinstance(t, GeometricTolerance)]
    assert position.kind == "position"
    assert position.value_mm == pytest.approx(0.127, abs=1e-12)
    assert position.datums == ("A",)
    assert position.at_maximum_material


@needs_kernel
def test_a_datum_knows_its_surface(plate: StepPart) -> None:
    (datum,) = [t for t in plate.tolerances if isinstance(t, Datum)]
    assert datum.letter == "A"
    (face,) = datum.faces
    assert plate.solid.faces[face].normal == pytest.approx([0, 0, 1])
    assert plate.solid.faces[face].centre_mm[2] == pytest.approx(10)


@needs_kernel
def test_two_bodies_are_refused(files: dict[str, Path]) -> None:
    with pytest.raises(ManySolidsCadError, match="2 bodies of one shape; a part is one"):
        load_solid(files["two boxes"])


@needs_kernel
@pytest.mark.slow
def test_an_open_shell_is_refused(files: dict[str, Path]) -> None:
    with pytest.raises(OpenCadError, match="5 surfaces"):
        load_solid(files["open box"])


@needs_kernel
@pytest.mark.slow
def test_inches_are_the_same_part(files: dict[str, Path]) -> None:
    inches, mm = read_step_part(files["plate in inches"]), read_step_part(files["plate"])
    assert inches.solid.unit == "inch"
    assert mm.solid.unit == "mm"
    assert mm.tolerances == ()
    assert inches.solid.volume_mm3 == pytest.approx(mm.solid.volume_mm3, rel=1e-9)
    assert inches.solid.centroid_mm == pytest.approx(mm.solid.centroid_mm, abs=1e-6)


@needs_kernel
@pytest.mark.slow
def test_cones_balls_and_rings_are_known(files: dict[str, Path]) -> None:
    part = read_step_part(files["round things"])
    (cone,), (ball,), (ring,) = (_by_kind(part, kind) for kind in ("cone", "sphere", "torus"))
    assert cone.half_angle_rad == pytest.approx(np.arctan2(6, 12), abs=1e-9)
    assert cone.axis == pytest.approx([0, 0, -1], abs=1e-9)  # the way it widens
    assert cone.radius_mm == pytest.approx(10 - cone.centre_mm[2] / 2, abs=1e-9)
    assert not cone.concave
    assert ball.centre_mm == pytest.approx([0, 0, 15], abs=1e-9)
    assert ball.radius_mm == pytest.approx(6)
    assert not ball.concave
    assert (ring.radius_mm, ring.minor_radius_mm) == pytest.approx((6, 1))
    assert ring.centre_mm == pytest.approx([0, 0, 0], abs=1e-9)
    assert ring.concave


@needs_kernel
@pytest.mark.slow
def test_a_cone_whose_apex_is_a_disc_of_no_size_is_mended_and_says_so(
    files: dict[str, Path],
) -> None:
    part = read_step_part(files["needle"])
    assert sorted(face.kind for face in part.solid.faces) == ["cone", "plane"]
    assert part.solid.volume_mm3 == pytest.approx(np.pi * 8**2 * 12 / 3, rel=1e-6)
    (cone,) = _by_kind(part, "cone")
    assert cone.half_angle_rad == pytest.approx(np.arctan2(8, 12), abs=1e-6)
    (stated,) = part.warnings
    assert "mended" in stated


@needs_kernel
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plate cut up", "plate of splines"])
def test_a_bore_in_several_faces_is_one_surface(files: dict[str, Path], kind: str) -> None:
    text = files[kind].read_text()
    assert text.count("ADVANCED_FACE(") > 7
    part = read_step_part(files[kind])
    assert len(part.solid.faces) == 7
    (bore,) = _by_kind(part, "cylinder")
    assert bore.concave
    assert bore.radius_mm == pytest.approx(6, abs=1e-4)
    assert bore.area_mm2 == pytest.approx(2 * PI * 60, rel=1e-3)  # the kernel sums over splines
    assert bore.centre_mm == pytest.approx([20, 15, 5], abs=1e-3)
    (hole,) = [f for f in find_features(part.solid) if f.kind == "hole"]
    assert (hole.is_through, hole.depth_mm) == (True, pytest.approx(10, abs=1e-6))
    places = sorted(part.step_face.tolist())
    assert places[0] == 0
    assert len(set(places)) == 7


@needs_kernel
@pytest.mark.slow
def test_faces_that_meet_in_an_edge_stay_apart(files: dict[str, Path]) -> None:
    part = read_step_part(files["round things"])
    kinds = [face.kind for face in part.solid.faces]
    assert sorted(kinds) == ["cone", "plane", "plane", "sphere", "torus"]


@needs_kernel
@pytest.mark.slow
def test_tolerances_are_those_of_the_body_that_is_named(files: dict[str, Path]) -> None:
    """The plate is a body of two: its tolerances go with it, and the other one has none."""
    both = files["two boxes"].with_name("plate and boxes.step")
    alone = files["plate"].with_name("plate alone.step")
    alone.write_text(_with_tolerances(files["plate"].read_text()))
    whole = read_step_part(alone)
    both.write_text(_beside(alone, files["two boxes"]))
    plate, *others = list_bodies(both).distinct
    part = read_step_part(both, body=plate.name)
    assert part.tolerances == whole.tolerances
    assert len(part.tolerances) == 3
    assert [read_step_part(both, body=other.name).tolerances for other in others] == [()]


def test_a_solid_is_known_by_how_many_faces_it_has_or_not_at_all(files: dict[str, Path]) -> None:
    text = _beside(files["plate"], files["two boxes"])  # of 7, 6 and 6 faces
    part = Part21(text)
    assert len(part.faces_of_solid(7)) == 7
    assert len(part.faces_of_solid(19)) == 19  # the whole file's
    assert part.faces_of_solid(6) == []
    assert part.faces_of_solid(5) == []


def _beside(one: Path, other: Path) -> str:
    """Return the text of two files as one, the second's records behind the first's."""
    texts = [path.read_text() for path in (one, other)]
    shifted = re.sub(r"#(\d+)", lambda n: f"#{int(n[1]) + 100_000}", texts[1])
    records = shifted.split("DATA;", 1)[1].rpartition("ENDSEC;")[0]
    head, end, tail = texts[0].rpartition("ENDSEC;")
    return head + records + end + tail


def test_tolerances_of_a_bore_in_several_faces_name_its_one_face(files: dict[str, Path]) -> None:
    path = files["plate cut up"].with_name("cut up and toleranced.step")
    path.write_text(_with_tolerances(files["plate cut up"].read_text()))
    part = read_step_part(path)
    (bore,) = _by_kind(part, "cylinder")
    (size,) = [t for t in part.tolerances if isinstance(t, Dimension)]
    assert size.faces == (bore.id,)
    (datum,) = [t for t in part.tolerances if isinstance(t, Datum)]
    (named,) = datum.faces
    assert part.solid.faces[named].normal == pytest.approx([0, 0, 1], abs=1e-9)


@needs_kernel
@pytest.mark.slow
@pytest.mark.parametrize(
    ("written", "meant"),
    [
        (("0.02", "-0.01"), (-0.254, 0.508)),  # the upper one first
        (("-0.01", "-0.02"), (-0.508, -0.254)),
        (("0.03", "0.02"), (0.508, 0.762)),
        (("0.01", "0.01"), (-0.254, 0.254)),  # the same amount twice: both ways
    ],
)
def test_deviations_are_read_in_any_order_and_sign(
    files: dict[str, Path], tmp_path: Path, written: tuple[str, str], meant: tuple[float, float]
) -> None:
    text = _with_tolerances(files["plate"].read_text())
    lower, upper = (f"LENGTH_MEASURE({value})" for value in written)
    text = text.replace("LENGTH_MEASURE(-0.01)", "LOWER").replace("LENGTH_MEASURE(0.02)", upper)
    path = tmp_path / "part.step"
    path.write_text(text.replace("LOWER", lower))
    part = read_step_part(path)
    (size,) = [t for t in part.tolerances if isinstance(t, Dimension)]
    assert (size.lower, size.upper) == pytest.approx(meant)
    assert size.nominal == pytest.approx(12.0)


def test_an_empty_file_is_told(tmp_path: Path) -> None:
    path = tmp_path / "part.step"
    path.write_bytes(b" \n")
    with pytest.raises(EmptyCadError):
        load_solid(path)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"a poem, not a part", "ISO-10303-21"),
        (b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n#1=CARTESIAN_POINT('',(0.,", "breaks off"),
    ],
)
def test_text_that_is_no_whole_step_file_is_told(tmp_path: Path, data: bytes, why: str) -> None:
    path = tmp_path / "part.step"
    path.write_bytes(data)
    with pytest.raises(UnreadableCadError, match=why):
        load_solid(path)


def test_a_missing_kernel_is_told_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "part.step"
    path.write_bytes(b"ISO-10303-21;\nEND-ISO-10303-21;\n")
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(UnreadableCadError, match=r"cellctl\[step\]"):
        read_step_part(path)


@pytest.mark.parametrize(
    ("script", "why"),
    [
        ("import os; os.abort()", "crashed on it .SIGABRT"),
        ("import sys; sys.exit(9)", "exit code 9"),
        ("import time; time.sleep(6000)", "did not finish"),
        (
            "import resource, sys\n"
            "resource.setrlimit(resource.RLIMIT_CPU, (1, 2))\n"
            "while True: pass",
            "did not finish",
        ),
    ],
)
def test_a_kernel_that_dies_or_hangs_is_a_typed_error(
    tmp_path: Path, script: str, why: str
) -> None:
    child, source = tmp_path / "child.py", tmp_path / "part.step"
    child.write_text(script)
    source.write_text("whatever")
    begin = time.monotonic()
    limits = KernelLimits(time_s=0.25)
    with (
        KernelRun(child, source, tmp_path / "out.npz", (), limits) as run,
        pytest.raises(UnreadableCadError, match=why),
    ):
        run.result("part.step")
    assert time.monotonic() - begin < 600


def test_the_environment_grants_a_slow_file_more_time(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = KernelLimits.granted()
    assert usual == KernelLimits()
    # what a file of 3.7 MB took, 11 s, and half of that again
    assert usual.time_for_s(3_700_000) > 1.5 * 11.0
    monkeypatch.setenv("CELLCTL_STEP_CPU_S", "200")
    assert KernelLimits.granted().time_for_s(1000) == 200.0
    for wrong in ("soon", "0", "-5", "nan", "inf"):
        monkeypatch.setenv("CELLCTL_STEP_CPU_S", wrong)
        with pytest.raises(UnreadableCadError, match="no number of seconds"):
            KernelLimits.granted()


def test_a_kernel_that_others_keep_from_running_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    child, source = tmp_path / "child.py", tmp_path / "part.step"
    child.write_text("import sys, time; time.sleep(1); sys.exit(9)")
    source.write_text("whatever")
    monkeypatch.setattr("controller.cad.reading.step.kernel.kept_waiting_s", lambda pid: 600.0)
    limits = KernelLimits(time_s=0.01)
    with (
        KernelRun(child, source, tmp_path / "out.npz", (), limits) as run,
        pytest.raises(UnreadableCadError, match="exit code 9"),
    ):
        run.result("part.step")


@needs_kernel
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_a_damaged_file_gives_a_typed_error_or_the_part(
    files: dict[str, Path], tmp_path: Path, seed: int
) -> None:
    rng = random.Random(seed)
    data = bytearray(files["plate"].read_bytes())
    begin = data.index(b"DATA;")
    for _ in range(rng.choice([1, 5, 50])):
        data[rng.randrange(begin, len(data) - 40)] ^= 1 << rng.randrange(8)
    path = tmp_path / "part.step"
    path.write_bytes(data)
    start = time.monotonic()
    try:
        solid = load_solid(path)
    except CadError:
        pass
    else:
        assert solid.mesh.volume == pytest.approx(solid.volume_mm3, rel=0.02)
    assert time.monotonic() - start < 600  # the machine may be busy; of computing it is 5 s


def test_a_dimension_by_limits_in_degrees_is_in_rad() -> None:
    text = """#1=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
    #2=PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(0.017453292519943),#1);
    #3=(CONVERSION_BASED_UNIT('DEGREE; ''deg''',#2)NAMED_UNIT(#9)PLANE_ANGLE_UNIT());
    #4=MEASURE_REPRESENTATION_ITEM('upper limit',PLANE_ANGLE_MEASURE(61.),#3);
    #5=MEASURE_REPRESENTATION_ITEM('lower limit',PLANE_ANGLE_MEASURE(59.),#3);
    #6=SHAPE_DIMENSION_REPRESENTATION('',(#4,#5),#8);
    #7=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#10,#6);"""
    (angle,) = Part21(text).dimensions()
    assert angle.is_angle
    assert angle.limits == pytest.approx(np.radians([59, 61]), abs=1e-9)
    assert angle.nominal is None


@given(cut=st.integers(0, len(TOLERANCES)), flip=st.integers(0, len(TOLERANCES) - 1))
def test_damaged_text_of_tolerances_raises_nothing_unforeseen(cut: int, flip: int) -> None:
    text = TOLERANCES.format(shape="#1", brep="#2", frame="#3", bore="#4", top="#5")
    text = text[:flip] + chr(ord(text[flip % len(text)]) ^ 1) + text[flip + 1 :]
    part = Part21(text[:cut])
    for ask in (part.dimensions, part.datum_surfaces, partial(part.faces_of_solid, 7)):
        try:
            ask()
        except (Part21Error, IndexError, KeyError, TypeError, ValueError):
            continue  # what the reader of tolerances foresees
