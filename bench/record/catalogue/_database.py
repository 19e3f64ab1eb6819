"""SQLite or PostgreSQL behind one URL: both understand our statements; parameters are `:name`.

Both speak Python's DB-API. An object mapper in between takes longer to load than listing 100,000 runs may take.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from drivers.base.errors import ConfigurationError, RecordError

_SQLITE = "sqlite:///"
_POSTGRESQL = re.compile(r"^postgres(?:ql)?(?:\+psycopg)?://")
_PARAMETER = re.compile(r":([a-z_]+)")
_WAIT_S = 10
"""For a server to answer, for another process to let go of the file."""


class Database:
    """A connection to the database of a URL.

    Raises ConfigurationError for a URL that cannot be one, RecordError for whatever the database refuses.
    """

    def __init__(self, url: str) -> None:
        self._name = _without_password(url)
        if url.startswith(_SQLITE) and len(url) > len(_SQLITE):
            import sqlite3

            self.postgresql = False
            self._errors: type[Exception] = sqlite3.Error
            with self._told():
                self._connection: Any = sqlite3.connect(url.removeprefix(_SQLITE), timeout=_WAIT_S)
        elif _POSTGRESQL.match(url):
            # a second @ makes a piece of the password the host that errors name
            if url.partition("?")[0].count("@") > 1:
                raise _unusable(self._name, "an @ in a name or password is written %40")
            try:
                import psycopg
                from psycopg.conninfo import conninfo_to_dict
            except ImportError as error:
                raise _unusable(
                    self._name, f"psycopg does not load: {error}", "pip install 'gyrobench[postgres]'"
                ) from error
            try:
                where: dict[str, Any] = conninfo_to_dict(_POSTGRESQL.sub("postgresql://", url))
            except psycopg.Error as error:
                raise _unusable(self._name, _without_password(str(error))) from error
            self.postgresql = True
            self._errors = psycopg.Error
            with self._told():
                self._connection = psycopg.connect(**{"connect_timeout": _WAIT_S} | where)
        else:
            raise _unusable(self._name)

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Keep what is done inside, or nothing of it."""
        with self._told():
            try:
                yield
            except BaseException:
                self._connection.rollback()
                raise
            self._connection.commit()

    def rows(self, statement: str, **values: object) -> list[Sequence[Any]]:
        """Return the rows that a query finds; inside of a transaction."""
        found: list[Sequence[Any]] = self._connection.execute(self._own(statement), values).fetchall()
        return found

    def change(self, statement: str, rows: Sequence[Mapping[str, object]]) -> None:
        """Do a statement once for each row of values; inside of a transaction."""
        if rows:
            self._connection.cursor().executemany(self._own(statement), rows)

    def make(self, statement: str) -> None:
        """Do a statement without values; inside of a transaction."""
        self._connection.execute(statement)

    def close(self) -> None:
        """Let go of the database."""
        self._connection.close()

    def _own(self, statement: str) -> str:
        return _PARAMETER.sub(r"%(\1)s", statement) if self.postgresql else statement

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except self._errors as error:
            text = str(error) or type(error).__name__
            raise RecordError(
                "the catalogue of runs cannot be used",
                where=self._name,
                found=_without_password(text.splitlines()[0]),
                remedy="run folders are not affected: `gyrobench runs index --rebuild` makes it anew from them",
            ) from error


def _unusable(url: str, why: str = "", remedy: str = "") -> ConfigurationError:
    return ConfigurationError(
        "the catalogue's URL cannot be used",
        found=f"{url}: {why}" if why else url,
        expected="sqlite:///FILE or postgresql://USER@HOST/DATABASE",
        remedy=remedy,
    )


def _without_password(url: str) -> str:
    hidden = re.sub(r"(://[^:/@\s]*):\S*@", r"\1:***@", url)
    return re.sub(r"(?i)(password=)[^&\s]*", r"\1***", hidden)
