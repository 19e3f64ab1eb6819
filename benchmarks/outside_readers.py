"""Certificates read by others: `python -m benchmarks.outside_readers SOURCES RUN...`.

SOURCES has what others wrote, none of which is kept here:

    pip install --target SOURCES/pydcc pydcc==0.2.33
    git clone https://github.com/UtrsSoftware/ATMLWorkBench SOURCES/ATMLWorkBench

The certificate of the runs is written as DCC and as ATML test results. pydcc reads the DCC; every figure must
come back with its value. (Its check by a schema fetches that from the network, and its signatures need OpenSSL:
both are left out.) The ATML is checked by the TestResults.xsd and Common.xsd of ATMLWorkBench, IEEE's draft of
2009: its namespace is put in place of the standard's, and its outcomes are passed, failed and aborted only.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
import types
from pathlib import Path
from typing import Any

from bench.present.report import CertificateContent, certify, load_laboratory, write_atml, write_dcc
from bench.record.figure_limits import NO_LIMITS

etree: Any = importlib.import_module("lxml.etree")

_FACTS = """
number = "1"
[laboratory]
name = "L"
email = "l@example.org"
city = "C"
country = "DE"
[customer]
name = "C"
email = "c@example.org"
city = "C"
country = "DE"
[[person]]
name = "P"
"""


class _Accepts:
    """Stands where a class of pydcc wants the network or OpenSSL: whatever is asked of it is `True`."""

    def __init__(self, *_: object, **__: object) -> None:
        pass

    def __getattr__(self, _: str) -> Any:
        return lambda *_, **__: True


def _read_dcc(source: Path, path: Path) -> list[float]:
    """Return the values that pydcc finds, as they are written."""
    sys.path.append(str(source))
    signatures: Any = types.ModuleType("certvalidator")
    signatures.CertificateValidator = signatures.errors = signatures.ValidationContext = None
    sys.modules["certvalidator"] = signatures
    module = importlib.import_module("dcc.dcc")
    module.DCCXMLValidator = _Accepts  # type: ignore[attr-defined]
    results = module.DCC(str(path)).get_calibration_results("string", lang="en")
    return [float(quantity["real"]["value"]) for _, quantity in results]


def _complaints(schemas: Path, path: Path) -> tuple[int, list[str]]:
    """Return how many `TestResults` there are, and what the draft's schema says against them."""
    schema = etree.parse(schemas / "TestResults.xsd")
    space = str(schema.getroot().get("targetNamespace"))
    text = path.read_text(encoding="utf-8").replace("urn:IEEE-1636.1:2013:TestResultsCollection", space)
    text = text.replace("urn:IEEE-1636.1:2013:TestResults", space)
    rules, said = etree.XMLSchema(schema), []
    units = list(etree.fromstring(text.encode()))
    for results in units:
        rules.validate(etree.ElementTree(etree.fromstring(etree.tostring(results))))
        said += [str(error.message) for error in rules.error_log if "'UserDefined'" not in error.message]
    return len(units), said


def _figures(content: CertificateContent) -> int:
    return sum(figure.value is not None for unit in content.units for figure in unit.figures)


def main(sources: Path, runs: list[Path]) -> int:
    """Print what the readers say; 1 if they miss a figure or complain."""
    with tempfile.TemporaryDirectory() as folder:
        facts = Path(folder, "lab.toml")
        facts.write_text(_FACTS, encoding="utf-8")
        content = certify(runs, Path(folder, "certificate.html"), NO_LIMITS)
        dcc = write_dcc(Path(folder, "dcc.xml"), content, load_laboratory(facts))
        atml = write_atml(Path(folder, "atml.xml"), content)
        written = [float(e.text or "nan") for e in etree.parse(dcc).iter("{https://ptb.de/si}value")]
        read = _read_dcc(sources / "pydcc", dcc)
        units, complaints = _complaints(sources / "ATMLWorkBench" / "data" / "schemas", atml)
    print(f"certificate: {len(content.units)} units, {_figures(content)} figures")
    print(
        f"DCC, pydcc: {len(read)} values read, {'equal' if read == written else 'NOT EQUAL'} to those written"
    )
    print(f"ATML, schema of the draft: {units} TestResults, {len(complaints)} complaints")
    for complaint in complaints:
        print(f"  {complaint}")
    return int(read != written or bool(complaints))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), [Path(run) for run in sys.argv[2:]]))
