"""A campaign on emulated labs: stopped by hand, killed, resumed, steered; the run folders are the truth."""

import json
import os
import select
import shutil
import signal
from pathlib import Path

import pytest

from bench.campaign import CampaignFolder, CampaignRunner, plan_campaign
from bench.control.lease import take_lease
from bench.control.live import drop_answer, drop_request, read_now
from bench.lab.emulated import Plant
from bench.record.benchfile import load_bench_file
from bench.record.events.campaign import Continued
from bench.record.recording import read_events, read_manifest
from drivers.base.errors import BenchInUse, ConfigurationError


def wait_for(process, folder, condition):
    """Return the live state that meets `condition`; fails when the process ends before."""
    while True:
        now = read_now(folder) if folder.exists() else None
        if now is not None and now["alive"] and condition(now):
            return now
        assert process.poll() is None, process.ended()
        select.select([], [], [], 0.02)


def asks(run):
    return lambda now: now["prompts"] and now["campaign"] and now["campaign"]["run"] == run


def answer(folder, now, text="yes"):
    return drop_answer(folder, now["prompts"][0]["id"], text, "Ann")


def journal(folder, *kinds):
    return [event for _, event in CampaignFolder(folder).events() if event.kind in kinds]


def states(folder):
    return [(run.run.name, run.state, run.attempts) for run in CampaignFolder(folder).states(thorough=True)]


@pytest.fixture(scope="module")
def done(tmp_path_factory, texts):
    """A campaign that has run to its end on emulated labs, uninterrupted."""
    root = tmp_path_factory.mktemp("done")
    (root / "bench.toml").write_text(texts[0])
    (root / "campaign.toml").write_text(texts[1])
    file = load_bench_file(root / "bench.toml")
    path = root / "out"
    folder = CampaignFolder.create(path, root / "campaign.toml", file, Plant(seed=5), False)
    ending = CampaignRunner(folder).run()
    assert ending.outcome == "completed", ending.reason
    return path


def test_every_run_records_all_units_under_their_serial_numbers(done):
    for number, (name, state, attempts) in enumerate(states(done)):
        manifest = read_manifest(done / "runs" / name)
        assert (state, attempts, manifest.outcome) == ("done", 1, "completed")
        assert manifest.units == {"fog_2": "FOG-002", "fog_1": "FOG-007"}
        assert manifest.emulated.seed == 5 + number
        assert all((done / "runs" / name / f"gyro_{gyro}.parquet").exists() for gyro in manifest.units)
    assert read_now(done)["state"] == "ended"


def test_the_plan_gives_the_time_and_steps_that_the_run_takes(done):
    folder = CampaignFolder(done)
    planned = plan_campaign(folder.campaign, folder.file, Plant(seed=5))
    for row, state in zip(planned, folder.states(), strict=True):
        assert row.duration_s == pytest.approx(state.duration_s, abs=2.0)
        assert [step.title.split()[0] for step in row.steps] == ["R1", "R2", "R3"]
        taken = sum(path.stat().st_size for path in state.folder.glob("**/*.bin"))
        assert taken < row.bytes < 20 * taken
        assert any("Mount" in question for question in row.questions)


