"""Named operators: what each may do at a bench, and the file that knows them by their passwords' hashes."""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bench.record.events import Role
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError
from drivers.base.files import SETTINGS_BYTES, read_bounded, replace_file
from drivers.base.locks import take_lock
from drivers.base.system import open_flags

ROLES: tuple[Role, ...] = get_args(Role)
"""All roles; each may do what those before it may."""
SHORTEST_PASSWORD = 12
_LONGEST_NAME = 60
_LONGEST_PASSWORD = 200
_MOST = 200


class Signature(NamedTuple):
    """Who did something; `role`: as which they were signed in, None for a name that somebody typed."""

    name: str
    role: Role | None = None


def may(has: Role, needs: Role) -> bool:
    """Return whether a role includes another."""
    return ROLES.index(has) >= ROLES.index(needs)


class Hash(BaseModel):
    """A password's scrypt hash (RFC 7914) with what it was made with.

    The costs are those that the OWASP Password Storage Cheat Sheet asks for at 32 MiB.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    salt: str = Field(pattern=r"^[0-9a-f]{32}$")
    hash: str = Field(pattern=r"^[0-9a-f]{64}$")
    n: int = Field(2**15, ge=2**14, le=2**17)
    r: int = Field(8, ge=8, le=16)
    p: int = Field(3, ge=1, le=16)

    @classmethod
    def of(cls, password: str) -> Hash:
        """Return the hash of a password with a salt of its own."""
        empty = cls(salt=secrets.token_hex(16), hash="0" * 64)
        return empty.model_copy(update={"hash": empty.made_of(password)})

    def made_of(self, password: str) -> str:
        """Return what a password hashes to with this salt."""
        memory = 2 * 128 * self.n * self.r
        made = hashlib.scrypt(
            password.encode(),
            salt=bytes.fromhex(self.salt),
            n=self.n,
            r=self.r,
            p=self.p,
            maxmem=memory,
            dklen=32,
        )
        return made.hex()

    def fits(self, password: str) -> bool:
        """Return whether that is the password; takes some tenths of a second."""
        return hmac.compare_digest(self.made_of(password), self.hash)


_NOBODYS = Hash(salt="0" * 32, hash="0" * 64)
"""Takes as long to look at as any other."""


class Operator(BaseModel):
    """Somebody who may sign in."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(min_length=1, max_length=_LONGEST_NAME)
    role: Role
    password: Hash
    since: str

    @property
    def signature(self) -> Signature:
        """What stands in the record."""
        return Signature(self.name, self.role)


