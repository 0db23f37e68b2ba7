"""Whether recipes can be run on the cell as calibrated: `cellctl check`'s own answer, in short."""

from dataclasses import dataclass
from pathlib import Path

from controller.cad import CadError
from controller.cell.compute import Job
from controller.cell.compute.checks import check_job
from controller.config import ConfigError


@dataclass(frozen=True, slots=True)
class ReachedPose:
    """A likely stable pose of a recipe's part.

    Attributes
    ----------
    index, probability : index and probability of the stable pose
    pickable : share of places and turns of the drop area from which the part can be taken
    covered : share of its surface that comes in sight; None if there is no plan
    """

    index: int
    probability: float
    pickable: float
    covered: float | None


@dataclass(frozen=True, slots=True)
class RecipeReach:
    """The result of a check of a recipe.

    Attributes
    ----------
    poses : likely stable poses
    problems : a sentence for each reason why it cannot be run
    """

    poses: tuple[ReachedPose, ...]
    problems: tuple[str, ...]


def check_reach(recipe: Path, cell: Path) -> RecipeReach:
    """Return the reach of a recipe in a cell: the plans of its part's likely stable poses.

    An error in the files is a problem as well.

    Parameters
    ----------
    recipe, cell : their files
    """
    try:
        checked = check_job(Job(recipe, cell))
    except (ConfigError, CadError) as error:
        return RecipeReach((), (str(error),))
    return RecipeReach(
        tuple(
            ReachedPose(
                one.pose.index,
                one.pose.probability,
                one.certified.certificate.pickable,
                None if (plan := one.certified.certificate.plan) is None else plan.covered_fraction,
            )
            for one in checked.poses
        ),
        checked.problems,
    )
