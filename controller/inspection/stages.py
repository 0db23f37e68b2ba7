"""Stages of an inspection, from the pictures of a view to evidence, in order.

    PicturedView --outlined_view--> OutlinedView --grasp_pose--> ViewPose
    --compared_view--> ComparedView --view_polish, view_result--> ViewResult
    --posed_view--> PosedView --dimension_looks, edge_looks--> evidence

Each is worked out once for its arguments (`kept.py`), whether in advance or for the verdict (ADR
81). What a stage does stands in `view.py`, `grasp_pose/`, `dimensions/` and `edge_evidence/`.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from controller.cad import SurfaceSamples

from ._part_types import PartSettings, ViewOff, ViewSet
from ._pose import PosedPart
from ._types import OUTLINE, ViewResult
from .characteristics import Characteristic
from .dimensions import (
    BACKLIT,
    DimensionLooks,
    MeasuringSettings,
    PosedView,
    look_for,
    seek_all,
)
from .edge_evidence import EdgeLook, PartEdges, closest_pixel_mm, find_edges, look_at_edges
from .grasp_pose import (
    GraspPose,
    OutlinedView,
    PoseSettings,
    Rival,
    ViewPose,
    find_rival,
    fit_grasp,
    is_suspect,
    settle_turn,
)
from .integrity import Allowances, allowed_mm
from .kept import Kept, stage, stage_of
from .lit import Finish, Polish, finish_of
from .view import NotEvaluated, Strictness, compare_view, outline_view

outlined_view = stage_of(outline_view)
turned_views = stage_of(settle_turn)  # of all grasps in which its turn is one guess
grasp_pose = stage_of(fit_grasp)  # of all views of the grasp that have an outline
compared_view = stage_of(compare_view)  # large, and forgotten once there is a result
dimensions_sought = stage_of(seek_all)
dimension_looks = stage_of(look_for)
part_edges = stage_of(find_edges)


@stage
def view_polish(
    kept: Kept,
    part: PosedPart,
    samples: SurfaceSamples,
    outlined: OutlinedView | NotEvaluated,
    pose: ViewPose | None,
    strictness: Strictness,
) -> tuple[Polish, ...]:
    """Return what a view's pictures tell about how polished the finish is.

    Parameters
    ----------
    kept : cache
    part, samples, outlined, pose, strictness : see `compare_view`
    """
    compared = compared_view(kept, part, samples, outlined, pose, strictness)
    return () if isinstance(compared, NotEvaluated) else compared.lit.polish


@stage
def view_result(
    kept: Kept,
    part: PosedPart,
    samples: SurfaceSamples,
    outlined: OutlinedView | NotEvaluated,
    pose: ViewPose | None,
    strictness: Strictness,
    finish: Finish,
) -> ViewResult:
    """Return a view's result by what is known of the finish.

    Parameters
    ----------
    kept : cache
    part, samples, outlined, pose, strictness : see `compare_view`
    finish : what the pictures so far tell of it
    """
    compared = compared_view(kept, part, samples, outlined, pose, strictness)
    kept.forget(compared_view, part, samples, outlined, pose, strictness)
    if isinstance(compared, NotEvaluated):
        return compared.result(samples)
    return compared.judged(finish)


@stage
def posed_view(
    kept: Kept, outlined: OutlinedView, pose: ViewPose, passed: tuple[str, ...] | None
) -> PosedView:
    """Return a view at the part's pose, with the pictures that passed, or with all.

    Parameters
    ----------
    kept : cache
    outlined : the view
    pose : measured pose
    passed : lamps whose pictures passed their self-checks; None for all
    """
    view = outlined.view
    return PosedView(
        view.task,
        view.pictures,
        pose.T_world_part_measured,
        pose.covariance,
        view.grasp,
        outlined.scene,
        passed,
        view.counted,
    )


@stage
def edge_looks(
    kept: Kept,
    part: PosedPart,
    edges: PartEdges,
    view: PosedView,
    allowances: Allowances,
    settings: MeasuringSettings,
) -> list[EdgeLook]:
    """Return the looks at a part's edges in a view's pictures.

    Parameters
    ----------
    kept : cache
    part, edges, view : see `look_at_edges`
    allowances : allowed deviations of a good part
    settings : prior uncertainties
    """
    allowed = allowed_mm(part, allowances.tolerance_class)
    return look_at_edges(part, edges, view, allowed, settings)


@dataclass(frozen=True, eq=False, slots=True)
class PosedViews:
    """Poses of the part in all views.

    Attributes
    ----------
    outlined : each view with its outline, or why it has none, in the order taken
    fits : pose of each grasp of which an outline shows; None where none was found
    """

    outlined: tuple[OutlinedView | NotEvaluated, ...]
    fits: Mapping[int, GraspPose | None]

    def pose(self, view_id: str) -> ViewPose | None:
        """Return the part's pose in a view, None where it was not found."""
        found = (fit.view(view_id) for fit in self.fits.values() if fit is not None)
        return next((pose for pose in found if pose is not None), None)

    @property
    def off(self) -> tuple[ViewOff, ...]:
        """Disagreement of arm and camera, view by view."""
        return tuple(
            ViewOff(view.view_id, grasp, view.deviation_mm, view.deviation_rad)
            for grasp, fit in sorted(self.fits.items())
            if fit is not None
            for view in fit.views
            if not view.is_hidden
        )

    def rival(self, part: PosedPart, settings: PoseSettings) -> Rival | None:
        """Return the rival that the outlines show in place of the part, else None."""
        fits = list(self.fits.values())
        if not fits or not is_suspect(fits):
            return None
        return find_rival(part, list(by_grasp(self.outlined).values()), fits, settings)

    def known(
        self, kept: Kept, results: Sequence[ViewResult] | None = None
    ) -> tuple[PosedView, ...]:
        """Return the views in which the pose was found.

        Parameters
        ----------
        kept : cache
        results : of all views, to leave out those and the pictures that failed their self-checks;
            None to leave out none
        """
        passed: list[tuple[str, ...] | None] = [None] * len(self.outlined)
        if results is not None:
            passed = [passed_lamps(result) for result in results]
        posed = []
        for one, lamps in zip(self.outlined, passed, strict=True):
            pose = self.pose(one.view.task.view_id)
            if pose is None or lamps == () or not isinstance(one, OutlinedView):
                continue
            if not one.task.facts.is_turn_open:
                posed.append(posed_view(kept, one, pose, lamps))
        return tuple(posed)


