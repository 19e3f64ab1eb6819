"""One user a bench: a lease on its ports, held by the kernel, with a note that says who has it.

A lease is a lock (`drivers.base.locks`) on one small file per port in `$XDG_STATE_HOME/gyrobench/leases`. The
kernel lets go of it when the last process that has it open ends, however it ends, so no lease outlives its
holder; what a killed process leaves is a note without a lock, which the next one finds, reports and replaces.
A watchdog that inherits the descriptors keeps the lease until it has brought the bench to rest.

Benches are told apart by their ports, not by their files: two bench files that share a chamber share its lease.
The pseudo-terminals of a lab that was killed are other devices than those that get their numbers afterwards.
"""

from __future__ import annotations

import contextlib
import getpass
import hashlib
import json
import os
import socket
import stat
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from bench.control.process import process_start
from bench.record.benchfile import BenchFile
from drivers.base.clock import utc_now
from drivers.base.errors import BenchInUse, ConfigurationError
from drivers.base.locks import is_locked, release_lock, take_lock
from drivers.base.system import open_flags, state_folder
from drivers.kit.places import socket_address

_PSEUDO_TERMINALS = "/dev/pts/"


@dataclass(frozen=True)
class Holder:
    """Who has a bench. `process_start` (ticks since boot) tells a process from a later one of the same id."""

    bench: str
    purpose: str
    user: str
    host: str
    pid: int
    process_start: int
    since_utc: str
    watchdog_pid: int = 0

    @property
    def alive(self) -> bool:
        """Whether the process that took the lease still runs; always True for one on another host."""
        if self.host != socket.gethostname():
            return True
        return process_start(self.pid) == self.process_start

    def __str__(self) -> str:
        text = f"{self.user}@{self.host}, process {self.pid}, since {self.since_utc}: {self.purpose}"
        if self.alive:
            return text
        return f"{text} (that process has ended; its watchdog {self.watchdog_pid or ''} has the bench still)"


class Lease:
    """A bench of one's own until `release`; use as a context manager."""

    def __init__(self, holder: Holder, files: dict[Path, int], stale: tuple[Holder, ...]) -> None:
        self.holder = holder
        self.stale = stale
        """Who left the bench without giving it back: killed, or the power went."""
        self._files = files

    @property
    def descriptors(self) -> tuple[int, ...]:
        """The locked files: a child process that inherits them keeps the lease."""
        return tuple(self._files.values())

    def update(self, **changes: Any) -> None:
        """Say anew what the bench is used for (`purpose`), or which watchdog guards it (`watchdog_pid`)."""
        self.holder = replace(self.holder, **changes)
        for descriptor in self._files.values():
            _write(descriptor, self.holder)

    def release(self) -> None:
        """Give the bench back; harmless when given back already."""
        files, self._files = self._files, {}
        _let_go(files)

    def __enter__(self) -> Lease:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def take_lease(file: BenchFile, purpose: str) -> Lease:
    """Take the bench for `purpose` ("run 20260101-...", "campaign ..."); BenchInUse says who has it."""
    pid = os.getpid()
    holder = Holder(
        bench=file.bench.name,
        purpose=purpose,
        user=_user(),
        host=socket.gethostname(),
        pid=pid,
        process_start=process_start(pid),
        since_utc=utc_now(),
    )
    files: dict[Path, int] = {}
    stale: list[Holder] = []
    try:
        for port, path in _paths(file):
            files[path] = descriptor = _lock(path, port)
            left = _read(descriptor)
            if left is not None and left not in stale:
                stale.append(left)
            _write(descriptor, holder)
    except BaseException:
        _let_go(files)
        raise
    return Lease(holder, files, tuple(stale))


def lease_holder(file: BenchFile) -> Holder | None:
    """Return who has any of the bench's ports now, None if it is free."""
    for _, path in _paths(file):
        try:
            descriptor = os.open(path, open_flags("O_RDONLY"))
        except OSError:
            continue
        try:
            if is_locked(descriptor):
                return _read(descriptor)
        finally:
            os.close(descriptor)
    return None


def _paths(file: BenchFile) -> list[tuple[str, Path]]:
    """Return (port, its lease file), in an order that is the same for everybody: no deadlock, no half lease."""
    places = sorted({_place(port) for port in file.ports.values()})
    folder = state_folder() / "leases"
    names = [hashlib.sha256(device_at(place).encode()).hexdigest()[:24] for place in places]
    return [(place, folder / f"{name}.json") for place, name in zip(places, names, strict=True)]


