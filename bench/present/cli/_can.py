"""The commands `gyrobench can ...`: gyros on CAN, and whether a DBC file and its mapping are right."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option, Typer

from bench.present.cli._console import Terminal
from bench.present.cli._options import Json
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from drivers.can_dbc import CanLayout

app = Typer(name="can", no_args_is_help=True)


@app.command("list")
def list_(as_json: Json = False) -> None:
    """List the layouts that come with gyrobench."""
    from drivers.can_dbc import load_layout, shipped_layouts

    rows = []
    for name in shipped_layouts():
        layout = load_layout(name)
        slots = ", ".join(slot.message for slot in layout.sample)
        rows.append((name, f"{layout.maker} {layout.model}".strip(), slots, "".join(layout.rates())))
    console = Terminal(as_json=as_json)
    console.table(("name", "unit", "messages of a sample", "axes"), rows)
    heads = ("name", "unit", "messages", "axes")
    console.say_json("result", layouts=[dict(zip(heads, row, strict=True)) for row in rows])


@app.command()
def check(
    layout: Annotated[str, Argument(help="a mapping file (TOML), or a name that `can list` shows")],
    capture: Annotated[
        Path | None,
        Argument(help="a log of the bus (.log, .asc, .blf, .trc, .csv, .mf4), or slcan text: raw/<gyro>.bin"),
    ] = None,
    out: Annotated[Path, Option(help="folder for the table and the plot of a capture")] = Path(),
    parquet: Annotated[bool, Option("--parquet", help="the table as Parquet instead of CSV")] = False,
    source_address: Annotated[
        int | None, Option(min=0, max=253, help="the J1939 address of the unit; default any")
    ] = None,
    as_json: Json = False,
) -> None:
    """Check a mapping against its DBC; decode a capture with it.

    A capture is decoded into a table and a plot.
    """
    from drivers.can_dbc import load_layout

    console, loaded = Terminal(as_json=as_json), load_layout(layout)
    _show(console, loaded)
    decoded = None if capture is None else _decode(console, loaded, capture, out, parquet, source_address)
    uses = [
        {"message": use.message, "signal": use.signal, "is": f"{use.role} {use.axis}".strip()}
        for use in loaded.uses
    ]
    console.say_json("result", layout=loaded.name, dbc=loaded.dbc, signals=uses, capture=decoded)


def _show(console: Terminal, layout: CanLayout) -> None:
    from drivers.can_dbc import identifier_names

    unit = f"{layout.maker} {layout.model}".strip()
    console.say(f"{layout.name}: {unit}, {layout.dbc}")
    rows = []
    for use in layout.uses:
        message, signal = layout.messages[use.message], layout.signal(use)
        kind = "f" if signal.is_float else "i" if signal.signed else "u"
        held = "" if layout.slot_of(use) is not None else " (held)"
        scale = f"{signal.scale * use.factor:.6g}"
        unit = {"rate": " deg/s", "delta_angle": " deg", "accel": " m/s2", "time": " s"}.get(use.role, "")
        unit = " K" if "temperature" in use.role else unit
        row = (
            use.message,
            identifier_names({(message.identifier, message.extended)}),
            str(message.length),
            use.signal,
            f"{use.role} {use.axis}".strip().replace("_", " ") + held,
            f"{kind}{signal.bits} {'big' if signal.big_endian else 'little'}",
            "-" if use.role == "status" else scale + unit,
        )
        rows.append(row)
    console.table(("message", "identifier", "bytes", "signal", "is", "type", "resolution"), rows)
    for rule in layout.valid:
        axis = f" for {rule.axis}" if rule.axis else ""
        console.say(f"valid{axis}: {rule.message}.{rule.signal} & {rule.mask:#x} = {rule.equals:#x}")
    if layout.use("time", "counter") is None:
        console.say("note: without time or counter lost samples cannot be told")


def _decode(
    console: Terminal, layout: CanLayout, path: Path, out: Path, parquet: bool, source_address: int | None
) -> dict[str, object]:
    from bench.record.capture import others_on_the_bus, read_can_capture, write_can_plot, write_table
    from drivers.can_dbc import identifier_names

    capture = read_can_capture(layout, path, source_address)
    others = others_on_the_bus(layout, capture)
    if not capture.columns or not len(capture.columns["counter"]):
        wanted = {
            (layout.messages[slot.message].identifier, layout.messages[slot.message].extended)
            for slot in layout.sample
        }
        seen = identifier_names(set(sorted(capture.identifiers)[:12]))
        raise ConfigurationError(
            "there is no sample of this layout in the capture",
            where=str(path),
            found=f"{capture.frames} CAN frames with identifiers {seen}" if seen else "no CAN frame",
            expected=f"frames {identifier_names(wanted)}, one behind the other",
            remedy="check that the capture is of this unit, and `sample` in the mapping",
        )
    out.mkdir(parents=True, exist_ok=True)
    target = out / f"{path.stem}_{layout.name}.{'parquet' if parquet else 'csv'}"
    write_table(target, capture.columns)
    valid = capture.columns["valid"]
    console.say(f"{len(valid)} samples, {int((~valid).sum())} not valid: {target}")
    rejected = (
        ", ".join(f"{count} {why.replace('_', ' ')}" for why, count in capture.rejected.items()) or "none"
    )
    left_out = "".join(f", {count} {kind} left out" for kind, count in capture.left_out.items())
    console.say(f"{capture.frames} CAN frames{left_out}; rejected: {rejected}")
    console.say_all(capture.notes)
    if others:
        console.say(f"identifiers that the DBC file does not have: {others}")
    plot = out / f"{path.stem}.png"
    write_can_plot(plot, layout, capture.columns)
    console.say(f"plot: {plot}")
    return {
        "frames": capture.frames,
        "samples": len(valid),
        "not_valid": int((~valid).sum()),
        "rejected": dict(capture.rejected),
        "notes": list(capture.notes),
        "table": target,
    }
