"""Search for the parts of a cluster under lamps: poses proposed, fitted, weighed one by one.

Stretches of outlines and edges propose parts as if they lay flat on the table. A part that
lies on another leans: one side of it on the table, the other on its neighbour. Such poses are
fitted with any tilt, from those that lie flat.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest

import cv2
import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.imaging import Camera, transform

from ...fitting import (
    FINE_REACH_MM,
    EdgeFit,
    EdgeModel,
    FitOptions,
    Prior,
    at_rest_in,
    coarse_fit,
    fit_edges,
)
from ...library import (
    Candidate,
    is_same_turn,
    place_of,
    pose_on_table,
    turn_of,
)
from ...partial import Cluster, are_one_place, propose_partial
from ...segmentation import Region
from ..by_edges import by_edges, edges_on_table
from ..decide import CONVINCING, CONVINCING_PX
from ..hypotheses import (
    SAME_PLACE_MM,
    SAME_TURN_RAD,
    Hypothesis,
    hypothesis_of,
    is_tried,
)
from ..lone import FAR_FRONT, silhouette_of
from ..scene import TableScene
from ..scores import FRONT, log_odds, probability
from ..touching import within
from .fits import LitCluster, LitFit, are_in_one_place

MARGIN_PX = 40  # margin of the crop round a cluster, whose shaded sides are often left out of it
MAX_BY_OUTLINE, MAX_BY_STRETCHES = 20, 160
PER_PLACE = 3  # turns of a gear in one place, before those of others are tried
SWEPT_MM = 5.0  # offset of a piece's ends that a sweep of its edges covers
MAX_LIKE = 8  # similar parts tried for one that is named
ALIKE = 0.85  # overlap of silhouettes from which two parts are similar
GIVE_UP = 30  # failed candidates of one piece in a row after which others of its kind are not tried
MAX_FINE = 40
COARSE_SHARE, GOOD_SHARE = 0.45, 0.6  # of a candidate's edges that are about where they should be
MIN_PROBABILITY = 0.05  # own probability from which a pose is weighed against others
NEAR_MM = 2.0  # how far off a candidate is sought at first
LEANS_FAR_MM = (6.0, 3.0)  # the same for one that leans, round by round
IN_REGION = 0.35  # share of a part's shadow on the piece that was cut out
LEANS = Prior((np.inf, np.inf, 6.0), (0.15, 0.15, np.inf))  # priors of each round of a fit
# prior of a part whose lowest point is on the table
ON_TABLE = Prior((np.inf, np.inf, 0.3), (0.1, 0.1, np.inf))
TIPPED_RAD = np.radians((6.0, 12.0, 18.0))  # tilts towards its support at which such a fit begins
LEANING_STEPS = 4  # steps of a fit: as a part tilts, another point of it becomes the lowest
SETTLED_MM = 0.15  # height above the table below which the lowest point is on it
MIN_TILT_RAD, MAX_TILT_RAD = np.radians(2.5), np.radians(30.0)
MAX_LOW_MM = 1.0  # largest height of a leaning part's lowest point above the table
TILTED = 0.3  # own probability of a flat pose from which it is also tried tilted
MAX_LEANING = 30
SAME_SHADOW = 0.5  # overlap of two shadows from which two fits are of one thing


class ClusterSearch:
    """Search for the parts of one cluster.

    Parameters
    ----------
    region : region cut out, one object or several near each other
    scene : its pictures under lamps, and the parts that may be there
    """

    def __init__(self, region: Region, scene: TableScene) -> None:
        pictures = scene.pictures
        self.region = widened(region, MARGIN_PX, pictures[0].shape)
        self.cluster = LitCluster(pictures, self.region.box_px, self.region.mask, scene.camera)
        self._about = np.any((self.region.mask, *self.region.alternatives), axis=0)
        self._scene, self._library, self._limits = scene, scene.library, scene.search
        self._alone: dict[LitFit, float] = {}
        self._named: dict[LitFit, float] = {}
        self._tilted: set[LitFit] = set()
        self._weighed: dict[tuple[LitFit, frozenset[LitFit], int], Hypothesis] = {}

    def proposed(self, pieces: Sequence[Region], *, is_first: bool) -> list[Candidate]:
        """Return the candidates for pieces of the cluster, those of one kind in order.

        Parameters
        ----------
        pieces : pieces in which parts are sought
        is_first : edges are asked once; afterwards pieces may be whole parts
        """
        stretches = self._in_turn([self._by_stretches(piece) for piece in pieces])
        stretches = stretches[:MAX_BY_STRETCHES]
        if is_first:
            return [*stretches, *self._in_turn(self._by_edges(self._apart(pieces)))]
        return [c for piece in pieces for c in self._by_silhouette(piece)] + stretches

    def _in_turn(self, by_piece: Sequence[Sequence[Candidate]]) -> list[Candidate]:
        """Return each once: the best of each piece before the second best of any."""
        found: list[Candidate] = []
        for row in zip_longest(*by_piece):
            for piece, c in enumerate(row):
                if c is not None and not is_tried(c, found, self._library):
                    found.append(replace(c, piece=piece))
        return found

    def _apart(self, pieces: Sequence[Region]) -> list[Region]:
        """Return pieces without those that are about where another one is, as edges have it."""
        kept: list[Region] = []
        near_px = SWEPT_MM / float(np.sqrt(self._scene.pixel_mm2))
        for piece in pieces:
            off = [np.abs(np.subtract(piece.box_px, other.box_px)).max() for other in kept]
            if min(off, default=np.inf) > near_px:
                kept.append(piece)
        return kept

    def _by_edges(self, pieces: Sequence[Region]) -> list[list[Candidate]]:
        """Return the candidates for each piece by the edges of the whole cluster."""
        corner_px = self.cluster.box_px[:2]
        edges = edges_on_table(self.cluster.crops, corner_px, self._scene.camera)
        return [by_edges(edges, corner_px, within(p, self.region), self._scene) for p in pieces]

    def _by_stretches(self, piece: Region) -> list[Candidate]:
        outline = Cluster(piece, self.cluster.camera, self._scene.usable)
        if len(outline.points_px) == 0:
            return []
        is_open = np.ones(len(outline.points_px), dtype=np.bool_)
        return propose_partial(outline, self._library, is_open, MAX_BY_STRETCHES, PER_PLACE, None)

    def _by_silhouette(self, piece: Region) -> list[Candidate]:
        silhouette = silhouette_of(piece.loops_px, self._scene)
        if silhouette is None:
            return []
        return self._library.index.search(silhouette, far=FAR_FRONT)[:MAX_BY_OUTLINE]

    def like(self, piece: Region) -> list[Candidate]:
        """Return the candidates with about the outline of a piece, the most similar first.

        Parameters
        ----------
        piece : with the outline of a whole part
        """
        found = self._by_silhouette(piece)
        return [c for c in found if c.overlap > ALIKE][:MAX_LIKE]

    def with_flat(self, fits: Sequence[LitFit], proposed: Sequence[Candidate]) -> list[LitFit]:
        """Return fits with those of parts that lie flat on the table, each place once.

        Parameters
        ----------
        fits : found so far
        proposed : further proposals
        """
        coarse = sorted(self._coarse_ones(proposed), key=lambda one: -one[0])
        out = list(fits)
        tried: list[tuple[Candidate, FloatArray]] = []
        for _, c, T in coarse:
            if any(self._is_one(c, T, *other) for other in tried):
                continue
            if len(tried) == MAX_FINE:
                break
            tried.append((c, T))
            fit = self._fine(c, T)
            if fit is None or not self._is_likely(fit):
                continue
            flat = (o for o in out if not o.leans)
            same = next((o for o in flat if self._is_one(c, fit.T, o.candidate, o.T)), None)
            if same is None:
                out.append(fit)
            elif self.alone(fit) > self.alone(same):  # from another start, a fit may come nearer
                out[out.index(same)] = fit
        return out

    def fitted(self, known: Sequence[Hypothesis]) -> list[LitFit]:
        """Return parts named before a light table, fitted under lamps with the same probability.

        Parameters
        ----------
        known : flat on the table, and not to be tried tilted; something may lie on them
        """
        found = []
        for h in known:
            x_mm, y_mm = h.place_mm
            c = Candidate(h.part, h.pose, h.theta_rad, float(x_mm), float(y_mm), h.overlap, 0.0)
            fit = self._fine(c, h.fit.T_world_part)
            if fit is not None:
                self._alone[fit] = self._named[fit] = h.probability
                self._tilted.add(fit)
                found.append(fit)
        return found

    def with_leaning(
        self, fits: Sequence[LitFit], proposed: Sequence[Candidate], there: Sequence[LitFit]
    ) -> list[LitFit]:
        """Return fits with those of parts that may lean on others.

        Parameters
        ----------
        fits : found so far; those that lie flat are tried tilted, once
        proposed : further proposals, for a part that lies flat
        there : possible objects there
        """
        starts: list[tuple[Candidate, FloatArray | None, list[LitFit]]] = []
        for flat in sorted(fits, key=lambda f: -self.worth(f)):
            if flat.leans or flat in self._tilted or not self._may_lean(flat):
                continue
            self._tilted.add(flat)
            others = [f for f in there if not are_one_place(f, flat, SAME_SHADOW)]
            starts.append((flat.candidate, flat.T, others))
        starts += [(c, None, list(there)) for c in proposed[:MAX_LEANING]]
        out = list(fits)
        for c, T, others in starts:
            fit = self._leaning(c, T, others)
            if fit is None or not self._is_likely(fit):
                continue
            leaning = (o for o in out if o.leans)
            if any(self._is_one(c, fit.T, o.candidate, o.T) for o in leaning):
                continue
            if not any(are_in_one_place(fit, other) for other in others):
                out.append(fit)
        return out

    def alone(self, fit: LitFit) -> float:
        """Return the probability that a fit is right, with nothing known beside it."""
        if fit not in self._alone:
            self._alone[fit] = probability(fit.evidence_alone, FRONT)
        return self._alone[fit]

    def _may_lean(self, flat: LitFit) -> bool:
        """Return True if a part that fits as if it lay flat may lean all the same."""
        if self.alone(flat) > CONVINCING:
            return flat.evidence_alone.misfit_px >= CONVINCING_PX
        return self.alone(flat) >= TILTED

    def worth(self, fit: LitFit) -> float:
        """Return the number of the cluster's edge pixels a fit explains, times its probability."""
        return float(fit.explains.sum()) * self.cluster.image_edges.every * self.alone(fit)

    def hypothesis(self, fit: LitFit, others: Sequence[LitFit], area: BoolArray) -> Hypothesis:
        """Return a fit as a hypothesis, with the evidence of the picture.

        Parameters
        ----------
        fit : a pose
        others : the other parts that are there
        area : (h, w) area of the crop, by which it is compared with other poses about one place
        """
        # what lies elsewhere changes nothing, and of most places the neighbours stay what they are
        others = [other for other in others if fit.is_near(other, area)]
        key = fit, frozenset(others), hash(area.tobytes())
        if key in self._weighed:
            return self._weighed[key]
        evidence = fit.evidence(others) if others else fit.evidence_alone
        own = max(probability(evidence, FRONT), self._named.get(fit, 0.0))
        lead = log_odds(fit.evidence(others, area), is_lit=True)
        self._weighed[key] = hypothesis_of(
            fit.candidate, fit.fit, self._library, evidence, own, lead, "cluster"
        )
        return self._weighed[key]

    def _coarse_ones(
        self, proposed: Sequence[Candidate]
    ) -> Iterator[tuple[float, Candidate, FloatArray]]:
        """Yield score, candidate and pose of rough fits, until others of their kind fail."""
        failed: dict[tuple[str, int], int] = {}
        for c in proposed:
            source = c.source, c.piece
            if failed.get(source, 0) == GIVE_UP:
                continue
            fit = self._coarse(c)
            score = 0.0 if fit is None else fit.score
            failed[source] = 0 if score >= GOOD_SHARE else failed.get(source, 0) + 1
            if fit is not None and score >= COARSE_SHARE:
                yield score, c, fit.T_world_part

    def _coarse(self, c: Candidate) -> EdgeFit | None:
        limits, cluster = self._limits, self.cluster
        reaches_mm = NEAR_MM, limits.first_reach_mm + 0.5 * c.slack_mm
        reaches_px = [self._reach_px(c, mm) for mm in reaches_mm]
        model, most = self._library.model(c.part), limits.coarse_samples
        T, sure = self._flat(c), limits.sure_coarse
        return coarse_fit(model, T, cluster.camera, cluster.grey, reaches_px, most, sure)

    def _fine(self, c: Candidate, T: FloatArray, leaning: Prior | None = None) -> LitFit | None:
        model, pose = self._library.model(c.part), self._library.entries[c.part].pose(c.pose)
        options = FitOptions(
            reach_px=tuple(self._reach_px(c, mm) for mm in FINE_REACH_MM),
            steps=3,
            prior=leaning or at_rest_in(pose, is_lit=True),
            most=self._limits.fine_samples,
        )
        fit = fit_edges(model, T, self.cluster.camera, self.cluster.grey, options)
        if fit is None:
            return None
        return LitFit(c, model, fit, self.cluster, leans=leaning is not None)

    def _leaning(
        self, c: Candidate, T: FloatArray | None, there: Sequence[LitFit]
    ) -> LitFit | None:
        """Return a candidate fitted as leaning on another part, from a pose or from flat."""
        model = self._library.model(c.part)
        reach_px = tuple(self._reach_px(c, mm) for mm in LEANS_FAR_MM)
        options = FitOptions(reach_px, steps=4, prior=LEANS, most=self._limits.coarse_samples)
        found, best = None, COARSE_SHARE
        for start in self._leaning_starts(model, self._flat(c) if T is None else T, there):
            coarse = fit_edges(model, start, self.cluster.camera, self.cluster.grey, options)
            score = 0.0 if coarse is None else coarse.score
            if coarse is not None and score >= best:
                found, best = LitFit(c, model, coarse, self.cluster, leans=True), score
        if found is None:
            return None
        for _ in range(LEANING_STEPS):
            on_table = found.T.copy()
            on_table[2, 3] -= found.span_mm[0]
            lower = self._fine(c, on_table, replace(ON_TABLE, T_world_part=on_table))
            if lower is None:
                return None
            found = lower
            if abs(found.span_mm[0]) < SETTLED_MM:
                break
        R = self._library.entries[c.part].pose(c.pose).R
        tilt = float(np.arccos(np.clip((found.T[:3, :3] @ R.T)[2, 2], -1.0, 1.0)))
        is_leaning = MIN_TILT_RAD < tilt < MAX_TILT_RAD and abs(found.span_mm[0]) < MAX_LOW_MM
        return found if is_leaning else None

    def _leaning_starts(
        self, model: EdgeModel, flat: FloatArray, there: Sequence[LitFit]
    ) -> Iterator[FloatArray]:
        """Yield the starts of a leaning fit: flat, and tipped towards each part near it."""
        yield flat
        middle, reach_mm = _middle_and_reach(model, flat)
        for other in there:
            theirs, their_reach_mm = _middle_and_reach(other.model, other.T)
            towards = theirs[:2] - middle[:2]
            away_mm = float(np.linalg.norm(towards))
            if 0.0 < away_mm < reach_mm + their_reach_mm:
                for tilt_rad in TIPPED_RAD:
                    yield tipped(model, flat, towards / away_mm, tilt_rad, self.cluster.camera)

    def _flat(self, c: Candidate) -> FloatArray:
        pose = self._library.entries[c.part].pose(c.pose)
        return pose_on_table(self._library.model(c.part), pose, c.x_mm, c.y_mm, c.theta_rad)

    def _reach_px(self, c: Candidate, mm: float) -> float:
        return max(mm / self.cluster.mm_per_px(c.x_mm, c.y_mm), 3.0)

    def _is_likely(self, fit: LitFit) -> bool:
        shadow = fit.shadow
        is_in = (shadow & self._about).sum() >= IN_REGION * max(int(shadow.sum()), 1)
        return bool(is_in) and self.alone(fit) >= MIN_PROBABILITY

    def _is_one(self, a: Candidate, T_a: FloatArray, b: Candidate, T_b: FloatArray) -> bool:
        """Return True if two posed candidates are one part, in one stable pose, in one place."""
        if (a.part, a.pose) != (b.part, b.pose):
            return False
        entry = self._library.entries[a.part]
        if np.linalg.norm(place_of(entry, T_a) - place_of(entry, T_b)) > SAME_PLACE_MM:
            return False
        R = entry.pose(a.pose).R
        turns = entry.turns_of(a.pose)
        return is_same_turn(turn_of(R, T_a), turn_of(R, T_b), turns, SAME_TURN_RAD)


