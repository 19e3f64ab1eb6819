"""The commands `gyrobench frames ...`: gyros described by a file, and whether a description is right."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option, Typer

from bench.present.cli._console import Terminal
from bench.present.cli._options import Json
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from drivers.frames import Form, FrameFamily

app = Typer(name="frames", no_args_is_help=True)

_RANDOM_BYTES = 1e9


@app.command("list")
def list_(as_json: Json = False) -> None:
    """List the descriptions that come with gyrobench."""
    from drivers.frames import load_family, shipped

    rows = []
    for name in shipped():
        family = load_family(name)
        forms = [form.name for form in family.forms if form.measures]
        shown = ", ".join(forms[:4]) + (f" and {len(forms) - 4} more" if len(forms) > 4 else "")
        rows.append((name, family.description.title, shown, family.description.source))
    console = Terminal(as_json=as_json)
    console.table(("name", "gyro", "messages with rates", "source"), rows)
    heads = ("name", "gyro", "messages", "source")
    console.say_json("result", descriptions=[dict(zip(heads, row, strict=True)) for row in rows])


@app.command()
def check(
    description: Annotated[str, Argument(help="a TOML file, or a name that `frames list` shows")],
    capture: Annotated[
        Path | None, Argument(help="bytes of such a gyro, as recorded: raw/<gyro>.bin, or any file")
    ] = None,
    out: Annotated[Path, Option(help="folder for the tables and the plot of a capture")] = Path(),
    parquet: Annotated[bool, Option("--parquet", help="tables as Parquet instead of CSV")] = False,
    settings: Annotated[
        list[str] | None,
        Option("--set", "-s", help="how the unit was set up, as name=choice; repeat for several"),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check a description; decode a capture with it.

    Its vectors are decoded, and a capture is decoded into tables and a plot.
    """
    from bench.present.cli._settings import parse_settings
    from drivers.frames import choices_of, load_family, refusal, vector_mistakes

    console, chosen = Terminal(as_json=as_json), parse_settings(settings or [])
    family = load_family(description, chosen)
    if mistakes := list(vector_mistakes(family)):
        raise refusal(family.where, mistakes)
    for choices in choices_of(family.description):
        family.set_up(choices)
    _show(console, family, chosen)
    decoded = None if capture is None else _decode(console, family, capture, out, parquet)
    messages = [{"name": form.name, "false_per_byte": form.false_per_byte} for form in family.forms]
    vectors = len(family.description.vector)
    console.say_json(
        "result", description=family.description.name, messages=messages, vectors=vectors, capture=decoded
    )


def _show(console: Terminal, family: FrameFamily, settings: Mapping[str, str]) -> None:
    from drivers.frames import LineDescription

    about = family.description
    console.say(f"{about.name}: {about.title}")
    rows = []
    for form in family.forms:
        if isinstance(about, LineDescription):
            heads, size = about.line.start or "-", f"{about.line.columns} columns"
            kinds: str = about.line.checksum.kind if about.line.checksum else "none"
        else:
            size = str(form.length) if form.length is not None else f"{form.shortest} to {form.longest}"
            kinds = ", ".join(check.kind for check in form.checksums) or "none"
            heads = " or ".join(sync.hex(" ") for sync in form.syncs)
        false_frames = f"{_RANDOM_BYTES * form.false_per_byte:.2g}"
        rows.append((form.name, heads, size, kinds, _channels(form), false_frames))
    console.table(
        ("message", "begins with", "bytes", "check", "gyro channels", "false frames in 1e9 random bytes"),
        rows,
    )
    for name, setting in about.setting.items():
        chosen = settings.get(name, setting.default)
        others = ", ".join(choice for choice in setting.choice if choice != chosen)
        console.say(f"setting {name} = {chosen} (or {others}): {setting.what}")
    weak = sum(form.false_per_byte for form in family.forms if form.measures)
    if _RANDOM_BYTES * weak > 1.0:
        console.say(
            f"note: head and check together let {_RANDOM_BYTES * weak:.3g} frames with rates pass in 1e9 random "
            "bytes; on a noisy line name the message (frame_format) or use a longer check"
        )
    console.say(
        f"vectors: {len(about.vector)} right, and every single-bit flip of them that a check covers noticed"
        if about.vector
        else "no vectors: nothing says that this description fits a real unit"
    )


def _channels(form: Form) -> str:
    from drivers.frames import GYRO_ROLES

    axes_of: dict[tuple[str, str], str] = {}
    for spec in form.fields:
        if spec.role in GYRO_ROLES:
            kind = (spec.role.replace("_", " "), spec.unit)
            axes_of[kind] = axes_of.get(kind, "") + (spec.axis or "")
    return "; ".join(f"{role} {axes}, {unit}" for (role, unit), axes in axes_of.items())


def _decode(
    console: Terminal, family: FrameFamily, path: Path, out: Path, parquet: bool
) -> dict[str, object]:
    from bench.record.capture import read_capture, write_plot, write_table

    capture = read_capture(family, path)
    if not capture.tables:
        raise ConfigurationError(
            "there is no message of this description in the capture",
            where=str(path),
            found=f"{capture.size} bytes that begin with {capture.head.hex(' ')}"
            if capture.size
            else "an empty file",
            expected=f"messages of {family.description.title}",
            remedy=_remedy(path),
        )
    out.mkdir(parents=True, exist_ok=True)
    for name, columns in capture.tables.items():
        target = out / f"{path.stem}_{name}.{'parquet' if parquet else 'csv'}"
        write_table(target, columns)
        console.say(f"{len(next(iter(columns.values()), ()))} {name}: {target}")
    rejected = ", ".join(f"{n} by {why}" for why, n in capture.counts.rejected.items()) or "none"
    console.say(
        f"{capture.size} bytes: {capture.counts.bytes_skipped} skipped, {capture.pending} left of an unfinished "
        f"message, candidates rejected: {rejected}"
    )
    console.say_all(capture.counter_notes)
    plot = out / f"{path.stem}.png"
    if write_plot(plot, family, capture):
        console.say(f"plot: {plot}")
    return {
        "bytes": capture.size,
        "skipped": capture.counts.bytes_skipped,
        "rejected": dict(capture.counts.rejected),
        "rows": {name: len(next(iter(columns.values()), ())) for name, columns in capture.tables.items()},
        "notes": list(capture.counter_notes),
    }


def _remedy(path: Path) -> str:
    """Return what to do about a capture of another device; if one of ours fits, which."""
    from bench.record.exchange import fitting_description

    if fits := fitting_description(path):
        return f"`gyrobench frames check {fits}` fits it"
    return "check that the capture is of this device, and that it was taken at the right baud rate"
