"""The proof of a plan, and the certificates of stable poses, in words."""

from collections.abc import Iterator, Sequence
from contextlib import suppress

from rich.box import SIMPLE
from rich.table import Table

from controller.cad import StablePose
from controller.cell.plans import Certified, PlanCache
from controller.planning import Certificate, NoPlanError, Plan
from controller.results.moments import view_count
from controller.setup.planner import PlannerSetup

from ..terminal.output import stdout
from ..terminal.progress import PartProgress


def proof_words(plan: Plan) -> str:
    """Return the proven gap to the optimum, and the set of plans it is proven for."""
    proof = plan.proof
    if proof.cost_s <= 0:
        return "not proven: no exact search was made"
    if proof.is_optimal:
        return f"proven optimal in {proof.scope}"
    return f"within {proof.gap:.1%} of the optimum in {proof.scope}"


def covered_words(plan: Plan) -> str:
    """Return the share of the surface that a plan shows, with its uncertainty."""
    return f"{plan.covered_fraction:.1%} (± {plan.covered_U:.1%})"


def counted(count: int, what: str) -> str:
    """Return a count with its noun: 1 view, 2 views."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def certificate_words(certificate: Certificate, setup: PlannerSetup) -> str:
    """Return a certificate in words; for an assumed density, with the density up to which it holds.

    Parameters
    ----------
    certificate : certificate of a stable pose
    setup : setup it was made with
    """
    plan = certificate.plan
    if certificate.same_as >= 0:
        return f"as from pose {certificate.same_as}, which a symmetry of the part makes the same"
    if plan is None:
        return certificate.reason
    shown = plan.covered_fraction / plan.reachable_fraction if plan.reachable_fraction else 1.0
    views, regrasps = counted(view_count(plan), "view"), counted(plan.regrasp_count, "regrasp")
    held = ""
    if setup.density_from == "assumed":
        held = f"; held up to {setup.heaviest_g_cm3(plan):.1f} g/cm3, the density is assumed"
    return f"{views}, {regrasps}, {plan.forecast_s:.0f} s, {shown:.1%} of what can be shown{held}"


def certified_each(
    planning: PlanCache, poses: Sequence[StablePose], progress: PartProgress
) -> Iterator[Certified]:
    """Yield the certificate of each stable pose, in order, each as soon as it is made.

    Parameters
    ----------
    planning : plans of the part in the cell
    poses : stable poses
    progress : printer of progress
    """
    if not planning.is_prepared:
        progress.begin("grasps and views for the cell")
        with suppress(NoPlanError):  # the certificates have the reason
            planning.prepared()
    for number, pose in enumerate(poses, 1):
        progress.begin(f"certificate of stable pose {pose.index}, {number} of {len(poses)}")
        yield planning.certified(pose)


def print_certificates(certificates: Sequence[Certificate], setup: PlannerSetup) -> None:
    """Print certificates as a table; print nothing if there are none.

    Parameters
    ----------
    certificates : certificates to print
    setup : setup they were made with
    """
    if not certificates:
        return
    table = Table(box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("from pose", justify="right", no_wrap=True)
    table.add_column("likely\n%", justify="right", no_wrap=True)
    table.add_column("pickable\n%", justify="right", no_wrap=True)
    table.add_column("result", min_width=30)
    for c in certificates:
        table.add_row(
            str(c.pose_index),
            f"{100 * c.probability:.1f}",
            f"{100 * c.pickable:.0f}",
            certificate_words(c, setup),
        )
    stdout.print(table)
