"""The store: its place, its opening, and the check of its version."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from sqlalchemy import Connection, Engine, create_engine, event, func, inspect, select, update
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError

from .errors import HistoryError
from .migrations import SCHEMA_VERSION, migrate
from .tables import METADATA, VERSION

STORE_NAME: Final = "history.sqlite"
VARIABLE: Final = "CELLCTL_HISTORY"
TURN: Final = 0x63656C6C  # PostgreSQL's advisory lock of those who make or change the tables
BUSY_S: Final = 30.0  # longest wait of one filler for another


class Store:
    """An open store; missing or old tables are made or migrated.

    Parameters
    ----------
    url : URL of SQLAlchemy, as ``postgresql+pg8000://user@host/name``

    Raises
    ------
    HistoryError : it cannot be opened, or is of a later version
    """

    def __init__(self, url: str) -> None:
        try:
            where = make_url(url)
            self.name = where.render_as_string(hide_password=True)
            self._is_sqlite = where.get_backend_name() == "sqlite"
            self.engine = _engine(url, is_sqlite=self._is_sqlite)
        except (ArgumentError, NoSuchModuleError) as error:
            # without the URL, which may hold a password
            raise HistoryError(
                "the store's URL cannot be read: it has the form "
                "sqlite:///FILE or postgresql+pg8000://USER@HOST/NAME"
            ) from error
        except ImportError as error:
            raise HistoryError(
                f"store {self.name}: {error.name} is not installed: pip install 'cellctl[postgres]'"
            ) from error
        try:
            self._bring_up()
        except (DBAPIError, OSError) as error:
            self.engine.dispose()
            raise HistoryError(f"store {self.name}: {_first_line(error)}") from error
        except HistoryError:
            self.engine.dispose()
            raise

    def _bring_up(self) -> None:
        with self.engine.connect() as db:
            names = set(inspect(db).get_table_names())
            if VERSION.name in names and _version(db) == SCHEMA_VERSION:
                return
        if names and VERSION.name not in names:
            raise HistoryError(f"store {self.name}: holds tables that are not of cellctl")
        with self.engine.begin() as db:
            self._take_turns(db)
            if not inspect(db).has_table(VERSION.name):
                METADATA.create_all(db)
                db.execute(VERSION.insert().values(one=1, version=SCHEMA_VERSION))
                return
            version = _version(db)
            if version > SCHEMA_VERSION:
                raise HistoryError(
                    f"store {self.name} is of version {version}, this cellctl knows "
                    f"{SCHEMA_VERSION}: use the cellctl that wrote it, or another store (--store)"
                )
            migrate(db, version)

    def _take_turns(self, db: Connection) -> None:
        """Wait until nobody else makes or changes the tables, until the end of the transaction."""
        if self._is_sqlite:
            db.exec_driver_sql("BEGIN IMMEDIATE")  # else its driver begins with the first row
        else:
            db.execute(select(func.pg_advisory_xact_lock(TURN)))

    @property
    def file(self) -> Path | None:
        """The file of an SQLite store."""
        database = self.engine.url.database
        return Path(database) if self._is_sqlite and database else None

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Yield a connection to read by.

        Raises
        ------
        HistoryError : the store cannot be read
        """
        try:
            with self.engine.connect() as db:
                yield db
        except DBAPIError as error:
            raise HistoryError(f"store {self.name}: {_first_line(error)}") from error

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """Yield a connection for writing, to one process at a time; all is kept or nothing.

        Raises
        ------
        HistoryError : the store cannot be written
        """
        try:
            with self.engine.begin() as db:
                # the first statement takes the lock, so that nobody reads what another is changing
                db.execute(update(VERSION).values(version=VERSION.c.version))
                yield db
        except DBAPIError as error:
            raise HistoryError(f"store {self.name}: {_first_line(error)}") from error

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()


def store_url(runs_dir: Path, named: str | None, environment: Mapping[str, str]) -> str:
    """Return the URL of a cell's store: the one named, that of the variable, or a file.

    Parameters
    ----------
    runs_dir : folder of all runs
    named : on the command line; None if it was not
    environment : environment of the process
    """
    found = named or environment.get(VARIABLE, "")
    return found or f"sqlite:///{(runs_dir / STORE_NAME).absolute()}"


def open_store(url: str) -> Store:
    """Return a store, made if there is none.

    Raises
    ------
    HistoryError : it cannot be opened, or is of a later version
    """
    return Store(url)


def _version(db: Connection) -> int:
    return int(db.execute(select(VERSION.c.version)).scalar_one())


def _engine(url: str, *, is_sqlite: bool) -> Engine:
    if not is_sqlite:
        engine = create_engine(url, pool_pre_ping=True)
        # its driver sends each row of many by itself; as one statement they go in one round trip
        engine.dialect.use_insertmanyvalues_wo_returning = True
        return engine
    engine = create_engine(url, connect_args={"timeout": BUSY_S})

    def prepare(connection: Any, _: object) -> None:  # noqa: ANN401 - of the driver
        cursor = connection.cursor()
        cursor.execute("PRAGMA journal_mode = WAL")
        # what a power cut takes is filled again from the journal
        cursor.execute("PRAGMA synchronous = NORMAL")
        cursor.close()

    event.listen(engine, "connect", prepare)
    return engine


def _first_line(error: Exception) -> str:
    cause = getattr(error, "orig", None) or error
    text = str(cause).strip().splitlines()
    return text[0][:300] if text else type(cause).__name__
