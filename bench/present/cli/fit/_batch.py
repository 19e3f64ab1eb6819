"""`gyrobench fit cold-shock --batch`: a model common to several units, each with corrections of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.present.cli._console import Terminal
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError


def unit_folder(out: Path, unit: str) -> Path:
    """Return the folder of a unit's files: its id, with an underscore for what is no letter, digit or -_. of
    it."""
    return out / "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in unit)


def cold_shock_of_batch(
    console: Terminal,
    runs: Sequence[Path],
    validate: Sequence[Path],
    test: Sequence[Path],
    gyro: str | None,
    names: Sequence[str] | None,
    out: Path,
    jobs: int | None,
    cluster: str | None,
) -> None:
    """Fit, write a compensation for every unit and one for a unit without runs, and tell."""
    from bench.analysis.common.fan_out import fan_out
    from bench.analysis.common.state_file import saved_together
    from bench.analysis.export import export_compensation
    from bench.analysis.thermal import study_batch
    from bench.present.report import batch_page, batch_sentence, write_report

    if validate:
        raise ConfigurationError(
            "a batch has no validation run",
            where="fit cold-shock --batch",
            found=f"--validate {validate[0]}",
            expected="units left out in turn choose the model",
            remedy="name the run without --validate, or with --test",
        )
    with console.status("fitting the batch"), fan_out(jobs, cluster) as fan:
        study = study_batch(runs, test, gyro, names, fan=fan)
    for unit, compensation in study.compensations.items():
        with saved_together(unit_folder(out, unit)) as part:
            export_compensation(compensation, part)
    with saved_together(out) as part:
        export_compensation(study.common, part)
        write_report(part / "report.html", batch_page(study, created_utc=utc_now()))
    targets = list(study.scores[study.chosen])
    heads = ["model", *(f"{target}, {how}" for target in targets for how in ("no own run", "one own run"))]
    rows = [
        [
            name,
            *(f"{100.0 * value:.1f}" for t in targets for value in (scores[t].without, scores[t].with_one)),
        ]
        for name, scores in study.scores.items()
    ]
    console.table(heads, rows, "% left of units left out")
    console.say_all(batch_sentence(study, target) for target in targets)
    console.say(f"common model {study.chosen}; a folder for each of {len(study.units)} units in {out}")
    if own := study.known_by_themselves:
        console.say(
            f"three own runs or more: {', '.join(own)}; a fit without --batch is likely to be better there"
        )
    units = {
        unit: {
            "runs": [run.run_id for run in of],
            "determined": study.determined[unit],
            "folder": unit_folder(out, unit),
        }
        for unit, of in study.units.items()
    }
    console.say_json(
        "result", chosen=study.chosen, scores=study.scores, units=units, judged=study.judged, folder=out
    )
