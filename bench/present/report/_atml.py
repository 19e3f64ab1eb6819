"""A test certificate as ATML test results: IEEE Std 1636.1-2013 with the common part of IEEE Std 1671-2010."""

from __future__ import annotations

from pathlib import Path
from uuid import NAMESPACE_URL, uuid5
from xml.etree import ElementTree as ET

from bench.present.report._certificate import CertificateContent, CertifiedFigure, UnitCertificate
from bench.present.report._run_content import RunContent
from bench.present.report._xml import add, device_of, write_xml
from drivers.base.errors import ConfigurationError

_COLLECTION = "urn:IEEE-1636.1:2013:TestResultsCollection"
_RESULTS = "urn:IEEE-1636.1:2013:TestResults"
_COMMON = "urn:IEEE-1671:2010:Common"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_OUTCOMES = {"pass": "Passed", "passed": "Passed", "fail": "Failed", "not passed": "Failed"}
"""The standard's words; what is neither passed nor failed is `UserDefined` with our word as its qualifier."""
_NOT_MEASURED = "not measured"


def write_atml(path: Path, content: CertificateContent) -> Path:
    """Write the certificate as XML and return its path."""
    names = {"trc": _COLLECTION, "tr": _RESULTS, "c": _COMMON, "xsi": _XSI}
    return write_xml(path, atml(content), names)


def atml(content: CertificateContent) -> ET.Element:
    """Return the certificate as a tree: `TestResults` of every unit. ConfigurationError for one without a run."""
    if not content.runs or not content.units:
        raise ConfigurationError(
            "a certificate without a run has no test results",
            where=content.title,
            expected="at least one run with a gyro",
        )
    root = ET.Element(f"{{{_COLLECTION}}}TestResultsCollection")
    for number, unit in enumerate(content.units, start=1):
        _unit(root, content, unit, f"unit{number}")
    return root


def _unit(root: ET.Element, content: CertificateContent, unit: UnitCertificate, key: str) -> None:
    runs = [run for run in content.runs if unit.unit_id in run.manifest.units.values()] or list(content.runs)
    seal = "|".join([unit.unit_id, *(f"{run.run_id}:{run.checksum}" for run in runs)])
    results = add(root, _COLLECTION, "TestResults", None, {"uuid": str(uuid5(NAMESPACE_URL, seal))})
    operators = ", ".join(dict.fromkeys(run.operator for run in runs if run.operator)) or "unknown"
    personnel = add(results, _RESULTS, "Personnel")
    add(personnel, _RESULTS, "SystemOperator", None, {"ID": operators, "name": operators})
    _tests(results, content, unit, runs, key)
    first = runs[0].manifest
    program = add(results, _RESULTS, "TestProgram")
    _item(program, "gyrobench", first.software.get("gyrobench") or "unknown")
    station = add(results, _RESULTS, "TestStation")
    _item(station, "test bench", first.bench_name or "unknown")
    device = device_of(content, unit.unit_id)
    uut = add(results, _RESULTS, "UUT")
    _item(uut, (device.model if device else "") or "gyro", unit.unit_id, device.maker if device else "")


def _item(parent: ET.Element, model: str, serial_number: str, maker: str = "") -> None:
    identification = add(add(parent, _COMMON, "Definition"), _COMMON, "Identification")
    add(identification, _COMMON, "ModelName", model)
    numbers = add(identification, _COMMON, "IdentificationNumbers")
    number = {"number": model, "type": "Model", "qualifier": "model"}
    add(numbers, _COMMON, "IdentificationNumber", None, number)
    if maker:
        add(add(identification, _COMMON, "Manufacturers"), _COMMON, "Manufacturer", None, {"name": maker})
    add(parent, _COMMON, "SerialNumber", serial_number)


def _tests(
    parent: ET.Element, content: CertificateContent, unit: UnitCertificate, runs: list[RunContent], key: str
) -> None:
    started = min(run.manifest.started_utc for run in runs)
    ended = max(run.manifest.ended_utc or run.manifest.started_utc for run in runs)
    emulated = any(run.emulated for run in runs)
    attributes = {"ID": key, "name": content.title, "startDateTime": started, "endDateTime": ended}
    if emulated:
        attributes["simulated"] = "true"
    group = add(parent, _RESULTS, "ResultSet", None, attributes)
    rule = content.decision.rule + (f", risk {content.decision.risk:g}" if content.decision.risk else "")
    said = [f"Decision rule (JCGM 106): {rule}.", *unit.against]
    add(
        group,
        _RESULTS,
        "Description",
        " ".join(["Emulated bench: not valid for a real unit."] * emulated + said),
    )
    _outcome(group, unit.verdict)
    for number, figure in enumerate(unit.figures, start=1):
        _test(group, figure, f"{key}.test{number}", started)


def _outcome(parent: ET.Element, judgement: str) -> None:
    if judgement == _NOT_MEASURED:
        attributes = {"value": "Failed", "qualifier": _NOT_MEASURED}
    elif judgement in _OUTCOMES:
        attributes = {"value": _OUTCOMES[judgement]}
    else:
        attributes = {"value": "UserDefined", "qualifier": judgement}
    add(parent, _RESULTS, "Outcome", None, attributes)


def _test(parent: ET.Element, figure: CertifiedFigure, key: str, started: str) -> None:
    attributes = {"ID": key, "name": figure.name, "startDateTime": started, "testReferenceID": figure.name}
    test = add(parent, _RESULTS, "Test", None, attributes)
    _outcome(test, figure.judgement)
    for number, (run, value) in enumerate(figure.values.items(), start=1):
        result = add(test, _RESULTS, "TestResult", None, {"ID": f"{key}.run{number}", "name": run})
        if run in figure.unseen:
            add(
                result,
                _RESULTS,
                "Description",
                "The record does not show it: at most the end of the interval.",
            )
        datum = _datum(add(result, _RESULTS, "TestData"), value, figure.unit)
        if run in figure.intervals:
            _between(add(datum, _COMMON, "ErrorLimits"), *figure.intervals[run], figure.unit)
            add(datum, _COMMON, "Confidence", "95.0")
        if figure.limited:
            _limits(add(add(result, _RESULTS, "TestLimits"), _RESULTS, "Limits"), figure)


def _limits(parent: ET.Element, figure: CertifiedFigure) -> None:
    low, high = figure.lower_limit, figure.upper_limit
    if low is not None and high is not None:
        _between(parent, low, high, figure.unit)
    elif low is not None:
        _datum(add(parent, _COMMON, "SingleLimit", None, {"comparator": "GE"}), low, figure.unit)
    elif high is not None:
        _datum(add(parent, _COMMON, "SingleLimit", None, {"comparator": "LE"}), high, figure.unit)


def _between(parent: ET.Element, low: float, high: float, unit: str) -> None:
    pair = add(parent, _COMMON, "LimitPair", None, {"operator": "AND"})
    for comparator, end in (("GE", low), ("LE", high)):
        _datum(add(pair, _COMMON, "Limit", None, {"comparator": comparator}), end, unit)


def _datum(parent: ET.Element, value: float, unit: str) -> ET.Element:
    # XML Schema writes what is no number as NaN, INF, -INF
    attributes = {
        f"{{{_XSI}}}type": "c:double",
        "value": repr(float(value)).replace("inf", "INF").replace("nan", "NaN"),
    }
    if unit:
        attributes["nonStandardUnit"] = unit
    return add(parent, _COMMON, "Datum", None, attributes)
