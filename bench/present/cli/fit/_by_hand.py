"""`gyrobench fit calibration --by-hand`: an IMU from a log in which it was turned by hand."""

from __future__ import annotations

import json
from pathlib import Path

from bench.present.cli._console import Terminal


def by_hand(
    console: Terminal, record: Path, out: Path, *, gravity: float | None, turn_deg: float | None
) -> None:
    """Calibrate, write the compensation and print what was found."""
    from bench.analysis.calibration import PARAMETER_NAMES, calibrate_by_hand, load_hand_record
    from bench.analysis.common.state_file import save_file, saved_together
    from bench.record.recording import checksum
    from drivers.base.constants import gravity_mps2

    given, latitude_deg, log = load_hand_record(record)
    size = gravity_mps2(latitude_deg, 0.0) if gravity is None else gravity
    with console.status(f"{len(given.rate_dps):,} samples"):
        found = calibrate_by_hand(
            given, gravity_mps2=size, turn_deg=turn_deg, runs={log.stem: checksum(log).sha256}
        )
    facts = found.compensation.describe()
    with saved_together(out) as part:
        found.compensation.save(part / "compensation.gyrocomp")
        save_file(part / "calibration.json", json.dumps(facts, indent=2))
    rows = []
    for name in PARAMETER_NAMES[:-3]:
        value = facts["parameters"][name]
        rows.append((name, f"{value['value']:.4g}", f"{value['sigma']:.2g}", value["unit"]))
    console.table(("parameter", "estimate", "1 sigma", "unit"), rows, f"unit {given.unit_id}, turned by hand")
    console.say(f"{found.rests} rests, {found.turns} turns; {found.left_out} left out (range or gaps)")
    for what, unit, (before, after) in (
        ("specific force less gravity at rest", "m/s^2", found.gravity_rms_mps2),
        ("gravity's direction over a turn", "deg", found.direction_rms_deg),
    ):
        console.say(f"{what}: {before:.3g} -> {after:.3g} {unit} rms")
    if turn_deg is not None:
        before, after = found.angle_rms_deg
        console.say(f"turns by {turn_deg:g} deg: {before:.3g} -> {after:.3g} deg rms")
    console.say_all((f"note: {text}" for text in found.compensation.declared), style="yellow")
    console.say(f"{out}/compensation.gyrocomp, calibration.json")
    console.say_json(
        "result",
        compensation=facts,
        rests=found.rests,
        turns=found.turns,
        left_out=found.left_out,
        rms={
            "gravity_mps2": found.gravity_rms_mps2,
            "direction_deg": found.direction_rms_deg,
            "turn_deg": None if turn_deg is None else found.angle_rms_deg,
        },
        folder=out,
    )
