"""`gyrobench fit chamber-cycle`: a chamber cycle that somebody else recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def chamber_cycle(
    log: Annotated[Path, typer.Argument(help="tab-separated table: imu.gyro.x|y|z, imu.temperature")],
    out: Annotated[Path, typer.Option(help="HTML report")] = Path("chamber-cycle.html"),
) -> None:
    """Regression over temperature on a recorded chamber cycle, judged axis by axis on its last leg."""
    from rich.table import Table

    from bench.analysis.rlg import load_chamber_cycle, study_chamber_cycle
    from bench.present.cli._console import Terminal
    from bench.present.report import chamber_cycle_page, write_report
    from bench.record.recording import checksum
    from drivers.base.clock import utc_now

    study = study_chamber_cycle(*load_chamber_cycle(log))
    page = chamber_cycle_page(study, source=log.name, checksum=checksum(log).sha256, created_utc=utc_now())
    write_report(out, page)
    table = Table("axis", "before", "T only", "gain %", "T, rate, past", "gain %",
                  title=f"1 sigma of {log.name} on its last leg")  # fmt: skip
    for axis in study.axes:
        table.add_row(
            axis.axis,
            f"{axis.before:.4g}",
            f"{axis.after_static:.4g}",
            f"{axis.static_pct:.1f}",
            f"{axis.after_dynamic:.4g}",
            f"{axis.dynamic_pct:.1f}",
        )
    console = Terminal()
    console.print(table)
    for axis in study.axes:
        console.say(f"{axis.axis}: {axis.verdict}")
    for remark in study.remarks:
        console.say(remark, style="yellow")
    console.say(f"{out}")