def _place(port: str) -> str:
    """Return where a port leads, the same however it is written: links followed, a host by its address."""
    if port.startswith("/"):
        return os.path.realpath(port)
    try:
        host, number = socket_address(port)
        found = socket.getaddrinfo(host, number, socket.AF_UNSPEC, socket.SOCK_STREAM)
    except (OSError, ValueError):  # no socket, or a host that nobody knows now
        return port
    address = str(found[0][4][0])
    return f"socket://{'127.0.0.1' if address == '::1' else address}:{number}"


def device_at(place: str) -> str:
    """Return what tells the device at a place from another one that has its name later.

    A pseudo-terminal, which an emulated lab is reached by, leaves its number to the next one; when it was made
    stays the same however it is used (not so its change time if somebody changes its owner or mode).
    """
    if not place.startswith(_PSEUDO_TERMINALS):
        return place
    try:
        return f"{place} {Path(place).stat().st_ctime_ns}"
    except OSError:
        return place


def _lock(path: Path, port: str) -> int:
    while True:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(path, open_flags("O_RDWR", "O_CREAT"), 0o644)
            _share(descriptor, path.parent)
        except PermissionError as error:
            if _removed(path, port):
                continue
            raise _unwritable(path, error) from error
        except OSError as error:
            raise _unwritable(path, error) from error
        try:
            take_lock(descriptor)
        except BlockingIOError:
            holder = _read(descriptor)
            os.close(descriptor)
            raise _in_use(port, holder) from None
        if _is_at(descriptor, path):
            return descriptor
        os.close(descriptor)  # given back, and removed, between opening and locking


def _share(descriptor: int, folder: Path) -> None:
    """Let everybody write a lease who may write its folder: accounts that share a bench share its leases."""
    with contextlib.suppress(OSError):  # somebody else's, who has done so
        others = stat.S_IMODE(folder.stat().st_mode) & 0o022
        if others and hasattr(os, "fchmod"):
            os.fchmod(descriptor, 0o600 | others | others << 1)


def _removed(path: Path, port: str) -> bool:
    """Remove a lease of another account that nobody has any more; whether that could be done.

    BenchInUse for one that is held.
    """
    try:
        descriptor = os.open(path, open_flags("O_RDONLY"))
    except OSError:
        return False
    try:
        if is_locked(descriptor):
            raise _in_use(port, _read(descriptor))
        path.unlink()
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True


def _unwritable(path: Path, error: OSError) -> ConfigurationError:
    return ConfigurationError(
        "the lease of the bench cannot be written",
        where=str(path),
        found=error.strerror or str(error),
        expected="a folder for state that can be written",
        remedy="set XDG_STATE_HOME to one that everybody who uses this bench can write",
    )


def _in_use(port: str, holder: Holder | None) -> BenchInUse:
    return BenchInUse(
        "the bench is in use",
        where=port,
        found=str(holder) if holder else "a lease that is being taken at this moment",
        expected="a bench that nobody uses",
        remedy="wait until it is free, or ask its user; a lease ends with the process that has it",
    )


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _let_go(files: dict[Path, int]) -> None:
    for path, descriptor in files.items():
        try:
            path.unlink()
        except (
            OSError
        ):  # gone already; or Windows, which keeps the name of an open file: then it says nothing
            with contextlib.suppress(OSError):
                os.ftruncate(descriptor, 0)
        with contextlib.suppress(OSError):
            release_lock(descriptor)
        os.close(descriptor)


def _write(descriptor: int, holder: Holder) -> None:
    content = json.dumps(asdict(holder)).encode()
    os.lseek(descriptor, 0, os.SEEK_SET)
    os.write(descriptor, content)
    os.ftruncate(descriptor, len(content))


def _read(descriptor: int) -> Holder | None:
    os.lseek(descriptor, 0, os.SEEK_SET)
    try:
        return Holder(**json.loads(os.read(descriptor, 65536)))
    except (ValueError, TypeError):
        return None


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):  # an id without a name, as in many containers
        return str(os.getuid()) if hasattr(os, "getuid") else "unknown"
