"""The certificate: what passes, and everything that must not."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.common.allan_noise import NoiseCoefficients
from bench.present.report import CertificateContent, render_page, write_pdf, write_report
from bench.present.report._certificate import CertifiedFigure, UnitCertificate, certificate_page
from bench.present.report._certificate_of_runs import _reasons, certificate_content, check_record
from bench.present.report._file import find_browser
from bench.present.report._page import Page, Verdict
from bench.record.events.run import Measured
from bench.record.figure_limits import FIGURES, FURTHER, Decision, Limits, load_limits
from bench.record.recording import Manifest, read_manifest, write_manifest
from bench.record.recording._tables import table_writer
from drivers.base.errors import ConfigurationError, RecordError

BIAS_DPH, WHITE_DPH = 0.5, 0.3


def run_folder(
    folder: Path, *, bias_dph: float = BIAS_DPH, seed: int = 1, outcome: str = "completed"
) -> Path:
    """A standard test cut down to its bias record: white noise about a known bias, axis up at the equator."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    seconds = np.arange(6000) + 0.5
    with table_writer(folder / "gyro_g.parquet", "gyro") as writer:
        output = bias_dph + WHITE_DPH * rng.standard_normal(len(seconds))
        writer.write(
            {
                "time_ns": (seconds * 1e9).astype(np.int64),
                "valid": np.ones(len(seconds), np.bool_),
                "rate_dps": output / 3600.0,
                "temp_c": np.full(len(seconds), 25.0),
            }
        )
    with table_writer(folder / "turntable.parquet", "table") as writer:
        zero = np.zeros(len(seconds))
        writer.write(
            {"time_ns": (seconds * 1e9).astype(np.int64), "angle_deg": zero + 90.0, "rate_dps": zero}
        )
    event = {"time_s": 6000, "kind": "interval", "test": "bias", "start_s": 0, "end_s": 6000, "cycle": 0}
    (folder / "events.jsonl").write_text(json.dumps(event) + "\n")
    manifest = Manifest(
        run_id=folder.name,
        procedure="standard-test",
        started_utc="2026-01-01T00:00:00.000+00:00",
        bench={"bench": {"name": "b", "latitude_deg": 39.1}},
        units={"g": "U-1"},
        outcome=outcome,
        reason="" if outcome == "completed" else "the operator said no",
    )
    write_manifest(folder, manifest)
    return folder


def limits_of(tmp_path: Path, text: str) -> Limits:
    path = tmp_path / "limits.toml"
    path.write_text(text)
    return load_limits(path)


BIAS_LIMIT = '[limits."bias"]\nunit = "deg/h"\nlow = -1.0\nhigh = 1.0\n'


def made(folders: list[Path], limits: Limits) -> CertificateContent:
    """A certificate whose records count as verified: these runs have tables only, no raw bytes."""
    return certificate_content(
        folders, limits, check=lambda folder: "verified" if folder.is_dir() else "missing"
    )


def test_a_value_inside_its_limits_in_every_run_passes(tmp_path: Path) -> None:
    runs = [run_folder(tmp_path / "runs" / f"r{n}", bias_dph=BIAS_DPH + 0.1 * n, seed=n) for n in range(3)]
    content = made(runs, limits_of(tmp_path, BIAS_LIMIT))
    bias = next(figure for figure in content.units[0].figures if figure.name == "bias")
    assert bias.value == pytest.approx(BIAS_DPH + 0.2, abs=4 * WHITE_DPH / 6000**0.5)
    assert bias.judgement == "pass" and content.verdict == "passed"
    repeatability = next(f for f in content.units[0].figures if f.name == "bias repeatability")
    assert repeatability.value == pytest.approx(0.1, abs=0.02)  # sample deviation of 0.5, 0.6, 0.7
    page = render_page(certificate_page(content))
    assert "Passed" in page and "-1 … 1".replace("-", "−") in page and "°/h" in page


def test_one_value_outside_in_one_run_of_three_does_not_pass(tmp_path: Path) -> None:
    runs = [
        run_folder(tmp_path / "runs" / f"r{n}", bias_dph=b, seed=n) for n, b in enumerate((0.5, 1.5, 0.6))
    ]
    content = made(runs, limits_of(tmp_path, BIAS_LIMIT))
    assert content.verdict == "not passed"
    assert "Not passed" in render_page(certificate_page(content))


