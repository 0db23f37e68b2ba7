"""Who holds the part. Said aloud whenever the cell stops, and never guessed."""

from enum import StrEnum


class Custody(StrEnum):
    """Where the part is."""

    NONE = "no part known"
    ON_TABLE = "on the table"
    IN_ARM = "in the arm's hand"
    IN_BOTH = "in the arm's hand and in the fixture"
    IN_FIXTURE = "in the fixture"
    PLACED = "placed"
    LOST = "lost"
    UNKNOWN = "unknown"


def where_it_is(custody: Custody, detail: str = "") -> str:
    """Return a sentence for the operator: where the part is and what to do with it."""
    more = f" ({detail})" if detail else ""
    match custody:
        case Custody.NONE | Custody.ON_TABLE:
            return f"The part is on the table{more}; both grippers are empty."
        case Custody.IN_ARM:
            return (
                f"The part is in the arm's hand{more}, which keeps holding it. Support the part "
                "before you cut the power or open the jaws."
            )
        case Custody.IN_BOTH:
            return (
                f"The part is in both grippers{more}, which keep holding it. Open one of them "
                "only while the other holds."
            )
        case Custody.IN_FIXTURE:
            return f"The part is in the fixed gripper{more}, which keeps holding it."
        case Custody.PLACED:
            return f"The part is in its tray{more}."
        case Custody.LOST:
            return f"The part was lost{more}: look for it below the arm's last way, by hand."
        case Custody.UNKNOWN:
            return f"Where the part is, is not known{more}: look before anything moves."
