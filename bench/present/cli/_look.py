"""`gyrobench look`: what is in anybody's log, and how its gyros and accelerometers behave."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, BadParameter, Option, Typer

from bench.present.cli._options import Json

if TYPE_CHECKING:
    from bench.analysis.look import AxisLook, HalfDifference, Look
    from bench.present.cli._console import Terminal

app = Typer()
_MOST_LINES = 3


@app.command()
def look(
    log: Annotated[Path, Argument(help="text, Parquet, MAT, NPY, NPZ, HDF5, MDF, or a unit's bytes")],
    column: Annotated[
        list[str] | None, Option(help="KIND=NAME,NAME: gyro, accelerometer, temperature, time; * in names")
    ] = None,
    unit: Annotated[list[str] | None, Option(help="NAME=UNIT, e.g. 'g*=0.0305 deg/s'")] = None,
    rate: Annotated[
        float | None, Option(help="samples a second, where no column has the time", min=1e-6)
    ] = None,
    still: Annotated[bool, Option("--still", help="the unit never turned")] = False,
    separator: Annotated[str, Option(help="of text: comma, semicolon, tab, blank, or the character")] = "",
    skip: Annotated[int | None, Option(help="lines of text before the first row", min=0)] = None,
    table: Annotated[str, Option(help="table in a MAT, NPZ or HDF5 file, message of --frames")] = "",
    dbc: Annotated[list[Path] | None, Option(help="DBC file for the CAN frames of an MDF file")] = None,
    frames: Annotated[
        str, Option(help="the log is bytes as the unit sent them: description of its frames, name or file")
    ] = "",
    write: Annotated[
        Path | None, Option(help="folder for a mapping and a nominal's noise for each gyro; needs --latitude")
    ] = None,
    latitude: Annotated[float | None, Option(help="of the recording, deg", min=-90.0, max=90.0)] = None,
    unit_id: Annotated[
        str, Option(help="serial number of the unit, for --write; default the log's name")
    ] = "",
    turned: Annotated[
        Path | None, Option(help="log of the same unit turned over: bias and half difference of every axis")
    ] = None,
    report: Annotated[Path | None, Option(help="HTML file for the report")] = None,
    as_json: Json = False,
) -> None:
    """Look at a log of gyros and accelerometers, axis by axis."""
    from bench.analysis.look import LookOptions, half_differences, write_files
    from bench.analysis.look import look as look_at
    from bench.present.cli._console import Terminal

    if write is not None and latitude is None:
        raise BadParameter("--write needs --latitude: it is not in a log, and a mapping must have it")
    console = Terminal(as_json=as_json)
    options = LookOptions(
        separator=separator,
        skip=skip,
        group=table,
        dbc=tuple(dbc or ()),
        frames=frames,
        rate_hz=rate,
        columns=tuple(column or ()),
        units=tuple(unit or ()),
        still=still,
    )
    with console.status(f"looking at {log.name}"):
        looked = look_at(log, options)
        pair = half_differences(looked, look_at(turned, options), latitude) if turned else ()
    _say(console, looked)
    if turned:
        _say_pair(console, pair, f"{log.name} and {turned.name}, turned over")
    files = [] if write is None or latitude is None else write_files(
        looked, write, latitude_deg=latitude, unit_id=unit_id
    )  # fmt: skip
    if report is not None:
        from bench.present.report import look_page, write_report
        from bench.record.recording import checksum
        from drivers.base.clock import utc_now

        page = look_page(looked, checksum=checksum(log).sha256, created_utc=utc_now())
        files.append(write_report(report, page))
    console.say_all(files, soft_wrap=True)
    console.say_json(
        "look",
        **looked.facts(),
        half_differences=[vars(axis) for axis in pair],
        files=[str(path) for path in files],
    )


def _say(console: Terminal, found: Look) -> None:
    from bench.present.look_words import clock_words, motion_words, noise_words, nyquist_words

    console.say(clock_words(found))
    console.say(motion_words(found))
    console.say_all((f"  {remark}" for remark in found.remarks), style="dim")
    console.say_all((f"  not known: {question}" for question in found.questions), style="yellow")
    heads = ("axis", "unit", "mean", "1 sigma", "drift a hour")
    console.table(heads, [_row(axis) for axis in found.axes], found.log.name)
    for axis in found.axes:
        console.parts((axis.channel.name, "bold"), f": {noise_words(axis)}")
        console.say_all(f"  {sentence}" for sentence in _noticed(axis))
    console.say(nyquist_words(found), style="dim")


def _say_pair(console: Terminal, pair: Sequence[HalfDifference], title: str) -> None:
    rows = [
        (
            axis.name,
            axis.unit,
            f"{axis.bias:.5g}",
            f"{axis.half_difference:.5g}",
            f"{axis.sigma:.2g}",
            "-" if axis.earth_rate is None else f"{axis.earth_rate:.4g}",
        )
        for axis in pair
    ]
    console.table(("axis", "unit", "bias", "half difference", "1 sigma", "Earth rate there"), rows, title)
    console.say(
        "1 sigma is that of the records' noise: a bias that changed between them is not seen", style="dim"
    )


def _row(axis: AxisLook) -> tuple[str, ...]:
    figures = axis.figures
    return (
        axis.channel.name,
        axis.channel.base_unit,
        f"{figures.mean:.5g} +- {figures.mean_sigma:.2g}",
        f"{figures.sigma:.3g}",
        f"{figures.drift_per_h:.3g} +- {figures.drift_sigma:.2g}" if axis.clock_known else "-",
    )


def _noticed(axis: AxisLook) -> list[str]:
    """Return what was noticed on an axis, a line each; lines of its spectrum the largest first."""
    from bench.present.look_words import frequency_unit, noticed

    lines = sorted(axis.spectrum.lines if axis.spectrum else (), key=lambda line: -line.amplitude)
    more = f" and {len(lines) - _MOST_LINES} more" if len(lines) > _MOST_LINES else ""
    named = ", ".join(f"{line.frequency_hz:.5g}" for line in lines[:_MOST_LINES])
    unit = frequency_unit(clock_known=axis.clock_known)
    return [*([f"lines at {named} {unit}{more}"] if lines else []), *noticed(axis)]
