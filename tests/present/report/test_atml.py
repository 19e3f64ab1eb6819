"""The certificate as ATML test results: read back by another XML reader, and by a schema where it is at hand."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest
from lxml import etree

from bench.present.report import write_atml
from bench.present.report._certificate import CertificateContent
from bench.record.recording import EmulatedLab
from drivers.base.errors import ConfigurationError

NAMES = {
    "trc": "urn:IEEE-1636.1:2013:TestResultsCollection",
    "tr": "urn:IEEE-1636.1:2013:TestResults",
    "c": "urn:IEEE-1671:2010:Common",
    "xsi": "http://www.w3.org/2001/XMLSchema-instance",
}
RESULTS = "/trc:TestResultsCollection/trc:TestResults"


@pytest.fixture
def tree(tmp_path: Path, small_certificate: CertificateContent) -> etree._ElementTree:
    return etree.parse(write_atml(tmp_path / "c.atml.xml", small_certificate))


def found(tree: etree._ElementTree, path: str) -> list[str]:
    return [str(text) for text in tree.xpath(path, namespaces=NAMES)]


def test_every_figure_reads_back_with_its_limits_interval_and_outcome(tree: etree._ElementTree) -> None:
    tests = f"{RESULTS}/tr:ResultSet/tr:Test"
    assert found(tree, f"{tests}/@name") == [
        "bias",
        "scale-factor nonlinearity",
        "my-test.angle",
        "threshold",
    ]
    outcomes = [found(tree, f"{tests}/tr:Outcome/@{name}") for name in ("value", "qualifier")]
    assert outcomes == [
        ["Passed", "UserDefined", "UserDefined", "Failed"],
        ["undecided", "not judged", "not measured"],
    ]
    data = f"{tests}/tr:TestResult/tr:TestData/c:Datum"
    assert [float(value) for value in found(tree, f"{data}/@value")] == [0.5, 12.0, 3e-9]
    assert found(tree, f"{data}/@nonStandardUnit") == ["deg/h", "ppm", "furlong"]
    assert set(found(tree, f"{data}/@xsi:type")) == {"c:double"}
    ends = found(tree, f"{data}/c:ErrorLimits/c:LimitPair/c:Limit/c:Datum/@value")
    assert [float(end) for end in ends] == [0.4, 0.6, 11.0, 14.0]
    assert set(found(tree, f"{data}/c:Confidence/text()")) == {"95.0"}
    limits = f"{tests}/tr:TestResult/tr:TestLimits/tr:Limits"
    assert found(tree, f"{limits}/c:LimitPair/c:Limit/@comparator") == ["GE", "LE"]
    assert [float(end) for end in found(tree, f"{limits}/c:LimitPair/c:Limit/c:Datum/@value")] == [-1.0, 1.0]
    assert found(tree, f"{limits}/c:SingleLimit/@comparator") == ["LE"]
    assert [float(end) for end in found(tree, f"{limits}/c:SingleLimit/c:Datum/@value")] == [13.0]
    keys = found(tree, "//@ID")
    assert len(set(keys)) == len(keys)


def test_unit_bench_and_times_are_told(tree: etree._ElementTree) -> None:
    assert found(tree, f"{RESULTS}/tr:UUT/c:SerialNumber/text()") == ["U-1"]
    assert found(tree, f"{RESULTS}/tr:UUT//c:ModelName/text()") == ["FOG 3"]
    assert found(tree, f"{RESULTS}/tr:UUT//c:Manufacturer/@name") == ["M"]
    assert found(tree, f"{RESULTS}/tr:TestStation/c:SerialNumber/text()") == ["b"]
    (started,), (ended,) = (found(tree, f"{RESULTS}/tr:ResultSet/@{end}DateTime") for end in ("start", "end"))
    assert (started, ended) == ("2026-03-01T23:00:00.000+00:00", "2026-03-02T01:00:00.000+00:00")
    assert found(tree, f"{RESULTS}/tr:ResultSet/tr:Outcome/@value") == ["Failed"]
    assert "guard band" in found(tree, f"{RESULTS}/tr:ResultSet/tr:Description/text()")[0]


def test_what_fails_what_is_not_seen_and_what_is_emulated_are_told(
    tmp_path: Path, small_certificate: CertificateContent
) -> None:
    (unit,), (run,) = small_certificate.units, small_certificate.runs
    failed = replace(unit.figures[0], values={"r": 3.0}, intervals={"r": (2.9, 3.1)})
    unseen = replace(unit.figures[0], unseen=frozenset({"r"}))
    emulated = replace(
        run, manifest=run.manifest.model_copy(update={"emulated": EmulatedLab(seed=1, model="m")})
    )
    content = replace(small_certificate, units=[replace(unit, figures=[failed, unseen])], runs=[emulated])
    tree = etree.parse(write_atml(tmp_path / "c.xml", content))
    assert found(tree, "//tr:Test/tr:Outcome/@value") == ["Failed", "Passed"]
    assert found(tree, "//tr:ResultSet/@simulated") == ["true"]
    assert "not valid for a real unit" in found(tree, "//tr:ResultSet/tr:Description/text()")[0]
    ((said,),) = [found(tree, "//tr:Test[2]/tr:TestResult/tr:Description/text()")]
    assert "does not show it" in said and not found(tree, "//tr:Test[1]/tr:TestResult/tr:Description")


def test_what_is_no_number_is_written_as_the_schema_says(
    tmp_path: Path, small_certificate: CertificateContent
) -> None:
    (unit,) = small_certificate.units
    values = {"a": float("nan"), "b": float("-inf"), "c": float("inf")}
    odd = replace(unit.figures[0], values=values, lower_limit=-2.0, upper_limit=None, intervals={})
    content = replace(small_certificate, units=[replace(unit, figures=[odd])])
    tree = etree.parse(write_atml(tmp_path / "c.xml", content))
    assert found(tree, "//tr:TestData/c:Datum/@value") == ["NaN", "-INF", "INF"]
    assert found(tree, "//tr:TestResult/@name") == ["a", "b", "c"]
    assert set(found(tree, "//c:SingleLimit/@comparator")) == {"GE"}
    with pytest.raises(ConfigurationError, match="without a run"):
        write_atml(tmp_path / "c.xml", replace(small_certificate, runs=()))


@pytest.mark.skipif(
    "GYROBENCH_ATML_XSD" not in os.environ, reason="GYROBENCH_ATML_XSD names no TestResults.xsd"
)
def test_it_is_valid_by_the_schema(tree: etree._ElementTree) -> None:
    schema = etree.parse(os.environ["GYROBENCH_ATML_XSD"])
    space = schema.getroot().get("targetNamespace")
    text = etree.tostring(tree, encoding="unicode").replace(NAMES["tr"], space).replace(NAMES["trc"], space)
    # the draft of 2009 has the outcomes passed, failed and aborted only
    text = text.replace('"UserDefined"', '"Aborted"')
    rules = etree.XMLSchema(schema)
    for results in etree.fromstring(text):
        results.tag = f"{{{space}}}TestResults"
        rules.assertValid(etree.ElementTree(etree.fromstring(etree.tostring(results))))
