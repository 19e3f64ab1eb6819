"""A process that reads a DBC file with cantools within bounds of memory and time: no bound in cantools holds.

A DBC file of a hundred characters can ask for a table of 2**40 entries. The file comes on standard input; its
messages, or what is wrong with it, go to standard output as JSON. Started by its path (`_dbc.load_database`): it
imports nothing of ours, which would take longer than all the rest.
"""

import json
import sys
from typing import Any

_OF_MESSAGE = ("name", "frame_id", "is_extended_frame", "length")
_OF_SIGNAL = (
    *("name", "start", "length", "byte_order", "is_signed", "is_float", "unit"),
    *("multiplexer_ids", "multiplexer_signal"),
)


def main(memory_bytes: int, cpu_s: int) -> int:
    """Read one file; 1 if it cannot be read. Beyond `cpu_s` the kernel ends the process."""
    import resource  # POSIX, and of this process alone: `messages_in` is imported elsewhere

    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    sys.modules["asammdf"] = None  # type: ignore[assignment]  # see drivers/kit/python_can.py
    import cantools

    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    try:
        found = json.dumps(messages_in(sys.stdin.buffer.read()))
    except (
        *(ValueError, ArithmeticError, LookupError, TypeError, AttributeError, MemoryError, RecursionError),
        cantools.Error,
    ) as error:
        sys.stdout.write(json.dumps(_why(error, memory_bytes)) + "\n")
        return 1
    sys.stdout.write(found + "\n")
    return 0


def messages_in(content: bytes) -> list[dict[str, Any]]:
    """Return the messages of a DBC file as plain values; raises whatever cantools does."""
    import cantools

    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    database = cantools.database.load_string(text, database_format="dbc", prune_choices=False)
    return [_plain(message) for message in database.messages]


def _why(error: BaseException, memory_bytes: int) -> str:
    error = getattr(error, "e_dbc", None) or error  # cantools wraps whatever it meets
    if isinstance(error, MemoryError):
        return f"more than {memory_bytes >> 20} MiB of memory to read it"
    return (str(error) or type(error).__name__)[:1000]


def _plain(message: Any) -> dict[str, Any]:
    plain = {name: getattr(message, name) for name in _OF_MESSAGE}
    plain["signals"] = [
        {name: getattr(signal, name) for name in _OF_SIGNAL}
        | {"scale": float(signal.scale), "offset": float(signal.offset)}
        for signal in message.signals
    ]
    return plain


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