@pytest.mark.parametrize("outcome", ["invalid", "aborted", "running"])
def test_a_run_that_was_not_completed_gives_no_figure_and_no_pass(tmp_path: Path, outcome: str) -> None:
    runs = [run_folder(tmp_path / "runs" / "good"), run_folder(tmp_path / "runs" / "other", outcome=outcome)]
    content = made(runs, limits_of(tmp_path, BIAS_LIMIT))
    assert content.verdict == "not passed"
    assert any("other" in text for text in content.units[0].against)
    assert list(content.units[0].figures[0].values) == ["good"]


def test_a_planned_run_that_is_missing_prevents_a_pass(tmp_path: Path) -> None:
    folders = [run_folder(tmp_path / "runs" / "good"), tmp_path / "runs" / "never"]
    content = made(folders, limits_of(tmp_path, BIAS_LIMIT))
    assert content.verdict == "not passed" and content.checks["never"] == "missing"
    assert "never" in render_page(certificate_page(content))


def test_a_limited_figure_that_was_not_measured_prevents_a_pass(tmp_path: Path) -> None:
    text = BIAS_LIMIT + '[limits."scale-factor nonlinearity"]\nunit = "ppm"\nhigh = 50\n'
    content = made([run_folder(tmp_path / "runs" / "r")], limits_of(tmp_path, text))
    figure = next(f for f in content.units[0].figures if f.name == "scale-factor nonlinearity")
    assert figure.judgement == "not measured" and content.verdict == "not passed"


def test_an_expected_unit_without_a_run_does_not_pass(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "runs" / "r")
    content = certificate_content(
        [folder],
        limits_of(tmp_path, BIAS_LIMIT),
        expected_units=("U-1", "U-2"),
        check=lambda folder: "verified",
    )
    assert {unit.unit_id: unit.verdict for unit in content.units} == {"U-1": "passed", "U-2": "not passed"}
    assert content.verdict == "not passed"


def own_run(folder: Path, *values: float | None, unit: str = "ppm") -> Path:
    run = run_folder(folder)
    rows = [
        {"name": "error", "value": value, "unit": unit, "low": None, "high": None, "passed": None}
        for value in values
    ]
    update = {"procedure": "my-test", "measurements": tuple(rows)}
    write_manifest(run, read_manifest(run).model_copy(update=update))
    return run


@pytest.mark.parametrize(
    ("values", "unit", "judgement"),
    [
        ((499.0,), "ppm", "pass"),
        ((501.0,), "ppm", "fail"),
        ((501.0, 499.0), "ppm", "pass"),  # the last one counts
        ((499.0, 501.0), "ppm", "fail"),
        ((None,), "ppm", "fail"),
        ((499.0,), "%", "not measured"),
        ((), "ppm", "not measured"),
    ],
)
def test_what_a_procedure_of_the_users_measures_is_judged(
    tmp_path: Path, values: tuple[float | None, ...], unit: str, judgement: str
) -> None:
    limits = limits_of(tmp_path, '[limits."my-test.error"]\nunit = "ppm"\nhigh = 500\n')
    content = made([own_run(tmp_path / "runs" / "r", *values, unit=unit)], limits)
    (own,) = [figure for figure in content.units[0].figures if figure.limited]
    assert (own.name, own.unit, own.judgement) == ("my-test.error", "ppm", judgement)
    assert content.verdict == ("passed" if judgement == "pass" else "not passed")
    assert "my-test.error" in render_page(certificate_page(content))


@pytest.mark.parametrize(
    ("values", "unit", "said"),
    [
        ((1.0,), "%", "my-test.error: measured in %, its limit is in ppm."),
        ((1.0,), "", "my-test.error: measured in no unit, its limit is in ppm."),
        ((), "ppm", "my-test.error: no completed and verified run of my-test has a figure of this unit."),
    ],
)
def test_a_limit_that_finds_nothing_says_why(
    tmp_path: Path, values: tuple[float, ...], unit: str, said: str
) -> None:
    limits = limits_of(tmp_path, '[limits."my-test.error"]\nunit = "ppm"\nhigh = 500\n')
    content = made([own_run(tmp_path / "runs" / "r", *values, unit=unit)], limits)
    assert content.units[0].against == [said]
    other = limits_of(tmp_path, '[limits."my-test.eror"]\nunit = "ppm"\nhigh = 500\n')
    (told,) = made([own_run(tmp_path / "runs" / "s", 1.0)], other).units[0].against
    assert told == "my-test.eror: my-test did not measure it. It measured error [ppm]."


