"""recipe.yaml: what to inspect and how strictly, in millimetres and degrees."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, AliasChoices, Field, model_validator

from .cad_files import EVERY, STEP_FORMATS, body_path, is_cad_file, split_cad
from .characteristics import CharacteristicSection, ToleranceClass
from .errors import ConfigError
from .faults import FaultsSection
from .file_kinds import is_cell_file
from .files import reason_of
from .grippers import Friction
from .serial_code import SerialCodeSection
from .shipped import EMULATED_CELL
from .yaml_models import Section, load_with_lines

DEFAULT_CELL = Path("cells/emulated.yaml")
MAX_NAMED = 12  # a message lists at most this many files of a folder

Unit = Literal["mm", "cm", "m", "inch"]


FaceName = Annotated[str, Field(min_length=1, max_length=80)]
Reason = Annotated[str, Field(min_length=4, max_length=200)]
DefectKind = Literal["chip", "burr", "dent", "scratch", "stain"]
DefectSize = Annotated[float, Field(gt=0, le=50)]


class InspectionSection(Section):
    """The strictness of the part's inspection.

    Attributes
    ----------
    max_incidence_deg : a surface that a view shows flatter than this does not count as seen there:
        angle between its normal and the line of sight
    min_coverage : share of what can be seen that must have been verified for a pass, above 0: by
        comparison, or on faces that edges verify
    not_inspected : faces that need not be inspected, by name as
        `cellctl compile` lists them, each with the reason
    tolerance_class : tolerance class of ISO 2768-1, for all that has no limits of its own
    required : characteristics that a PASS needs verified: all, or only those with limits stated in
        the recipe or in the CAD file; the others are measured where a view shows them, and still
        fail the part when beyond their limits
    smallest_defect_mm : smallest defect to look for, of kinds that `find` does not name
    find : size by kind of defect that must be found for a PASS, in mm; for kinds not named the
        report states the size that would have been found
    least_gain : share of the surface that a view of usual length must add to be taken; what takes
        longer, as a regrasp, must add so much more; 0 shows all that can be
    calibration : calibration of the cell that a PASS needs: `any`, also that of the drawing;
        `current`, none of its calibrations stale; `verified`, and its verification passed with them
    characteristics : limits of single characteristics, distances between further planes, and what
        is not measured
    stop_at_fail : a part that has failed by two looks is put down at once; what else is wrong with
        it stays unknown, and the report says so
    learned : file of what good parts look like, as `cellctl learn` writes it, relative to the
        recipe; it decides on surfaces in the views that it knows
    """

    max_incidence_deg: float = Field(70.0, ge=20, le=85)
    min_coverage: float = Field(0.95, gt=0, le=1)
    not_inspected: dict[FaceName, Reason] = Field(default_factory=dict)
    tolerance_class: ToleranceClass = "m"
    required: Literal["all", "stated"] = "all"
    calibration: Literal["any", "current", "verified"] = "any"
    characteristics: Annotated[tuple[CharacteristicSection, ...], Field(max_length=500)] = ()
    smallest_defect_mm: float = Field(3.0, ge=0.5, le=50)
    find: dict[DefectKind, DefectSize] = Field(default_factory=dict)
    learned: Path | None = None
    stop_at_fail: bool = False
    # a hundredth of the surface for 73 s: what less would show costs 120 s and more (ADR 120)
    least_gain: float = Field(0.0005, ge=0, le=0.1)


class GraspSection(Section):
    """The limits on grasps of the part.

    Attributes
    ----------
    force_n : force of the grippers on it; plans count on no more than the cell's grippers have
    friction : friction of the cell's pads against this part; None for what the cell file says of
        its pads
    width_tolerance_mm : jaws that stop further off than this hold something else
    """

    force_n: float = Field(60.0, ge=20, le=200)
    friction: Friction | None = None
    width_tolerance_mm: float = Field(2.0, ge=0.2, le=10)


PaperNumber = Annotated[str, Field(max_length=80)]


class PapersSection(Section):
    """Identification of the part on its papers; reports print the values given.

    Attributes
    ----------
    part_number : number of the part in the customer's system
    drawing_number, revision : number and revision of the drawing that states the tolerances
    order_number : number of the order that the parts are made for; `--order` names another
    gauge_id : id of the cell in the list of gauges
    """

    part_number: PaperNumber = ""
    drawing_number: PaperNumber = ""
    revision: PaperNumber = ""
    order_number: PaperNumber = ""
    gauge_id: PaperNumber = ""


def _fit_for_a_folder(name: str) -> str:
    """Return a name; raise ValueError if a folder's name cannot contain it."""
    if not name.strip() or len(name) > 80 or any(c in "/\\" or not c.isprintable() for c in name):
        raise ValueError("must be 1 to 80 characters without slashes: a folder is named after it")
    return name


