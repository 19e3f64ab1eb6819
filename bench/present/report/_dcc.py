"""A test certificate as a Digital Calibration Certificate, PTB's DCC schema 3.1.2 with D-SI 2.1.0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bench.present.report._certificate import CertificateContent, CertifiedFigure, UnitCertificate
from bench.present.report._xml import add, device_of, write_xml
from bench.record.benchfile import Calibration, calibrations_of
from drivers.base.errors import ConfigurationError
from drivers.base.files import read_settings

SCHEMA_VERSION = "3.1.2"
_DCC, _SI = "https://ptb.de/dcc", "https://ptb.de/si"
_UNITS = {
    "": (1.0, r"\one"),
    "ppm": (1e-6, r"\one"),
    "s": (1.0, r"\second"),
    "deg": (1.0, r"\degree"),
    "deg/s": (1.0, r"\degree\second\tothe{-1}"),
    "deg/h": (1.0, r"\degree\hour\tothe{-1}"),
    "deg/h/h": (1.0, r"\degree\hour\tothe{-2}"),
    "deg/sqrt(h)": (1.0, r"\degree\hour\tothe{-0.5}"),
    "deg/h/sqrt(h)": (1.0, r"\degree\hour\tothe{-1.5}"),
    "deg/h/degC": (1.0, r"\degree\hour\tothe{-1}\kelvin\tothe{-1}"),
    "ppm/degC": (1e-6, r"\kelvin\tothe{-1}"),
}
"""Factor and D-SI name of the units of figures; ppm is written as the number it is."""
_OTHER = (1.0, r"\one")


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")


class Contact(_Part):
    """A laboratory or a customer."""

    name: str = Field(min_length=1)
    email: str = Field(min_length=1)
    city: str = Field(min_length=1)
    country: str = Field(pattern="^[A-Z]{2}$")


class Person(_Part):
    """Somebody responsible; the first one signs."""

    name: str = Field(min_length=1)
    role: str = ""


class Laboratory(_Part):
    """What a DCC needs beside the record: number, laboratory, customer, persons."""

    number: str = Field(min_length=1)
    laboratory: Contact
    customer: Contact
    person: tuple[Person, ...] = Field(strict=False, min_length=1)


def load_laboratory(path: Path) -> Laboratory:
    """Read number, laboratory, customer and persons from TOML; ConfigurationError names what is wrong."""
    data, _ = read_settings(path, "the facts of the laboratory", remedy="check the path given with --dcc")
    try:
        return Laboratory.model_validate(data)
    except ValidationError as error:
        raise ConfigurationError(
            "the facts of the laboratory cannot be used",
            where=str(path),
            found="; ".join(f"{'.'.join(map(str, item['loc']))}: {item['msg']}" for item in error.errors()),
            expected="number; [laboratory] and [customer] with name, email, city, country as DE; [[person]]",
        ) from error


def write_dcc(path: Path, content: CertificateContent, facts: Laboratory) -> Path:
    """Write the certificate as XML and return its path."""
    return write_xml(path, dcc(content, facts), {"dcc": _DCC, "si": _SI})


def dcc(content: CertificateContent, facts: Laboratory) -> ET.Element:
    """Return the certificate as a tree. ConfigurationError for one without a run or without a figure."""
    units = [unit for unit in content.units if any(figure.values for figure in unit.figures)]
    if not content.runs or not units:
        raise ConfigurationError(
            "a certificate without any figure is no calibration certificate",
            where=content.title,
            expected="at least one completed standard-test run whose record verifies",
        )
    root = ET.Element(f"{{{_DCC}}}digitalCalibrationCertificate", {"schemaVersion": SCHEMA_VERSION})
    _administration(_add(root, "administrativeData"), content, units, facts)
    results = _add(root, "measurementResults")
    known = {item: None for run in content.runs for item in calibrations_of(run.manifest.bench)}
    for unit in units:
        _results(_add(results, "measurementResult"), content, unit, list(known))
    return root


def _add(parent: ET.Element, name: str, text: str | None = None, space: str = _DCC) -> ET.Element:
    return add(parent, space, name, text)


def _text(parent: ET.Element, name: str, text: str) -> None:
    _add(_add(parent, name), "content", text).set("lang", "en")


def _contact(parent: ET.Element, contact: Contact) -> None:
    _text(parent, "name", contact.name)
    _add(parent, "eMail", contact.email)
    location = _add(parent, "location")
    _add(location, "city", contact.city)
    _add(location, "countryCode", contact.country)


def _identification(parent: ET.Element, issuer: str, value: str, name: str) -> None:
    item = _add(parent, "identification")
    _add(item, "issuer", issuer)
    _add(item, "value", value)
    _text(item, "name", name)


def _administration(
    parent: ET.Element, content: CertificateContent, units: Sequence[UnitCertificate], facts: Laboratory
) -> None:
    manifests = [run.manifest for run in content.runs]
    software = _add(_add(parent, "dccSoftware"), "software")
    _text(software, "name", "gyrobench")
    _add(software, "release", manifests[0].software.get("gyrobench", "unknown"))
    core = _add(parent, "coreData")
    _add(core, "countryCodeISO3166_1", facts.laboratory.country)
    _add(core, "usedLangCodeISO639_1", "en")
    _add(core, "mandatoryLangCodeISO639_1", "en")
    _add(core, "uniqueIdentifier", facts.number)
    _add(core, "beginPerformanceDate", min(manifest.started_utc for manifest in manifests)[:10])
    _add(
        core,
        "endPerformanceDate",
        max(manifest.ended_utc or manifest.started_utc for manifest in manifests)[:10],
    )
    _add(core, "performanceLocation", "laboratory")
    items = _add(parent, "items")
    for unit in units:
        device = device_of(content, unit.unit_id)
        item = _add(items, "item")
        _text(item, "name", f"gyro {unit.unit_id}")
        _text(_add(item, "manufacturer"), "name", (device.maker if device else "") or "unknown")
        if device is not None and device.model:
            _add(item, "model", device.model)
        _identification(_add(item, "identifications"), "manufacturer", unit.unit_id, "serial number")
    _contact(_add(_add(parent, "calibrationLaboratory"), "contact"), facts.laboratory)
    persons = _add(parent, "respPersons")
    for number, person in enumerate(facts.person):
        entry = _add(persons, "respPerson")
        _text(_add(entry, "person"), "name", person.name)
        if person.role:
            _add(entry, "role", person.role)
        _add(entry, "mainSigner", "true" if number == 0 else "false")
    _contact(_add(parent, "customer"), facts.customer)
    statements = _add(parent, "statements")
    rule = content.decision.rule + (f", risk {content.decision.risk:g}" if content.decision.risk else "")
    for norm, declaration in (
        ("JCGM 100", "The expanded uncertainties are stated for a coverage probability of 95 %."),
        ("JCGM 106", f"Decision rule: {rule}."),
    ):
        statement = _add(statements, "statement")
        _add(statement, "norm", norm)
        _add(_add(statement, "declaration"), "content", declaration).set("lang", "en")


def _results(
    parent: ET.Element, content: CertificateContent, unit: UnitCertificate, known: Sequence[Calibration]
) -> None:
    emulated = (
        ", emulated bench: not valid for a real unit" if any(run.emulated for run in content.runs) else ""
    )
    _text(parent, "name", f"Standard test of {unit.unit_id}{emulated}")
    method = _add(_add(parent, "usedMethods"), "usedMethod")
    _text(method, "name", "Test plan of the gyro standards")
    for norm in ("IEEE Std 952", "IEEE Std 647", "GJB 2426A"):
        _add(method, "norm", norm)
    if known:
        equipments = _add(parent, "measuringEquipments")
        for item in known:
            equipment = _add(equipments, "measuringEquipment")
            _text(equipment, "name", f"{item.instrument} ({item.quantity})")
            _identification(
                _add(equipment, "identifications"), "calibrationLaboratory", item.certificate, "certificate"
            )
    results = _add(parent, "results")
    for figure in unit.figures:
        if figure.value is not None and math.isfinite(figure.value):
            result = _add(results, "result")
            _text(result, "name", figure.name)
            _quantity(_add(_add(result, "data"), "quantity"), figure, figure.value)


def _quantity(parent: ET.Element, figure: CertifiedFigure, value: float) -> None:
    factor, unit = _UNITS.get(figure.unit, _OTHER)
    if figure.unit not in _UNITS:
        _text(parent, "name", f"in {figure.unit}")
    real = _add(parent, "real", space=_SI)
    _add(real, "value", repr(float(factor * value)), _SI)
    _add(real, "unit", unit, _SI)
    standard = figure.standard_uncertainties.get(figure.shown or "")
    if figure.interval is not None and standard and all(map(math.isfinite, figure.interval)):
        low, high = figure.interval
        half = 0.5 * (high - low)
        even = math.isclose(value - low, high - value, rel_tol=1e-6) and half >= standard
        interval = _add(real, "expandedUnc" if even else "coverageInterval", space=_SI)
        numbers = (
            {"uncertainty": factor * half, "coverageFactor": half / standard}
            if even
            else {"standardUnc": factor * standard, "intervalMin": factor * low, "intervalMax": factor * high}
        )
        for name, number in numbers.items():
            _add(interval, name, repr(float(number)), _SI)
        _add(interval, "coverageProbability", "0.95", _SI)
    if figure.limited:
        stated = {"pass": "pass", "fail": "fail"}.get(figure.judgement)
        metadata = _add(_add(parent, "measurementMetaData"), "metaData")
        _add(
            metadata,
            "conformity",
            stated or ("conditionalPass" if figure.holds(value) else "conditionalFail"),
        )