def passed_lamps(result: ViewResult) -> tuple[str, ...]:
    """Return the lamps whose pictures passed their self-checks, `BACKLIT` first; empty for none."""
    if not result.evaluated:
        return ()
    lit = (c for c in result.checks if c.name != OUTLINE and not c.reason and not c.is_dark)
    return (BACKLIT, *(check.name for check in lit))


def by_grasp(
    views: Sequence[OutlinedView | NotEvaluated],
) -> Mapping[int, tuple[OutlinedView, ...]]:
    """Return the views that have an outline, by the number of their grasp."""
    grasps: dict[int, tuple[OutlinedView, ...]] = {}
    for one in views:
        if isinstance(one, OutlinedView):
            grasps[one.view.grasp] = (*grasps.get(one.view.grasp, ()), one)
    return grasps


def pose_views(views: ViewSet, settings: PoseSettings, kept: Kept | None = None) -> PosedViews:
    """Return the poses of the part in all its views, one fit for each grasp.

    Parameters
    ----------
    views : with their pictures
    settings : what is known of arm, parts and light
    kept : what of it was worked out before; None for nothing
    """
    kept = kept or Kept()
    outlined = tuple(outlined_view(kept, view) for view in views.views)
    grasps = by_grasp(outlined)
    settled: dict[str, OutlinedView] = {}
    for one_guess, is_last in _by_guess(grasps.values()):
        for mine in turned_views(kept, views.part, one_guess, settings, is_last):
            settled |= {view.task.view_id: view for view in mine}
    turned = tuple(settled.get(one.view.task.view_id, one) for one in outlined)
    fits = {
        grasp: grasp_pose(kept, views.part, mine, settings)
        for grasp, mine in by_grasp(turned).items()
    }
    return PosedViews(turned, fits)