class Recipe(Section):
    """One product.

    Attributes
    ----------
    name : name of the product, for people
    part : CAD file, relative to the recipe; ``file.step#NAME`` is one body of a file of several,
        ``file.step#*`` all of them united
    unite : whether the bodies of the part's STEP file are united, as by ``#*``
    others : CAD files of other parts that may turn up on the table, named as `part`
    unit : unit of CAD files that name none, such as STL; a file that names its unit keeps it
    density_g_cm3 : density of the material, for the part's weight (default: the CAD file's, else
        2.7, aluminium)
    cell : cell file, relative to the recipe (default: that file beside the recipe, else the
        emulated cell that comes with cellctl)
    grasp : grasp requirements; JSON keeps the old name
    faults : overrides of the cell's fault policy, class by class
    papers : numbers that reports name the part by
    count : parts to inspect, where the command line names no number
    serial_code : code that has the part's serial number; the cell's cameras read it
    """

    name: Annotated[str, AfterValidator(_fit_for_a_folder)]
    part: Path
    unite: bool = False
    others: tuple[Path, ...] = ()
    unit: Unit | None = None
    density_g_cm3: float | None = Field(None, gt=0, le=25)
    cell: Path = DEFAULT_CELL
    inspection: InspectionSection = InspectionSection()
    grasp: GraspSection = Field(
        GraspSection(),
        validation_alias=AliasChoices("grasp", "grip"),
        serialization_alias="grip",
    )
    faults: FaultsSection | None = None
    papers: PapersSection | None = None
    count: Annotated[int, Field(ge=1, le=100_000)] = 1
    serial_code: SerialCodeSection | None = None

    @model_validator(mode="before")
    @classmethod
    def _is_no_cell_file(cls, tree: Any) -> Any:  # noqa: ANN401 - pydantic's signature
        if is_cell_file(tree):
            raise ValueError("is a cell file, not a recipe; name it with --cell")
        return tree


def load_recipe(path: Path, draft: str | None = None) -> Recipe:
    """Return a recipe, with its file names relative to the working directory.

    Part, other parts and cell file must lie in the recipe's folder or below, with symbolic links
    resolved. So a recipe that came by mail cannot read any other file. The person at the machine
    names a cell file elsewhere with ``--cell``.

    Parameters
    ----------
    path : the file
    draft : a text that may become the file's; None for what the file holds

    Raises
    ------
    ConfigError : the file is wrong, a file it names lies outside its folder, or a CAD file is not
        there
    """
    loaded = load_with_lines(path, Recipe, draft)
    recipe, line_of = loaded.value, loaded.line_of

    def inside(name: Path, *location: int | str) -> Path:
        line = line_of(location)
        where = f"{path}:{line}" if line is not None else f"{path}"
        return _inside(path, name, where, location)

    part = inside(recipe.part, "part")
    if recipe.unite:
        part = _united(part, f"{path}:{line_of(('unite',))}")
    others = tuple(inside(other, "others", i) for i, other in enumerate(recipe.others))
    inspection = recipe.inspection
    if inspection.learned is not None:
        learned = inside(inspection.learned, "inspection", "learned")
        if not _is_file(learned):
            line = line_of(("inspection", "learned"))
            raise ConfigError(
                f"{path}:{line}: `inspection.learned`: no file {learned}; `cellctl learn` writes it"
            )
        inspection = inspection.model_copy(update={"learned": learned})
    cell = inside(recipe.cell, "cell")
    if "cell" not in recipe.model_fields_set and not _is_file(cell):
        cell = EMULATED_CELL
    named = [(part, line_of(("part",)))]
    named += [(other, line_of(("others", i))) for i, other in enumerate(others)]
    for cad, line in named:
        if not _is_file(split_cad(cad).file):
            raise ConfigError(_unknown_part(path, cad, line))
    return recipe.model_copy(
        update={"part": part, "others": others, "cell": cell, "inspection": inspection}
    )


def _united(part: Path, where: str) -> Path:
    """Return the name of a part of all its file's bodies; ConfigError unless a STEP file."""
    source = split_cad(part)
    if source.ending not in STEP_FORMATS or source.body not in (None, EVERY):
        raise ConfigError(
            f"{where}: `unite`: is for a STEP file of several bodies, not for {source.name}; "
            "leave it out"
        )
    return body_path(source.file, EVERY)


def _inside(recipe: Path, name: Path, where: str, location: tuple[int | str, ...]) -> Path:
    """Return a file that a recipe names; raise ConfigError if it is outside its folder."""
    file, key = recipe.parent / name, ".".join(one for one in location if isinstance(one, str))
    try:
        is_inside = split_cad(file).file.resolve().is_relative_to(recipe.parent.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # not a file name, or links in a circle
        raise ConfigError(f"{where}: `{key}`: {reason_of(error)} ({str(name)!r:.80})") from error
    if not is_inside:
        mend = "name the cell with --cell" if key == "cell" else "copy the file there"
        raise ConfigError(f"{where}: `{key}`: {name} is outside the recipe's folder; {mend}")
    return file


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        return False


def _unknown_part(recipe: Path, cad: Path, line: int | None) -> str:
    cad = split_cad(cad).file
    folder = cad.parent
    try:
        known = sorted(p.name for p in folder.glob("*") if is_cad_file(p))
    except OSError:
        known = []
    shown = ", ".join(known[:MAX_NAMED]) + (" ..." if len(known) > MAX_NAMED else "")
    have = f"the folder has {shown}" if known else f"there is no CAD file in {folder}"
    return f"{recipe}:{line}: unknown part: no file {cad}; {have}"
