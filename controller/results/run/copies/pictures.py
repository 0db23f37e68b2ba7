"""Pictures of a run: from its folder, else from the store of objects they were copied to."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from controller.config.files import file_within, write_whole

from ..model import Copy
from .objects import ObjectsError, ObjectStore, WrongObjectError


class RunPictures:
    """Reader of a run's pictures.

    Parameters
    ----------
    folder : folder of the run
    copies : by name of a file, the copies there are
    is_here : False for a run of another machine: what may be in the folder is not its
    stores : stores of objects by address, open or with the reason why they are not, for several
        runs to share
    """

    def __init__(
        self,
        folder: Path,
        copies: Mapping[str, Copy] | None = None,
        *,
        is_here: bool = True,
        stores: dict[str, ObjectStore | str] | None = None,
    ) -> None:
        self.folder = folder
        self.copies: Mapping[str, Copy] = {} if copies is None else copies
        self._is_here = is_here
        self._stores = {} if stores is None else stores

    def read(self, name: str) -> bytes | str:
        """Return a picture's bytes, or the reason why there are none.

        Those of a copy are checked by their hash.

        Parameters
        ----------
        name : name of the file, relative to the folder
        """
        path = file_within(self.folder, name)
        if path is None:
            return f"picture {name} is outside of the run's folder"
        if self._is_here and path.is_file():
            try:
                return path.read_bytes()
            except OSError as error:
                return f"picture {name} cannot be read: {error.strerror}"
        if name not in self.copies:
            return f"picture {name} is missing"
        copy = self.copies[name]
        store = self._opened(copy.to)
        if isinstance(store, str):
            return f"picture {name} is not here, and not read from its copy: {store}"
        try:
            return store.read(copy.sha256, name)
        except WrongObjectError as error:
            return f"picture {name} is not here, and its copy is no use: {error}"
        except ObjectsError as error:
            self._stores[copy.to] = str(error)  # the next picture does not wait for it again
            return f"picture {name} is not here, and not read from its copy: {error}"

    def bring_back(self, names: Sequence[str]) -> tuple[str, ...]:
        """Write pictures that are missing into the folder, from their copies.

        Parameters
        ----------
        names : names of files, relative to the folder

        Returns
        -------
        why those that are still missing are, in sentences

        Raises
        ------
        ConfigError : a file cannot be written
        """
        problems = []
        for name in names:
            path = file_within(self.folder, name)
            if path is not None and path.is_file():
                continue
            found = self.read(name)
            if isinstance(found, str) or path is None:
                problems.append(str(found))
            else:
                write_whole(path, found)
        return tuple(problems)

    def _opened(self, url: str) -> ObjectStore | str:
        """Return a store of objects, or why it cannot be opened."""
        if url not in self._stores:
            try:
                self._stores[url] = ObjectStore(url)
            except ObjectsError as error:
                self._stores[url] = str(error)
        return self._stores[url]