@pytest.mark.parametrize(
    "damage", ["flip", "delete", "running", "parameters", "shorten", "no manifest", "unsealed"]
)
def test_a_folder_that_is_not_what_was_sealed_does_not_count(done, tmp_path, damage):
    copy = tmp_path / "copy"
    shutil.copytree(done, copy)
    run = copy / "runs" / "turn-2"
    target = run / "raw" / "fog_1.bin"
    manifest = json.loads((run / "manifest.json").read_text())
    if damage == "flip":
        content = bytearray(target.read_bytes())
        content[len(content) // 2] ^= 1
        target.write_bytes(content)
    elif damage == "shorten":
        target.write_bytes(target.read_bytes()[:-1])
    elif damage == "delete":
        (run / "gyro_fog_1.parquet").unlink()
    elif damage == "no manifest":
        (run / "manifest.json").unlink()
    else:
        change = {"running": {"outcome": "running"}, "unsealed": {"files": {}}}
        manifest.update(change.get(damage, {"parameters": manifest["parameters"] | {"turns": 3}}))
        (run / "manifest.json").write_text(json.dumps(manifest))
    found = CampaignFolder(copy).states(thorough=True)
    assert [run.state for run in found] == ["done", "open", "done"]
    assert found[1].reason and CampaignFolder(copy).next_id(found[1].run) == "turn-2.2"


@pytest.mark.concurrent
@pytest.mark.slow
def test_ctrl_c_then_sigkill_then_resume_records_every_run_once(
    gyrobench, campaign_path, bench_path, tmp_path
):
    folder = tmp_path / "out"
    options = ("--bench", bench_path, "--out", folder, "--emulated", "--ask", "--seed", "7")
    process = gyrobench("campaign", "run", campaign_path, *options)
    answer(folder, wait_for(process, folder, asks("turn-1")))
    wait_for(process, folder, asks("turn-2"))
    process.send_signal(signal.SIGINT)
    said = process.ended()
    assert process.returncode == 3, said
    assert "stopped by Ctrl-C" in said and "campaign resume" in said
    assert states(folder) == [("turn-1", "done", 1), ("turn-2", "open", 1), ("last", "open", 0)]
    assert read_manifest(folder / "runs" / "turn-2").outcome == "aborted"
    sealed = (folder / "runs" / "turn-1" / "manifest.json").read_bytes()

    process = gyrobench("campaign", "resume", folder)
    answer(folder, wait_for(process, folder, asks("turn-2")))
    wait_for(process, folder, asks("last"))
    process.kill()
    process.wait()
    assert not read_now(folder)["alive"]
    assert read_manifest(folder / "runs" / "last").outcome == "running"
    status = gyrobench("campaign", "status", folder)
    assert "ended without a word" in status.ended()

    process = gyrobench("campaign", "resume", folder, "--json")
    wait_for(process, folder, asks("last"))
    second = gyrobench("campaign", "resume", folder)
    said = second.ended()
    assert second.returncode == 2 and "somebody works on this campaign" in said and str(process.pid) in said
    steered = gyrobench("steer", folder, "answer", "yes", "--by", "Bob")
    assert steered.wait() == 0, steered.ended()
    lines = [json.loads(line) for line in process.ended().splitlines()]
    assert process.returncode == 0
    assert lines[-1]["kind"] == "result" and lines[-1]["outcome"] == "completed" and lines[-1]["done"] == 3

    assert states(folder) == [("turn-1", "done", 1), ("turn-2", "done", 2), ("last", "done", 2)]
    assert (folder / "runs" / "turn-1" / "manifest.json").read_bytes() == sealed
    assert [event.run for event in journal(folder, "set_aside")] == ["turn-2", "last"]
    checks = journal(folder, "checked")
    assert [event.outcome for event in checks] == ["completed", "completed"]
    measured = {row["name"]: row for row in read_manifest(folder / checks[0].folder).measurements}
    assert measured["angle_error"]["passed"] and measured["rate"]["passed"] and measured["air"]["passed"]
    (told,) = [row for row in read_events(folder / "runs" / "last.2").rows if row["kind"] == "answer"]
    assert told["by"] == "Bob" and told["answer"] == "yes" and "Mount" in told["question"]
    assert read_manifest(folder / "runs" / "last.2").emulated.seed == 9


@pytest.mark.concurrent
@pytest.mark.parametrize(("number", "word"), [(signal.SIGTERM, "SIGTERM"), (signal.SIGINT, "Ctrl-C")])
def test_a_signal_between_two_runs_is_told_and_written_down(
    campaign_path, bench_file, tmp_path, number, word
):
    folder = CampaignFolder.create(tmp_path / "out", campaign_path, bench_file, Plant(seed=3), False)
    before = signal.getsignal(number)
    told = []

    def say(text):
        told.append(text)
        os.kill(os.getpid(), number)

    ending = CampaignRunner(folder, say=say).run()
    assert (ending.outcome, ending.reason) == ("aborted", f"stopped by {word}")
    assert [(event.outcome, event.reason) for event in journal(tmp_path / "out", "stopped")] == [
        ("aborted", f"stopped by {word}")
    ]
    assert read_manifest(tmp_path / "out" / "runs" / "turn-1").outcome == "completed" and len(told) == 1
    assert signal.getsignal(number) is before


@pytest.mark.concurrent
@pytest.mark.slow
def test_abort_from_outside_makes_safe_and_pause_holds_between_steps(
    gyrobench, campaign_path, bench_path, tmp_path
):
    folder = tmp_path / "out"
    process = gyrobench(
        *("campaign", "run", campaign_path, "--bench", bench_path, "--out", folder, "--emulated", "--ask")
    )
    now = wait_for(process, folder, asks("turn-1"))
    drop_request(folder, "pause", "Ann")
    wait_for(process, folder, lambda now: now["pause_wanted"])
    answer(folder, now)
    now = wait_for(process, folder, lambda now: now["state"] == "paused")
    assert now["step"].startswith("R1") and now["table"]["rate_dps"] == pytest.approx(0.0, abs=0.01)
    drop_request(folder, "resume", "Bob")
    wait_for(process, folder, asks("turn-2"))
    drop_request(folder, "abort", "Cem")
    said = process.ended()
    assert process.returncode == 3 and "stopped by Cem" in said
    rows = read_events(folder / "runs" / "turn-1").rows
    kinds = [row["kind"] for row in rows if row["kind"] in ("paused", "resumed", "request")]
    assert kinds == ["request", "paused", "request", "resumed"]
    rows = read_events(folder / "runs" / "turn-2").rows
    assert [(row["action"], row["by"]) for row in rows if row["kind"] == "request"] == [("abort", "Cem")]
    assert [row["state"] for row in rows if row["kind"] == "safe_state"] == ["confirmed", "confirmed"]
    assert rows[-1]["outcome"] == "aborted" and read_now(folder)["outcome"] == "aborted"


@pytest.mark.concurrent
@pytest.mark.slow
def test_two_campaigns_on_one_bench(campaign_path, bench_path, bench_file, gyrobench, tmp_path):
    with take_lease(bench_file, "campaign of somebody else"):
        process = gyrobench(
            "campaign", "run", campaign_path, "--bench", bench_path, "--out", tmp_path / "out"
        )
        said = process.ended()
    assert process.returncode == 2, said
    assert "campaign of somebody else" in said and not (tmp_path / "out").exists()


def test_a_folder_that_holds_anything_is_not_begun_in(campaign_path, bench_file, done, tmp_path):
    with pytest.raises(ConfigurationError, match="campaign resume"):
        CampaignFolder.create(done, campaign_path, bench_file, None, False)
    with pytest.raises(ConfigurationError, match="not the folder of a campaign"):
        CampaignFolder(tmp_path)


def test_one_process_works_on_a_campaign(done):
    folder = CampaignFolder(done)
    with folder.lock(), pytest.raises(BenchInUse, match="works on this campaign"), folder.lock():
        pass
    with folder.lock():
        pass


def test_a_torn_journal_line_spoils_nothing(done, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(done, copy)
    folder = CampaignFolder(copy)
    before = folder.events()
    with (copy / "events.jsonl").open("ab") as file:
        file.write(b'{"time_s": 12.0, "ki')  # the power went
    assert folder.events() == before
    folder.event(Continued("Ann"))
    assert [event for _, event in folder.events()] == [*(event for _, event in before), Continued("Ann")]


def test_a_campaign_whose_devices_did_not_answer_goes_on_without_a_check(campaign_path, bench_path, tmp_path):
    bench_path.write_text(bench_path.read_text().replace("/dev/tty", str(tmp_path / "no-such-port-")))
    campaign_path.write_text(campaign_path.read_text().replace("/dev/tty", str(tmp_path / "no-such-port-")))
    file = load_bench_file(bench_path)
    folder = CampaignFolder.create(tmp_path / "out", campaign_path, file, None, False)
    for attempt in (1, 2):
        ending = CampaignRunner(folder).run()
        assert ending.outcome == "failed" and "no-such-port" in ending.reason
        assert len(journal(folder.path, "run_started")) == attempt
    assert not folder.moved() and not journal(folder.path, "checked")
    # had it been killed, nobody would know what moved
    manifest = folder.path / "runs" / "turn-1.2" / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"aborted"', '"running"'))
    assert folder.moved()


@pytest.mark.concurrent
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_stopped_rehearsal_leaves_no_process_and_no_open_run(
    gyrobench, campaign_path, bench_path, tmp_path, number
):
    out = tmp_path / "out"
    campaign_path.write_text(campaign_path.read_text().replace("turns = 2", "turns = 2000"))
    process = gyrobench(
        "campaign", "rehearse", campaign_path, "--bench", bench_path, "--out", out, "--jobs", "2"
    )
    going = [out / "runs" / name / "events.jsonl" for name in ("turn-1", "turn-2")]
    while not all(path.exists() and '"phase"' in path.read_text() for path in going):
        assert process.poll() is None, process.ended()
        select.select([], [], [], 0.02)
    workers = children_of(process.pid)
    process.send_signal(number)
    said = process.ended()
    assert process.returncode == (3 if number == signal.SIGTERM else -number), said
    for worker in workers:  # every process of the rehearsal ends by itself
        while Path(f"/proc/{worker}").exists() and state_of(worker) != "Z":
            select.select([], [], [], 0.02)
    assert [read_manifest(path.parent).outcome for path in going] == ["aborted", "aborted"]
    assert not (out / "runs" / "last").exists()


def children_of(pid):
    lists = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for path in lists for child in path.read_text().split()]


def state_of(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return "Z"
