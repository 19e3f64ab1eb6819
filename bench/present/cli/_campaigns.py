"""The commands `gyrobench campaign ...`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from bench.present.cli._options import Cluster

app = typer.Typer(
    name="campaign",
    help="Many runs from one file: plan, run, resume, watch, rehearse, fit.",
    no_args_is_help=True,
)

CampaignFile = Annotated[Path, typer.Argument(help="campaign file (TOML)", metavar="FILE")]
Folder = Annotated[Path, typer.Argument(help="the campaign's folder")]
Bench = Annotated[Path, typer.Option("--bench", help="bench file (TOML)", show_default=True)]
PlantFile = Annotated[
    Path | None, typer.Option("--plant", help="plant file (TOML): physics behind the emulated devices")
]
Seed = Annotated[int | None, typer.Option("--seed", help="seed of the emulated lab")]
Yes = Annotated[bool, typer.Option("--yes", help="answer operator questions beforehand")]
Json = Annotated[
    bool, typer.Option("--json", help="for machines: one JSON object a line, the last one the result")
]
DEFAULT_BENCH = Path("lab.toml")


@app.command("plan")
def plan(
    campaign: CampaignFile,
    bench: Bench = DEFAULT_BENCH,
    out: Annotated[Path, typer.Option(help="folder that the campaign will have; its disk is checked")] = Path(
        "campaign"
    ),
    plant: PlantFile = None,
    seed: Seed = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="the procedures' own estimates, without a rehearsal")
    ] = False,
    json: Json = False,
) -> None:
    """Print the schedule, chamber hours and bytes on disk; refuse what a limit forbids. Nothing moves."""
    from bench.present.cli._campaign_plan import plan_command

    sys.exit(plan_command(campaign, bench, out, plant, seed, quick, json))


@app.command("run")
def run(
    campaign: CampaignFile,
    bench: Bench = DEFAULT_BENCH,
    out: Annotated[Path, typer.Option(help="new folder for the campaign")] = Path("campaign"),
    emulated: Annotated[
        bool, typer.Option("--emulated", help="on emulated labs that match the bench file")
    ] = False,
    plant: PlantFile = None,
    seed: Seed = None,
    ask: Annotated[
        bool, typer.Option("--ask", help="with --emulated: put the questions to a human all the same")
    ] = False,
    yes: Yes = False,
    json: Json = False,
) -> None:
    """Run a campaign on the bench, one run after the other; `resume` goes on after a stop."""
    from bench.present.cli._campaign import run_command

    sys.exit(
        run_command(
            campaign,
            bench,
            out,
            emulated=emulated,
            plant_file=plant,
            seed=seed,
            ask=ask,
            yes=yes,
            as_json=json,
        )
    )


@app.command("resume")
def resume(folder: Folder, yes: Yes = False, json: Json = False) -> None:
    """Go on at the first run that is not complete, after a check that the bench is in a known state."""
    from bench.present.cli._campaign import resume_command

    sys.exit(resume_command(folder, yes=yes, as_json=json))


@app.command("status")
def status(folder: Folder, json: Json = False) -> None:
    """Show how far a campaign is, from any shell; reads files only."""
    from bench.present.cli._campaign import status_command

    sys.exit(status_command(folder, json))


@app.command("rehearse")
def rehearse(
    campaign: CampaignFile,
    bench: Bench = DEFAULT_BENCH,
    out: Annotated[Path, typer.Option(help="new folder for runs, compensation and report")] = Path(
        "campaign"
    ),
    plant: PlantFile = None,
    seed: Seed = None,
    jobs: Annotated[int | None, typer.Option(help="runs at the same time; default one a processor")] = None,
    cluster: Cluster = None,
    json: Json = False,
) -> None:
    """Run a whole campaign on emulated labs, fit the compensation and write the report."""
    from bench.present.cli._campaign_rehearse import rehearse_command

    sys.exit(rehearse_command(campaign, bench, out, plant, seed, jobs, json, cluster))
