"""What Windows lacks is hidden from a process, and what it has instead is imitated: code to run before ours."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

_LIGHT = """
import sys
sys.modules["asammdf"] = None  # it takes python-can its time, see drivers/kit/python_can.py
import can
del sys.modules["asammdf"]
import multiprocessing, rich.live, serial, serial.tools.list_ports
"""
_HIDES = """
import fcntl as real, importlib, pkgutil, stat, struct, sys, types

class Hides:
    def find_spec(self, name, path=None, target=None):
        if name in ("termios", "fcntl", "tty", "pty", "resource"):
            raise ModuleNotFoundError(name, name=name)

for name in ("termios", "fcntl", "tty", "pty", "resource"):
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Hides())
import os, select, selectors, signal, socket, subprocess, tempfile  # who needs more than Windows asks at import
real_select = select.select

def select_sockets(readers, writers, others, timeout=None):
    for each in (*readers, *writers, *others):
        if not stat.S_ISSOCK(os.fstat(each if isinstance(each, int) else each.fileno()).st_mode):
            raise OSError(10038, "an operation was attempted on something that is not a socket")
    return real_select(readers, writers, others, timeout)

select.select = select_sockets
del socket.AF_UNIX, signal.SIGHUP, signal.SIGKILL, signal.SIGUSR1, select.poll, select.POLLIN, select.POLLOUT
del signal.pidfd_send_signal
for name in (
    "O_CLOEXEC", "O_NONBLOCK", "O_DIRECTORY", "O_NOFOLLOW", "O_SYNC", "fdatasync", "fork", "openpty", "getuid",
    "geteuid", "killpg", "getpgid", "setsid", "pread", "pwrite", "mkfifo", "sched_getaffinity",
    "sched_setaffinity", "statvfs", "posix_fadvise", "ttyname", "set_blocking", "isatty", "pidfd_open",
):
    delattr(os, name)
"""
LOCKING = """
# msvcrt.locking as Python documents it: bytes from where the file is, OSError where another handle has them
def locking(descriptor, mode, count):
    kind = real.F_UNLCK if mode == 0 else real.F_WRLCK
    real.fcntl(descriptor, real.F_OFD_SETLK, struct.pack("hhqqi4x", kind, os.SEEK_CUR, 0, count, 0))

sys.modules["msvcrt"] = types.SimpleNamespace(LK_UNLCK=0, LK_LOCK=1, LK_NBLCK=2, locking=locking)
"""
PAIRS = """
def socketpair():  # over TCP, as Python has it on Windows
    with socket.create_server(("127.0.0.1", 0)) as listener:
        near = socket.create_connection(listener.getsockname())
        far, _ = listener.accept()
    return near, far

socket.socketpair = socketpair
"""
HIDDEN = _LIGHT + "import joblib, pandas\n" + _HIDES
PROCESSES = """
# handles of processes as Windows has them, by the numbers that it gives and takes
import os, select, signal, subprocess, sys, types
pidfd_open, send_signal, wait_for, close = os.pidfd_open, signal.pidfd_send_signal, select.select, os.close
start, end = subprocess.Popen.__init__, signal.SIGKILL

def wait_for_single_object(handle, milliseconds):
    return 0 if wait_for([handle], [], [], milliseconds / 1e3)[0] else 258

def started(process, *words, pass_fds=(), start_new_session=False, **options):
    assert not pass_fds and not start_new_session, "Windows has neither"
    start(process, *words, **options)

sys.modules["_winapi"] = types.SimpleNamespace(
    OpenProcess=lambda access, inherited, pid: pidfd_open(pid),
    TerminateProcess=lambda handle, code: send_signal(handle, end),
    WaitForSingleObject=wait_for_single_object,
    CloseHandle=close,
)
subprocess.Popen.__init__ = started
subprocess.Popen.kill = lambda process: process.send_signal(end)
"""
WINDOWS = PROCESSES + _LIGHT + _HIDES + LOCKING + PAIRS


def hidden_alike(folder: Path) -> dict[str, str]:
    """Return an environment in which every Python process begins by hiding; it says so in `folder/hidden`."""
    said = f"open({str(folder / 'hidden')!r}, 'a').write(' '.join(sys.orig_argv) + chr(10))"
    (folder / "sitecustomize.py").write_text(f"{WINDOWS}\n{said}\n", encoding="utf-8")
    return os.environ | {"PYTHONPATH": str(folder), "USERNAME": "somebody"}


def said(code: str, folder: Path, *words: str) -> str:
    """Return what code prints that runs in a process of its own, in `folder`."""
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=folder,
        env=os.environ | {"USERNAME": "somebody", "XDG_STATE_HOME": str(folder / "state")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
