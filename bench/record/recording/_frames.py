"""The tables of a run as frames of other libraries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from drivers.base.errors import RecordError
from drivers.base.plugins import from_extra

if TYPE_CHECKING:
    import pandas as pd


class Framed:
    """Base of what has tables by name: `turntable`, `chamber`, `gyro_<name>`."""

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables, in order."""
        raise NotImplementedError

    @property
    def place(self) -> Path | str:
        """Where they are."""
        raise NotImplementedError

    def _table(
        self, name: str, columns: Sequence[str] | None, start_s: float | None, end_s: float | None
    ) -> Mapping[str, Any]:
        raise NotImplementedError

    def to_arrow(
        self,
        device: str,
        columns: Sequence[str] | None = None,
        start_s: float | None = None,
        end_s: float | None = None,
    ) -> pa.Table:
        """Return a device's table as an Arrow table, n rows; every column has its unit in its name.

        `device`: the name of a gyro, platform or instrument, `turntable` or `chamber`.
        `polars.from_arrow` and DuckDB take it as it is. RecordError if the run has no table of it.
        """
        named = [name for name in self.tables if device in (name, name.partition("_")[2])]
        if not named:
            raise RecordError(
                f"the run has no table of {device!r}",
                where=str(self.place),
                found=", ".join(name.partition("_")[2] or name for name in self.tables) or "no tables at all",
                expected="the name of a gyro, platform or instrument, turntable or chamber",
            )
        return pa.table(self._table(f"{named[0]}.parquet", columns, start_s, end_s))

    def to_pandas(
        self,
        device: str,
        columns: Sequence[str] | None = None,
        start_s: float | None = None,
        end_s: float | None = None,
    ) -> pd.DataFrame:
        """Return what `to_arrow` returns as a DataFrame, n rows; pandas comes with the extra `analysis`."""
        from_extra("pandas", "analysis", "to_pandas")
        return self.to_arrow(device, columns, start_s, end_s).to_pandas()  # type: ignore[no-any-return]