def _middle_and_reach(model: EdgeModel, T: FloatArray) -> tuple[FloatArray, float]:
    """Return the middle (3,) of a posed part, and its reach on the table."""
    points = transform(T, model.start_mm)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle, float(np.linalg.norm((points - middle)[:, :2], axis=1).max())


def tipped(
    model: EdgeModel, T: FloatArray, towards: FloatArray, tilt_rad: float, camera: Camera
) -> FloatArray:
    """Return a pose (4, 4) tipped up on one side, its lowest point on the table.

    The middle of the part stays where the camera sees it.

    Parameters
    ----------
    model : model of the part
    T : T_world_part before
    towards : (2,) unit direction on the table, of the side that is lifted
    tilt_rad : angle by which the part is turned
    camera : overhead
    """
    before, _ = _middle_and_reach(model, T)
    axis = tilt_rad * np.array([towards[1], -towards[0], 0.0])
    out = np.eye(4)
    out[:3, :3] = cv2.Rodrigues(axis)[0] @ T[:3, :3]
    out[2, 3] = -float(transform(out, model.start_mm)[:, 2].min())
    after, _ = _middle_and_reach(model, out)
    eye = camera.position_mm
    nearer = (eye[2] - after[2]) / (eye[2] - before[2])
    out[:2, 3] += eye[:2] + nearer * (before[:2] - eye[:2]) - after[:2]
    return out


def widened(region: Region, margin_px: int, shape: tuple[int, int]) -> Region:
    """Return a region with a wider box.

    Parameters
    ----------
    region : region of a picture
    margin_px : added on each side, within the picture
    shape : (height, width) shape of the picture
    """
    x0, y0, x1, y1 = region.box_px
    left, top = max(x0 - margin_px, 0), max(y0 - margin_px, 0)
    right, bottom = min(x1 + margin_px, shape[1]), min(y1 + margin_px, shape[0])
    masks = np.zeros((1 + len(region.alternatives), bottom - top, right - left), dtype=np.bool_)
    masks[:, y0 - top : y1 - top, x0 - left : x1 - left] = (region.mask, *region.alternatives)
    box_px = (left, top, right, bottom)
    return replace(region, box_px=box_px, mask=masks[0], alternatives=tuple(masks[1:]))