def test_a_figure_of_one_gyro_counts_for_its_unit_only(tmp_path: Path) -> None:
    run = own_run(tmp_path / "runs" / "r", 10.0)
    manifest = read_manifest(run)
    ((gyro, unit),) = manifest.units.items()
    for named, judgement in ((gyro, "pass"), ("another", "not measured")):
        rows = tuple(row | {"gyro": named} for row in manifest.measurements)
        write_manifest(run, manifest.model_copy(update={"measurements": rows}))
        limits = limits_of(tmp_path, '[limits."my-test.error"]\nunit = "ppm"\nhigh = 500\n')
        (certified,) = made([run], limits).units
        (own,) = [figure for figure in certified.figures if figure.limited]
        assert (certified.unit_id, own.judgement) == (unit, judgement)


def test_a_run_that_is_invalid_gives_no_figure_of_its_own(tmp_path: Path) -> None:
    limits = limits_of(tmp_path, '[limits."my-test.error"]\nunit = "ppm"\nhigh = 500\n')
    run = own_run(tmp_path / "runs" / "r", 10.0)
    write_manifest(run, read_manifest(run).model_copy(update={"outcome": "invalid", "reason": "x"}))
    content = made([run], limits)
    (own,) = [figure for figure in content.units[0].figures if figure.limited]
    assert own.judgement == "not measured" and content.verdict == "not passed"


def test_without_limits_nothing_is_judged(tmp_path: Path) -> None:
    content = made([run_folder(tmp_path / "runs" / "r")], Limits())
    assert content.verdict == "not judged" and "Passed" not in render_page(certificate_page(content))


def test_no_unit_at_all_is_not_a_pass() -> None:
    assert CertificateContent("t", "", []).verdict == "not passed"


@pytest.mark.parametrize(
    ("value", "low", "high", "judgement"),
    [
        (1.0, None, 1.0, "pass"),
        (1.0000001, None, 1.0, "fail"),
        (-1.0, -1.0, None, "pass"),
        (float("nan"), None, 1.0, "fail"),
        (float("inf"), 0.0, None, "fail"),
        (5.0, None, None, "not judged"),
    ],
)
def test_limits_include_their_ends_and_nothing_that_is_no_number(value, low, high, judgement) -> None:
    assert CertifiedFigure("bias", "deg/h", {"r": value}, low, high).judgement == judgement


def test_a_value_that_is_not_a_number_is_shown_as_the_worst() -> None:
    figure = CertifiedFigure("bias", "deg/h", {"a": 0.1, "b": float("nan")}, None, 1.0)
    assert figure.judgement == "fail" and str(figure.value) == "nan"
    assert UnitCertificate("U", [figure]).verdict == "not passed"


def test_an_interval_beyond_the_limit_is_marked() -> None:
    figure = CertifiedFigure("bias instability", "deg/h", {"r": 0.9}, None, 1.0, {"r": (0.7, 1.2)})
    assert figure.judgement == "pass" and figure.doubtful
    content = CertificateContent("t", "", [UnitCertificate("U", [figure])])
    assert "interval beyond limit" in render_page(certificate_page(content))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[limits."bais"]\nunit = "deg/h"\nhigh = 1\n', "did you mean 'bias'"),
        ('[limits."bias"]\nunit = "deg/s"\nhigh = 1\n', "is in deg/h, not 'deg/s'"),
        ('[limits."bias"]\nunit = "deg/h"\n', "neither low nor high"),
        ('[limits."bias"]\nunit = "deg/h"\nlow = 2\nhigh = 1\n', "above high"),
        ('[limits."bias"]\nunit = "deg/h"\nhigh = nan\n', "finite"),
        ('[limits."bias"]\nunit = "deg/h"\nhihg = 1\nhigh = 1\n', "hihg"),
        (BIAS_LIMIT + BIAS_LIMIT, "limits cannot be used"),
        ("[other]\n", "no limits table"),
        ("limits = 3", "not a table"),
        ("[limits", "limits cannot be used"),
    ],
)
def test_bad_limits_are_refused_with_the_reason(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ConfigurationError) as found:
        limits_of(tmp_path, text)
    assert says in str(found.value)