def _by_guess(
    grasps: Iterable[tuple[OutlinedView, ...]],
) -> Iterator[tuple[tuple[tuple[OutlinedView, ...], ...], bool]]:
    """Yield the grasps in which the part's turn is the same guess, and whether it is the last."""
    turns = [(mine[0].task.facts.free_turn, mine) for mine in grasps]
    last = max((free.guess_number for free, _ in turns if free is not None), default=0)
    guesses: dict[tuple[object, ...], tuple[tuple[OutlinedView, ...], ...]] = {}
    for free, mine in turns:
        if free is not None:
            same = free.guess_number, free.is_shown, free.axis.tobytes(), free.through_mm.tobytes()
            guesses[same] = (*guesses.get(same, ()), mine)
    yield from ((mine, same[0] == last) for same, mine in guesses.items())


def compare_views(
    views: ViewSet, posed: PosedViews, settings: PartSettings, kept: Kept, view_count: int
) -> Iterator[ViewResult | None]:
    """Yield each view's result on the samples that it counts for, and None while at work.

    Results come grasp by grasp. How polished a finish is, pictures tell together: those of a grasp
    and of the grasps before it, which do not change as more follow.

    Parameters
    ----------
    views : with their pictures
    posed : where the part is in them
    settings : how strictly
    kept : what of it was worked out before
    view_count : how many views there will be
    """
    strictness = Strictness(settings.allowances, settings.pose, view_count, settings.appearance)
    polish: list[Polish] = []
    for grasp in dict.fromkeys(view.grasp for view in views.views):
        mine = [
            (views.part, views.samples, one, posed.pose(one.view.task.view_id), strictness)
            for one in posed.outlined
            if one.view.grasp == grasp
        ]
        for asked in mine:
            polish += view_polish(kept, *asked)
            yield None
        finish = finish_of(polish)
        for asked in mine:
            result, counted = view_result(kept, *asked, finish), asked[2].view.counted
            yield result if counted is None else result.within(counted)


def looks_at_dimensions(
    part: PosedPart,
    characteristics: tuple[Characteristic, ...],
    views: Sequence[PosedView],
    settings: MeasuringSettings,
    kept: Kept,
) -> Iterator[list[DimensionLooks]]:
    """Yield each view's estimates of all characteristics that a picture may show.

    Parameters
    ----------
    part : the CAD model
    characteristics : characteristics to measure
    views : in which the pose is known
    settings : prior uncertainties
    kept : cache
    """
    sought = dimensions_sought(kept, part, characteristics)
    for view in views:
        yield dimension_looks(kept, part, sought, view, settings)


def looks_at_edges(
    part: PosedPart, views: Sequence[PosedView], settings: PartSettings, kept: Kept
) -> Iterator[list[EdgeLook]]:
    """Yield each view's looks at the part's edges, at the density of the closest view.

    Parameters
    ----------
    part : the CAD model
    views : with the pictures that passed their self-checks
    settings : how strictly
    kept : cache
    """
    edges = edges_seen(part, views, kept)
    for view in views if edges is not None else ():
        assert edges is not None
        yield edge_looks(kept, part, edges, view, settings.allowances, settings.measuring)


def edges_seen(part: PosedPart, views: Sequence[PosedView], kept: Kept) -> PartEdges | None:
    """Return the part's edges at the density of the closest view; None without edges or views.

    Parameters
    ----------
    part : the CAD model
    views : with the pictures that passed their self-checks
    kept : cache
    """
    return part_edges(kept, part.solid, closest_pixel_mm(views)) if views else None
