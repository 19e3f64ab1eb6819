"""The shrinkage in a log of heading changes: a platform's position error against rehearsals of its procedure."""

from __future__ import annotations

import numpy as np

from bench.analysis.gap._rehearsal import LogGap, log_gap
from bench.analysis.heading import PlatformLog, stays, without_start
from drivers.base.arrays import Array


def heading_log_gaps(
    run: PlatformLog, nominal: PlatformLog, closed: PlatformLog, again: PlatformLog
) -> list[LogGap]:
    """Return the gaps of all stays after the first, all of them first; `again` is `closed` with another seed.

    Each log's start is taken out of it: what its own first stay foretells. RecordError as `without_start`.
    """
    first, *rest = stays(run)
    origin_s = run.time_s[first.start]
    real = _position(run)
    others = []
    for log in (nominal, closed, again):
        own = _position(log)
        time_s = log.time_s - log.time_s[stays(log)[0].start] + origin_s
        known = ~np.isnan(own).any(axis=0)
        others.append(np.stack([np.interp(run.time_s, time_s[known], row[known]) for row in own]))
    apart = np.stack((real - others[0], real - others[1], others[1] - others[2]))
    parts = [slice(stay.start, stay.stop) for stay in rest]
    rows = [("all", np.concatenate([apart[:, :, part] for part in parts], axis=2))]
    rows += [
        (f"{stay.heading_deg:.0f} deg", apart[:, :, part]) for stay, part in zip(rest, parts, strict=True)
    ]
    return [log_gap(name, "arcsec", np.nanmean((values**2).sum(axis=1), axis=1)) for name, values in rows]


def _position(log: PlatformLog) -> Array:
    """Return north and east error in arcsec less what the first stay foretells, (2, n)."""
    left = without_start("run", log, stays(log)[0], np.zeros((len(log.time_s), 3)))
    return np.stack((left.north_as, left.east_as))