def test_the_figures_named_are_those_that_the_noise_fit_gives() -> None:
    names = {name.rsplit("_d", 1)[0].replace("_", " ") for name in NoiseCoefficients.__dataclass_fields__}
    assert names <= {**FIGURES, **FURTHER}.keys()


def test_a_record_that_was_never_sealed_or_lost_a_file_is_not_verified(tmp_path: Path) -> None:
    assert "never closed" in check_record(run_folder(tmp_path / "open", outcome="running"))
    assert check_record(tmp_path / "none").startswith("missing")
    damaged = run_folder(tmp_path / "damaged")
    (damaged / "manifest.json").write_text("{")
    assert check_record(damaged).startswith("cannot be read")
    assert read_manifest(run_folder(tmp_path / "tables only")).complete
    assert check_record(tmp_path / "tables only") != "verified"


def page_that_says(word: str) -> Page:
    return Page("Certificate", "Test certificate", [], Verdict(word, "plain", []))


def test_a_save_that_fails_leaves_no_old_pass_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    passed = page_that_says("Passed")
    page = write_report(tmp_path / "certificate.html", passed)
    assert page.read_text(encoding="utf-8") == render_page(passed)

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(RecordError, match="there is none"):
        write_report(page, page_that_says("Not passed"))
    assert list(tmp_path.iterdir()) == []


def test_every_printed_page_has_its_number_and_the_title_whatever_that_is() -> None:
    page = replace(page_that_says("Passed"), title='No. 7/A "}</style><script>\\')
    html = render_page(page)
    assert html.count("</style>") == 1 and "<script" not in html
    style = html[html.index("<style>") : html.index("</style>")]
    title = style.rpartition('content: "')[2].partition('"')[0]
    assert title.split() == ["No.", "7/A", "/style", "script"]
    assert "counter(page)" in style and "counter(pages)" in style


def test_a_pdf_is_the_page_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = write_report(tmp_path / "certificate.html", page_that_says("Passed"))
    if not find_browser():
        pytest.skip("no Chromium or Chrome on this machine: PDFs cannot be printed here")
    path = write_pdf(page)
    assert path.read_bytes().startswith(b"%PDF-") and path.stat().st_size > 1000

    def fails(*_: object, **__: object) -> subprocess.CompletedProcess[bytes]:
        return subprocess.CompletedProcess([], 1, b"", b"no display")

    monkeypatch.setattr("subprocess.run", fails)
    with pytest.raises(RecordError, match="no display"):
        write_pdf(page)
    assert not path.exists()


def test_without_a_browser_a_pdf_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(ConfigurationError, match="apt-get install chromium"):
        write_pdf(write_report(tmp_path / "page.html", page_that_says("Passed")))


@pytest.mark.parametrize(
    ("rule", "risk", "value", "half", "judgement"),
    [
        ("simple acceptance", None, 0.99, 0.5, "pass"),
        ("simple acceptance", None, 1.01, 0.5, "fail"),
        ("guard band", None, 0.94, 0.05, "pass"),
        ("guard band", None, 0.96, 0.05, "undecided"),
        ("guard band", None, 1.04, 0.05, "undecided"),
        ("guard band", None, 1.06, 0.05, "fail"),
        # a standard error of 0.1: beyond 1 with 5 % at 1 - 1.6449 * 0.1 = 0.8355 (printed tables)
        ("false acceptance", 0.05, 0.8354, 0.196, "pass"),
        ("false acceptance", 0.05, 0.8357, 0.196, "undecided"),
        ("false acceptance", 0.05, 1.1643, 0.196, "undecided"),
        ("false acceptance", 0.05, 1.1646, 0.196, "fail"),
        ("false acceptance", 0.05, 0.5, float("inf"), "undecided"),
        ("false acceptance", 0.05, float("nan"), 0.1, "fail"),
    ],
)
def test_the_rule_decides(rule: str, risk: float | None, value: float, half: float, judgement: str) -> None:
    decision = Decision.model_validate({"rule": rule, "risk": risk})
    interval = {"r": (value - half, value + half)}
    figure = CertifiedFigure("bias", "deg/h", {"r": value}, -9.0, 1.0, interval, decision=decision)
    assert figure.judgement == judgement
    if rule != "simple acceptance" and value == value:
        assert (
            CertifiedFigure("bias", "deg/h", {"r": value}, None, 1.0, decision=decision).judgement
            == "undecided"
        )
    verdict = {"pass": "passed", "fail": "not passed", "undecided": "undecided"}[judgement]
    content = CertificateContent("t", "", [UnitCertificate("U", [figure])], decision=decision)
    assert content.verdict == verdict and verdict.capitalize() in render_page(certificate_page(content))


