"""The same searches through bytes: `gap hunt` itself on emulated labs; one killed at random, again and again."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

from bench.analysis.gap import model_text
from bench.campaign import CampaignFolder, CampaignRunner
from bench.campaign.hunt import ALIKE, Hunt, HuntSettings, begin_hunt, fewest, steps_of
from benchmarks.hunt._cases import Case, is_right
from benchmarks.hunt._plants import NOMINAL, FibreOptic
from benchmarks.hunt._seek import BUDGET_H, UNTIL, Searched, Step, among
from benchmarks.hunt._strategies import SEARCH
from drivers.base.clock import host_seconds

KILLS = 10


def begun(plant: FibreOptic, case: Case, root: Path) -> Hunt:
    """Begin a search for what a unit has on emulated labs, in a folder."""
    root.mkdir(parents=True, exist_ok=True)
    truth = root / "truth.toml"
    truth.write_text(model_text(plant.truth(case.gap)), encoding="utf-8")
    settings = HuntSettings(budget_h=BUDGET_H, until=UNTIL)
    emulated = plant.plant(truth, case.seed)
    return begin_hunt(root / "out", plant.file, NOMINAL, settings, plant=emulated)


def through_bytes(plant: FibreOptic, case: Case, root: Path) -> Searched:
    """Search through bytes in one go."""
    hunt = begun(plant, case, root)
    CampaignRunner(hunt.folder, further=hunt.next_run).run()
    return ended(plant, case, hunt)


def ended(plant: FibreOptic, case: Case, hunt: Hunt) -> Searched:
    """Return how a search through bytes ended; its processor time is not taken apart."""
    end = hunt.end
    steps = tuple(
        Step(
            step.chosen.procedure, step.chosen.parameters, step.chosen.hours, step.chosen.expected_nats,
            step.after.gained_nats or 0.0, step.chosen.to_confirm, step.after.acts, step.after.probability,
            0.0, 0.0,
        )
        for step in steps_of(hunt) if step.after is not None
    )  # fmt: skip
    ends, acts = ("", "") if end is None else (end.ended, end.acts)
    left = () if end is None else fewest(end.probabilities, UNTIL)
    one_of, found = left if ends == ALIKE else (), among(plant, case, left)
    right = is_right(plant, case, ends, acts)
    return Searched(
        case.family, case.name, case.kind, case.seed, case.number, case.acts, dict(case.gap), SEARCH,
        "through bytes", ends, acts, 0.0 if end is None else end.probability, right,
        BUDGET_H if end is None else end.used_h, steps, found, one_of, not (one_of and found),
    )  # fmt: skip


def killed(plant: FibreOptic, case: Case, root: Path, kills: int = KILLS) -> tuple[int, list[str], list[str]]:
    """Return how often a search was killed, and what differs between its journal and that of one left alone.

    Each process is killed after a random part of the time that the whole search takes in one go; the last one is
    left to end.
    """
    begin = host_seconds()
    whole = begun(plant, case, root / "whole")
    CampaignRunner(whole.folder, further=whole.next_run).run()
    takes_s = host_seconds() - begin
    begun(plant, case, root / "killed")
    draw, done = random.Random(case.seed), 0
    while done < kills and Hunt(CampaignFolder(root / "killed" / "out")).end is None:
        process = _going_on(root / "killed" / "out")
        try:
            process.wait(timeout=draw.uniform(0.5, 2.0 * takes_s / kills))
        except subprocess.TimeoutExpired:
            os.kill(process.pid, signal.SIGKILL)
            done += 1
        process.wait()
    _going_on(root / "killed" / "out").wait()
    return done, _told(root / "whole" / "out"), _told(root / "killed" / "out")


def _going_on(folder: Path) -> subprocess.Popen[bytes]:
    code = (
        "import sys; from pathlib import Path; from bench.campaign import CampaignRunner, resume_campaign; "
        "from bench.campaign.hunt import Hunt; hunt = Hunt(resume_campaign(Path(sys.argv[1]))); "
        "CampaignRunner(hunt.folder, further=hunt.next_run).run()"
    )
    return subprocess.Popen([sys.executable, "-c", code, str(folder)])


def _told(folder: Path) -> list[str]:
    """Return what a search thought and chose, a line each, without when."""
    steps = Hunt(CampaignFolder(folder)).steps
    return [json.dumps(event.fields(), sort_keys=True) for event in steps]
