"""Pictures of a run for commands that read them as files."""

from collections.abc import Iterable
from pathlib import Path

from controller.config.files import file_within
from controller.results.run import RunPictures, RunRecord

from ..terminal.output import warn


def bring_back(record: RunRecord, pictures: Iterable[Path]) -> None:
    """Write pictures that are missing into the run's folder again, from their copies.

    What has no copy, or one that cannot be read, is named and stays missing.

    Parameters
    ----------
    record : the run
    pictures : paths of pictures in its folder
    """
    missing = {file_within(record.folder, str(one)) for one in pictures if not one.is_file()}
    root = record.folder.resolve()
    names = [path.relative_to(root).as_posix() for path in missing if path is not None]
    reader = RunPictures(record.folder, record.copies)
    for why in reader.bring_back(sorted(name for name in names if name in record.copies)):
        warn(why)
