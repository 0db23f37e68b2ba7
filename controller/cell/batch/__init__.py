"""One batch: the cell's work from connecting its devices to rest.

`order.py` is the order to run, `run.py` runs it, `beginning.py` records the state found before
anything moves, `starting.py` decides on the start, `assembly.py` builds the cell, `dispatcher.py`
takes events and runs effects, `watching/` reports events outside of actions. Each effect is run by
an action (`controller.cell.actions`), with services (`controller.cell.services`).
"""

from ..services.records import PartRecord, RunProgress
from .assembly import Batch, assemble, product_of
from .beginning import input_files, who_and_what
from .dispatcher import WORKER_GONE, BatchEnd, Dispatcher
from .order import OrderedRecipe, Papers, RecoveryPolicy, RunOrder, jobs_of
from .run import HOST, Outfit, RunResult, new_run_id, run_batch
from .starting import GO_ON, find_proposal
from .status import CellStatus
from .watching import (
    ArmWatcher,
    DiskWatcher,
    InterlockWatcher,
    ModbusWatcher,
    MotorSupplyWatcher,
)

__all__ = [
    "GO_ON",
    "HOST",
    "WORKER_GONE",
    "ArmWatcher",
    "Batch",
    "BatchEnd",
    "CellStatus",
    "DiskWatcher",
    "Dispatcher",
    "InterlockWatcher",
    "ModbusWatcher",
    "MotorSupplyWatcher",
    "OrderedRecipe",
    "Outfit",
    "Papers",
    "PartRecord",
    "RecoveryPolicy",
    "RunOrder",
    "RunProgress",
    "RunResult",
    "assemble",
    "find_proposal",
    "input_files",
    "jobs_of",
    "new_run_id",
    "product_of",
    "run_batch",
    "who_and_what",
]
