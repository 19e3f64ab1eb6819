"""Switching units off and on in a test: by a supply where one feeds them, else by hands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bench.control.instrument_station import fed_units, switch_units
from bench.control.session import Bench
from bench.control.stream_stations import GyroStation

_STREAMS_S = 10.0
"""A unit whose last sample is older than this is silent."""
_BACK_S = 300.0


def power_cycle(bench: Bench, which: str, off_s: float) -> None:
    """Have the units switched off and on, and wait until all of them stream again; the run is invalid if not.

    Supplies do it for the units that they feed; the operator is asked to do it for the others.
    """
    fed = fed_units(bench.instruments.supplies)
    by_hand = [name for name in (*bench.gyros, *bench.platforms) if name not in fed]
    before = {name: gyro.frames for name, gyro in _living(bench).items()}

    def back() -> bool:
        return all(
            gyro.frames > before[name] and bench.now_s - gyro.history.last["time_s"] < _STREAMS_S
            for name, gyro in _living(bench).items()
        )

    with bench.units_off():
        asked_s = bench.now_s
        switch_units(bench.instruments.supplies, False)
        if by_hand:
            units = "the units" if not fed else ", ".join(by_hand)
            more: dict[str, Any] = {"units": by_hand} if fed else {}
            bench.ask(
                f"Switch {units} off, wait {off_s:.0f} s, switch them on again ({which}). Done?",
                act="power_cycle",
                off_s=off_s,
                **more,
            )
        if fed:
            bench.wait(off_s - (bench.now_s - asked_s), f"units off ({which})")
            switch_units(bench.instruments.supplies, True)
        asked_s = bench.now_s
        # An emulated unit goes off with the answer; a real one is on again by then.
        bench.wait(min(off_s, 2.0 * _STREAMS_S), "power cycle")
        on = bench.wait_until(back, timeout_s=off_s + _BACK_S, what="units to stream again")
    if not on:
        silent = [
            n for n, g in _living(bench).items() if bench.now_s - g.history.last["time_s"] >= _STREAMS_S
        ]
        bench.invalidate(
            f"{', '.join(silent)} did not stream again within {bench.now_s - asked_s:.0f} s of {which}",
            "unit_stays_off",
            devices=silent,
            waited_s=bench.now_s - asked_s,
        )


def _living(bench: Bench) -> Mapping[str, GyroStation]:
    """Return the gyros whose port is open, up to date."""
    for gyro in bench.gyros.values():
        gyro.update()
    return {name: gyro for name, gyro in bench.gyros.items() if not gyro.gone}
