"""Keeps the known facts on the batch, and reports them to the journal and the operator.

*Once* actions (grasp, release, hand-off, sort) are on the disk before their bytes leave, and are
never repeated before the jaws have been checked (cell-facts.md 2).
"""

from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager

from controller.arrays import FloatArray
from controller.cell.alarms import alarm_of
from controller.cell.custody import Around, Custody, TrayRecord
from controller.cell.journal import Body, Journal, rows
from controller.cell.machine import Act, Budgets, Recovery
from controller.planning import Grasp
from messages import key, say

from .holds import arm_hold_row, fixed_hold_row, matrix
from .part import PartInGripper, PartRecord
from .product import BatchProduct
from .progress import RunProgress

UNLIMITED = 1_000_000


class BatchRecord:
    """The current part, the parts done, and the journal and operator that hear of both.

    Parameters
    ----------
    journal : journal of the run
    progress, on_progress : state shown to the operator; called after each change of it
    trays : contents of the trays; None without counting
    products : products of the batch, in the order given; none where no part is worked on
    """

    def __init__(
        self,
        journal: Journal,
        progress: RunProgress,
        on_progress: Callable[[], None],
        trays: TrayRecord | None = None,
        products: Sequence[BatchProduct] = (),
    ) -> None:
        self.trays = trays or TrayRecord()
        self.products = tuple(products)
        self._left = [product.count for product in products]
        self._without_limit = Budgets(demote_after=UNLIMITED, window=UNLIMITED)
        self._journal = journal
        self._progress = progress
        self._on_progress = on_progress
        self._finished: list[PartRecord] = []
        self._once_count = 0
        self.part = PartRecord(number=0)
        # what the cell holds for: its code, and the sentence for the operator
        self.problem: tuple[str, str] = ("", "")

    @property
    def progress(self) -> RunProgress:
        """The operator's view of the run."""
        return self._progress

    @property
    def finished(self) -> tuple[PartRecord, ...]:
        """The parts done, in order."""
        return tuple(self._finished)

    @property
    def parts(self) -> tuple[PartRecord, ...]:
        """All parts begun, the current one last."""
        is_begun = self.part.number > 0 and self.part not in self._finished
        return (*self._finished, *([self.part] if is_begun else []))

    @property
    def product(self) -> BatchProduct:
        """The product of the current part; the first one until it was recognised.

        Raises
        ------
        ValueError : no part is worked on in this run
        """
        if self.part.product is not None:
            return self.part.product
        if not self.products:
            raise ValueError("a run without a recipe has no part")
        return self.products[0]

    @property
    def wanted(self) -> tuple[BatchProduct, ...]:
        """The products with parts still to inspect."""
        return tuple(one for one in self.products if self._left[one.number] > 0)

    @property
    def wanted_next(self) -> tuple[BatchProduct, ...]:
        """The products with parts still to inspect once the current part is done."""
        at_hand = self.part.product
        return tuple(one for one in self.products if self._left[one.number] > (one is at_hand))

    @property
    def parts_left(self) -> int:
        """The number of parts still to inspect, with the current one."""
        return sum(max(left, 0) for left in self._left)

    @property
    def done(self) -> dict[str, tuple[int, int]]:
        """By recipe's name the number of parts done, and the number ordered."""
        return {
            one.recipe.name: (one.count - self._left[one.number], one.count)
            for one in self.products
        }

    @property
    def budgets(self) -> Budgets:
        """The batch's experience of grasps and views; without a product none is ever avoided."""
        return self.product.budgets if self.products else self._without_limit

    def begin_part(self) -> None:
        """Begin the next part if the last one is done; drop a plan made from earlier pictures."""
        part = self.part
        if part.number == 0 or part.tray is not None or part in self._finished:
            self.part = PartRecord(number=self.part.number + 1)
        self.part.plan, self.part.next_step = None, 0

    def finish_part(self) -> None:
        """Count the current part as done.

        A part taken out before it was recognised counts only if all parts are of one product.
        """
        self._finished.append(self.part)
        if self.part.product is not None or len(self.products) == 1:
            self._left[self.product.number] -= 1
        self._on_progress()

    def count_as_done(self, number: int) -> None:
        """Count a part of a product, by its number, that an earlier run has done."""
        self._left[number] -= 1

    def identify_part(self, product: BatchProduct, serial: str = "", lot: str = "") -> None:
        """Set the product of the current part, and journal it if that is new.

        Parameters
        ----------
        product : product it belongs to
        serial, lot : serial and lot of the part; empty if it has none
        """
        part = self.part
        if (part.product, part.serial, part.lot) == (product, serial, lot):
            return
        part.product, part.serial, part.lot = product, serial, lot
        self._note_identity(product)

    def note_code(
        self, product: BatchProduct, code: rows.CodeFields, label: tuple[str, str]
    ) -> None:
        """Journal the code that was read of the current part, with its serial number and lot.

        Parameters
        ----------
        product : product it belongs to
        code : what a camera read
        label : serial number and lot of the part from now on
        """
        self.part.code = code
        self.part.serial, self.part.lot = label
        self._note_identity(product)

    def _note_identity(self, product: BatchProduct) -> None:
        part = self.part
        more = {} if part.code is None else {"code": part.code}
        self.note(
            rows.PartIdentified(
                recipe=product.number,
                name=product.recipe.name,
                serial=part.serial,
                lot=part.lot,
                **more,
            )
        )

    @property
    def around(self) -> Around:
        """The other objects in the cell while the current part is worked on."""
        return Around(self.part.neighbours, self.trays.stored)

    def note_stored(self, tray: str, name: str, T_world_part: FloatArray) -> None:
        """Count and journal the current part in the next nest of a tray, if that has nests.

        Parameters
        ----------
        tray : the tray's name
        name : name of the part, as its recipe has it
        T_world_part : (4, 4) pose in which it was put there
        """
        nest = self.trays.next_nest(tray)
        if nest is None:
            return
        row = rows.PartStored(
            part=rows.StoredFields(
                tray=tray,
                nest=nest,
                part=name,
                T_world_part=matrix(T_world_part),
                run=self._journal.run,
                number=self.part.number,
            )
        )
        self.trays.take(row)
        self.note(row)

    async def empty_trays(self, names: Sequence[str]) -> None:
        """Count trays as empty, as a person states; on the disk when this returns."""
        for name in names:
            count = sum(one.tray == name for one in self.trays.stored)
            row = rows.TrayEmptied(tray=name, count=count)
            self.trays.take(row)
            await self.note_secured(row)

    def held(self) -> PartInGripper:
        """Return the arm gripper's hold of the part; the gripper must hold it."""
        hold = self.part.hold
        assert hold is not None, key("the arm gripper is empty")
        return hold

    def expect_hold(self, grasp: Grasp) -> None:
        """Journal the hold that the arm gripper is about to take."""
        self.part.hold_count += 1
        hold = PartInGripper(grasp, grasp.T_part_tcp, grasp.opening_mm, number=self.part.hold_count)
        self.note(arm_hold_row(hold, is_expected=True))

    def take_hold(self, grasp: Grasp, opening_mm: float) -> None:
        """Set the arm gripper's hold as planned, at the opening reached [mm]."""
        self.part.hold = PartInGripper(
            grasp, grasp.T_part_tcp, opening_mm, number=self.part.hold_count
        )
        self.note_hold()

    def note_hold(self) -> None:
        """Journal the arm gripper's hold of the part, as known now."""
        self.note(arm_hold_row(self.held()))

    def note_fixed_grasp(self, grasp: Grasp, opening_mm: float) -> None:
        """Journal the fixed gripper's hold of the part, or the hold once the arm gripper opens.

        Parameters
        ----------
        grasp : its grasp
        opening_mm : opening of its jaws on the part
        """
        self.note(fixed_hold_row(grasp, opening_mm))

    def avoid(self, grasp_id: str) -> None:
        """Avoid a failed grasp in further plans for this part."""
        self.part.avoid.add(grasp_id)
        self.note(rows.GraspAvoided(grasp=grasp_id))

    def begin_recovery(
        self, recovery: Recovery, words: str, source: str = "", code: str = ""
    ) -> None:
        """Keep, journal and show a recovery of the current part.

        Parameters
        ----------
        recovery : the fault, and what is done about it
        words : current activity, for the operator
        source : the grasp or view that failed, as budgets name it; empty for none
        code : code of the fault's alarm; empty if nothing is wrong with the cell
        """
        part = self.part
        part.recoveries.append(recovery)
        if recovery.act is Act.PARK:
            part.parked = recovery
        self.note(
            rows.RecoveryBegun(
                fault=recovery.fault.value,
                reason=recovery.reason,
                action=words,
                number=len(part.recoveries),
                custody=part.custody.key,
                act=recovery.act.value,
                source=source,
                alarm=alarm_of(code).number if code else 0,
            )
        )
        self.show(say("{reason}; {words}", reason=recovery.reason, words=words), remaining_s=None)

    def show(self, label: str, **more: object) -> None:
        """Display the cell's present action; ``more`` are fields of `RunProgress`."""
        self._progress.label = label
        self._progress.custody = self.part.custody
        for name, value in more.items():
            setattr(self._progress, name, value)
        self._on_progress()

    def show_state(
        self, state: str, *, is_at_work: bool = True, is_same_work: bool = False
    ) -> None:
        """Display the state that the cell has entered; its label is set by its action.

        Parameters
        ----------
        state : its name
        is_at_work : True while the plan makes progress; otherwise its remaining time is not shown
        is_same_work : True if the activity is the same as before, only paused or resumed
        """
        if state != self._progress.state and not is_same_work:
            self._progress.label = ""
        if not is_at_work:
            self._progress.remaining_s = None
        self._progress.state = state
        self._on_progress()

    def note(self, row: Body) -> None:
        """Write a row on the current part."""
        self._journal.write(row, self.part.number)

    async def note_secured(self, row: Body) -> None:
        """Write a row on the current part; on the disk when this returns."""
        await self._journal.write_secured(row, self.part.number)

    def note_followed(self, run: str, number: int) -> None:
        """Add to a run that ended with a part that this run has its record from now on.

        Parameters
        ----------
        run : the other run
        number : number of the part in it
        """
        self._journal.write_about(run, rows.PartFollowed(run=self._journal.run), number)

    def note_file(self, file: str, digest: str) -> None:
        """Write a row on a file of the run's folder, with the SHA-256 of the content written."""
        self.note(rows.FilesStored({file: digest}))

    async def set_custody(self, custody: Custody, detail: str = "") -> None:
        """Change the gripper, tray or table that has the part; on the disk when this returns."""
        self.part.custody = custody
        self._progress.custody = custody
        row = rows.CustodyChanged(name=custody.key, detail=detail)
        await self._journal.write_secured(row, self.part.number)

    async def repeat_intent(self, intent: rows.Intent) -> None:
        """Write the unresolved intent of an interrupted run, which this run has to resolve."""
        more = {"by": "recovery", "detail": key("of the interrupted run")}
        await self._journal.write_secured(intent.model_copy(update=more), self.part.number)

    @asynccontextmanager
    async def once(self, intent: rows.Intent) -> AsyncIterator[None]:
        """Enter a block that must never be repeated blindly, once its intent is on the disk."""
        await self._journal.write_secured(intent, self.part.number)
        self._once_count += 1
        try:
            yield
        finally:
            self._once_count -= 1
        self._journal.write(rows.OnceDone(name=intent.name), self.part.number)

    @property
    def is_once_open(self) -> bool:
        """Whether a grasp or release has begun whose result is not confirmed yet."""
        return self._once_count > 0
