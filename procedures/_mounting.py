"""How a test with the axis along the table's axis begins: the units mounted, table and chamber on."""

from __future__ import annotations

from bench.control.session import Bench


def begin_axis_up(bench: Bench, room_c: float) -> None:
    """Have the units mounted with the axis under test up, engage the table, and hold the air at `room_c`."""
    bench.ask(
        f"{bench.table.mounting_text}Mount the units with the sensitive axis of {bench.judge.name} up along "
        "the table's axis and the cable through the slip ring. Close the chamber. Ready?",
        act="mount",
        mounting="axis_up",
    )
    bench.table.engage()
    bench.chamber.go_to(room_c)
    bench.chamber.start()