class _File(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = 1
    key: str = Field(pattern=r"^[0-9a-f]{64}$")
    operators: tuple[Operator, ...] = ()


class OperatorsFile:
    """The operators of a file, read anew when it has changed; it can be written by its owner only."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._stamp: tuple[int, int, int] | None = None
        self._file: _File | None = None

    def all(self) -> tuple[Operator, ...]:
        """Return the operators; ConfigurationError for a file that is not there or is none."""
        return self._read().operators

    @property
    def key(self) -> str:
        """What sessions are signed with: whoever knows it can sign in as anybody."""
        return self._read().key

    def find(self, name: str) -> Operator | None:
        """Return an operator by name, whatever the case."""
        asked = name.strip().casefold()
        return next((one for one in self.all() if one.name.casefold() == asked), None)

    def check(self, name: str, password: str) -> Operator | None:
        """Return the operator with that name and password; an unknown name takes as long."""
        found = self.find(name)
        fits = (found.password if found is not None else _NOBODYS).fits(password[:_LONGEST_PASSWORD])
        return found if fits else None

    def add(self, name: str, role: str, password: str) -> Operator:
        """Add an operator; the first one makes the file. ConfigurationError for a name that is taken."""
        operator = Operator(
            name=checked_name(name),
            role=checked_role(role),
            password=Hash.of(checked_password(password, name)),
            since=utc_now(),
        )

        def added(known: tuple[Operator, ...]) -> tuple[Operator, ...]:
            if any(one.name.casefold() == operator.name.casefold() for one in known):
                raise ConfigurationError("there is an operator of this name", found=operator.name)
            if len(known) >= _MOST:
                raise ConfigurationError(
                    "too many operators", found=str(len(known)), expected=f"at most {_MOST}"
                )
            return (*known, operator)

        self._change(added, make=True)
        return operator

    def set_role(self, name: str, role: str) -> Operator:
        """Give an operator another role; it counts from the next request on."""
        return self._replace(name, role=checked_role(role))

    def set_password(self, name: str, password: str) -> Operator:
        """Give an operator another password, which signs them out everywhere."""
        return self._replace(name, password=Hash.of(checked_password(password, name)))

    def remove(self, name: str) -> None:
        """Take an operator out: they are signed out at once. What they did stays in the records."""
        gone = self._existing(name)
        self._change(lambda known: tuple(one for one in known if one.name != gone.name))

    def _existing(self, name: str) -> Operator:
        found = self.find(name)
        if found is None:
            known = ", ".join(one.name for one in self.all()) or "nobody yet"
            raise ConfigurationError("there is no operator of this name", found=name[:80], expected=known)
        return found

    def _replace(self, name: str, **update: object) -> Operator:
        changed = self._existing(name).model_copy(update=update)
        self._change(lambda known: tuple(changed if one.name == changed.name else one for one in known))
        return changed

    def _change(
        self, change: Callable[[tuple[Operator, ...]], tuple[Operator, ...]], *, make: bool = False
    ) -> None:
        with self._alone():
            there = not make or self.path.exists()
            file = self._read() if there else _File(key=secrets.token_hex(32))
            text = file.model_copy(update={"operators": change(file.operators)}).model_dump_json(indent=1)
            try:
                replace_file(self.path, text + "\n", mode=0o600)
            except OSError as error:
                raise self._unusable(error.strerror or str(error), "a folder that can be written") from error

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Be the one who changes the file."""
        lock = self.path.with_name(f".{self.path.name}.lock")
        try:
            descriptor = os.open(lock, open_flags("O_RDWR", "O_CREAT"), 0o600)
        except OSError as error:
            raise self._unusable(error.strerror or str(error), "a folder that can be written") from error
        try:
            take_lock(descriptor, wait=True)
            yield
        finally:
            os.close(descriptor)

    def _read(self) -> _File:
        try:
            status = self.path.stat()
            stamp = (status.st_mtime_ns, status.st_size, status.st_ino)
            with self._lock:
                if self._file is None or stamp != self._stamp:
                    self._file = _File.model_validate_json(read_bounded(self.path, SETTINGS_BYTES))
                    self._stamp = stamp
                return self._file
        except FileNotFoundError as error:
            raise self._unusable("no such file", "the file that `gyrobench operators add` makes") from error
        except ValidationError as error:
            raise self._unusable(f"{error.error_count()} mistakes", "the file as it was written") from error
        except OSError as error:
            raise self._unusable(error.strerror or str(error), "a file that can be read") from error

    def _unusable(self, found: str, expected: str) -> ConfigurationError:
        return ConfigurationError(
            "the operators' file cannot be used", where=str(self.path), found=found, expected=expected
        )


def checked_name(name: str) -> str:
    """Return an operator's name without blanks around it; ConfigurationError for one that cannot be shown.

    An apostrophe is a typographic one: O’Brien.
    """
    found = " ".join(name.split()).replace("'", "\N{RIGHT SINGLE QUOTATION MARK}")
    if not 0 < len(found) <= _LONGEST_NAME or not found.isprintable() or set('<>"`\\') & set(found):
        raise ConfigurationError(
            "this is no name for the record",
            found=repr(name[:80]),
            expected=f'1 to {_LONGEST_NAME} letters, none of them < > " ` \\',
        )
    return found


def checked_role(role: str) -> Role:
    """Return a role; ConfigurationError for a word that is none."""
    for known in ROLES:
        if known == role:
            return known
    raise ConfigurationError("there is no such role", found=role[:80], expected=", ".join(ROLES))


def checked_password(password: str, name: str) -> str:
    """Return a password; ConfigurationError for one that is short, or is the name."""
    simple = len(set(password)) < 5 or password.strip().casefold() == name.strip().casefold()
    if not SHORTEST_PASSWORD <= len(password) <= _LONGEST_PASSWORD or simple:
        raise ConfigurationError(
            "a password that is easy to guess",
            found=f"{len(password)} characters",
            expected=f"at least {SHORTEST_PASSWORD} characters, not all the same, and not the name",
            remedy="three or four words that have nothing to do with one another",
        )
    return password
