"""Who is at a page that is open, as long as they are signed in."""

from __future__ import annotations

from bench.control.operators import Signature, may
from bench.present.panel._access import Visit
from bench.present.panel._sign_in import Sessions
from bench.record.events import Role


class Presence:
    """The operator at a page that is open for hours: they may be signed out or given another role meanwhile."""

    def __init__(self, visit: Visit, sessions: Sessions | None) -> None:
        self._visit = visit
        self._sessions = sessions

    @property
    def signs_in(self) -> bool:
        """Whether operators sign in at this panel; if not, names are typed and everybody may do everything."""
        return self._sessions is not None

    @property
    def name(self) -> str:
        """The name of whoever is signed in; empty where names are typed."""
        return self._visit.name

    @property
    def role(self) -> Role | None:
        """The role as it is now, None for somebody who is signed out."""
        if self._sessions is None or not self._visit.token:
            return self._visit.role
        found = self._sessions.of(self._visit.token)
        return None if found is None else found.role

    def may(self, needs: Role) -> bool:
        """Return whether they may do that now."""
        role = self.role
        return role is not None and may(role, needs)

    def signature(self, typed: str = "") -> Signature:
        """Return what stands in the record of what they do; `typed`: the name where nobody signs in."""
        return Signature(self._visit.name, self.role) if self.signs_in else Signature(typed.strip())