def test_units_that_pass_are_beyond_their_limits_no_more_often_than_the_risk() -> None:
    """50,000 units spread evenly about the limits, measured with a standard error of 0.1."""
    rng = np.random.default_rng(5)
    true = rng.uniform(-2.0, 2.0, 50_000)
    value = true + 0.1 * rng.standard_normal(len(true))
    decision = Decision(rule="false acceptance", risk=0.1)
    found = np.array([decision.judge(v, (v - 0.196, v + 0.196), -1.0, 1.0) for v in value])
    inside = np.abs(true) <= 1.0
    edge = (found == "pass") & (np.abs(value) > 0.86)
    assert 0.07 < np.mean(~inside[edge]) < 0.1 and np.mean(~inside[found == "pass"]) < 0.01
    edge = (found == "fail") & (np.abs(value) < 1.14)
    assert 0.07 < np.mean(inside[edge]) < 0.1


def test_a_flat_error_is_beyond_a_limit_as_often_as_the_rule_says() -> None:
    """Half width 1, u = 0.577, 95 % within 0.95: beyond 0.8 with a probability of (1 - 0.8) / 2 = 0.1."""
    decision = Decision(rule="false acceptance", risk=0.1)
    for high, judgement in ((0.801, "pass"), (0.799, "undecided")):
        assert decision.judge(0.0, (-0.95, 0.95), None, high, 3**-0.5) == judgement
    assert decision.judge(0.0, (-0.95, 0.95), None, 0.7) == "pass"  # taken for normal


def test_the_rule_stands_in_the_file_of_limits_and_with_its_risk_on_the_certificate(tmp_path: Path) -> None:
    rule = '[decision]\nrule = "false acceptance"\nrisk = 0.01\n'
    content = made([run_folder(tmp_path / "runs" / "r")], limits_of(tmp_path, BIAS_LIMIT + rule))
    assert content.verdict == "passed"
    assert "false acceptance" in render_page(certificate_page(content)) and content.decision.risk == 0.01
    assert "at most 0.01" in render_page(certificate_page(content))
    tight = BIAS_LIMIT.replace("high = 1.0", "high = 0.505")
    assert made([tmp_path / "runs" / "r"], limits_of(tmp_path, tight + rule)).verdict == "undecided"
    for text, says in (
        ('rule = "guess"', "simple acceptance"),
        ('rule = "false acceptance"', "risk goes with"),
    ):
        with pytest.raises(ConfigurationError, match=says):
            limits_of(tmp_path, f"{BIAS_LIMIT}[decision]\n{text}\n")


def test_a_unit_is_not_judged_by_the_measurement_of_another():
    items = [
        Measured.against("rest", 132.0, "deg/h", -20.0, 20.0, "mems"),
        Measured.against("air", 99.0, "degC", -60.0, 85.0),
    ]
    run = SimpleNamespace(valid=True, run_id="r", measurements=items)
    assert _reasons(run, "verified", "fog") == ["Run r: air is outside its limits."]
    assert len(_reasons(run, "verified", "mems")) == 2


def test_two_folders_of_one_name_are_refused(tmp_path):
    for parent in ("a", "b"):
        (tmp_path / parent / "run").mkdir(parents=True)
    with pytest.raises(ConfigurationError, match="two run folders of one name"):
        certificate_content([tmp_path / "a" / "run", tmp_path / "b" / "run"])
