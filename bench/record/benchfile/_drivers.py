"""Which driver kinds exist: a table of ours, and the entry points of other packages."""

from __future__ import annotations

import difflib
from collections.abc import Mapping

from drivers.base.errors import ConfigurationError
from drivers.base.plugins import entry_points_of

ENTRY_POINT_GROUP = "gyrobench.drivers"
ROLES = ("table", "chamber", "gyro", "platform")

_BUILT_IN: Mapping[str, Mapping[str, str]] = {
    "table": {"acutrol3000": "drivers.acutrol:Acutrol3000", "ideal_atl": "drivers.ideal_atl:IdealAtl"},
    "chamber": {
        "weiss": "drivers.weiss:Weiss",
        "espec_p300": "drivers.espec:EspecP300",
        "espec_scp220": "drivers.espec:EspecScp220",
        "watlow_f4": "drivers.watlow:WatlowF4",
        "watlow_f4t": "drivers.watlow:WatlowF4T",
    },
    "gyro": {
        "kvh1750": "drivers.kvh:Kvh1750",
        "can_dbc": "drivers.can_dbc:CanDbc",
        "sbg_ellipse": "drivers.sbg:SbgEllipse",
        "rlg2t": "drivers.rlg:Rlg2t",
        "frames": "drivers.frames:Frames",
        "stim300": "drivers.stim300:Stim300",
    },
    "platform": {"platform_ins": "drivers.platform:PINS"},
}
"""Role -> kind -> path of its `TableKind`, `ChamberKind`, `GyroKind` or `PlatformKind`."""


def known_drivers(role: str) -> dict[str, str]:
    """Return driver kind -> import path (`module:attribute`) for `role`, one of `ROLES`.

    Another package adds a kind with an entry point of group `gyrobench.drivers` named `<role>.<kind>`, e.g.
    `gyro.fg333 = "our_lab.fg333:Fg333"` with a `drivers.kit.instruments.GyroKind` behind it. A built-in kind
    cannot be replaced: a bench file means the same on every machine.
    """
    prefix = f"{role}."
    found = {
        point.name.removeprefix(prefix): point.value
        for point in entry_points_of(ENTRY_POINT_GROUP)
        if point.name.startswith(prefix)
    }
    return found | dict(_BUILT_IN[role])


def driver_path(role: str, kind: str) -> str:
    """Return the import path of driver `kind`; raises ConfigurationError with the nearest name."""
    known = known_drivers(role)
    if kind not in known:
        raise ConfigurationError(
            f"there is no {role} driver of that kind", found=repr(kind), expected=one_of(kind, known)
        )
    return known[kind]


def one_of(found: str, names: Mapping[str, object] | list[str]) -> str:
    """Return "one of a, b, c", with the nearest to `found` pointed out."""
    near = difflib.get_close_matches(found, list(names), n=1)
    suggestion = f" (did you mean {near[0]!r}?)" if near else ""
    return f"{'one of ' if len(names) > 1 else ''}{', '.join(sorted(names))}{suggestion}"
