"""`gyrobench` and `python -m gyrobench`: the command line of `bench.present.cli`."""

from __future__ import annotations

import sys

from gyrobench._rooms import check_rooms


def main() -> None:
    """Run the command line; a folder of the user's in place of one of our packages is exit code 2."""
    try:
        check_rooms()
    except ImportError as error:
        sys.exit(_refused(str(error)))
    from bench.present.cli import main as command_line

    command_line()


def _refused(text: str) -> int:
    print(f"error: {text}", file=sys.stderr)  # noqa: T201 - rich may be hidden too
    return 2


if __name__ == "__main__":
    main()
