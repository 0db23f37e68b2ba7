"""`--jobs`: processes that fill the cache ahead of a command that goes through many parts."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from controller import catalogue
from controller.cad.compiled import is_kept
from controller.catalogue import LOCAL, Ahead, Jobs, Made, PartWork, is_made, open_pool
from controller.config import ConfigError

from ..terminal.output import warn

MadeAhead = Callable[[int], Made | None]


def told_of_workers(words: str) -> None:
    """Print a sentence on a cluster's workers on stderr."""
    warn(f"cellctl: {words}")


def jobs_among(text: str | None, *, use_cache: bool = True) -> Jobs:
    """Return the jobs that ``--jobs`` names.

    Parameters
    ----------
    text : value on the command line, None without the option
    use_cache : True to leave results computed ahead in the cache

    Raises
    ------
    ConfigError : it names nothing that can work, or there is no cache to work for
    """
    jobs = catalogue.jobs_among(text)
    if not jobs.is_alone and not use_cache:
        raise ConfigError("--jobs cannot be combined with --no-cache: it fills the cache")
    return jobs


@contextmanager
def working_ahead(jobs: Jobs, works: Sequence[PartWork]) -> Iterator[MadeAhead]:
    """Yield a function that waits for the work on a part, by its number; None without such work.

    Nobody is asked where the cache has all of it.

    Parameters
    ----------
    jobs : pool of worker processes
    works : the parts, in the order in which they are wanted

    Raises
    ------
    ConfigError : there is nobody at that address
    """
    if jobs.scheduler:  # its processes stand in other folders
        works = [
            replace(w, path=w.path.absolute(), cell=w.cell and w.cell.absolute()) for w in works
        ]
    if not jobs.is_alone and all(map(is_made, works)):
        jobs = LOCAL  # to start processes takes longer than to read what there is
    with open_pool(jobs, told_of_workers) as pool:
        ahead = None if pool is None else Ahead(pool, works)
        is_elsewhere = has_warned = False

        def wait_for(number: int) -> Made | None:
            nonlocal is_elsewhere, has_warned
            if ahead is None:
                return None
            made = ahead.wait_for(number)
            if ahead.failure is not None and not has_warned:
                has_warned = True
                words = str(ahead.failure) or type(ahead.failure).__name__
                warn(f"cellctl: the other processes ended early ({words}); this one goes on alone")
            if made.compiled is None or made.compiled.error is not None or is_elsewhere:
                return made
            if not is_kept(works[number].path, works[number].options):
                is_elsewhere = True
                warn(
                    "cellctl: the other processes use another cache; give them the same "
                    "XDG_CACHE_HOME, the same files and the same cellctl"
                )
            return made

        yield wait_for
