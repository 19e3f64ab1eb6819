"""The certificate as DCC XML: read back by another XML reader, and against PTB's schema where it is at hand."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from lxml import etree

from bench.present.report import load_laboratory, write_dcc
from bench.present.report._certificate import CertificateContent
from drivers.base.errors import ConfigurationError

NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
FACTS = """
number = "2026-017"
[laboratory]
name = "Gyro <lab> & sons"
email = "lab@example.org"
city = "Kiel"
country = "DE"
[customer]
name = "Customer"
email = "c@example.org"
city = "Bern"
country = "CH"
[[person]]
name = "A. Metrologist"
role = "signs"
[[person]]
name = "B. Operator"
"""


@pytest.fixture
def tree(tmp_path: Path, small_certificate: CertificateContent) -> etree._ElementTree:
    (tmp_path / "lab.toml").write_text(FACTS)
    path = write_dcc(tmp_path / "c.xml", small_certificate, load_laboratory(tmp_path / "lab.toml"))
    return etree.parse(path)


def found(tree: etree._ElementTree, path: str) -> list[str]:
    return [str(text) for text in tree.xpath(f"{path}/text()", namespaces=NAMES)]


def test_what_it_says_reads_back(tree: etree._ElementTree) -> None:
    results = "//dcc:result"
    assert found(tree, f"{results}/dcc:name/dcc:content") == [
        "bias",
        "scale-factor nonlinearity",
        "my-test.angle",
    ]
    assert [float(text) for text in found(tree, "//si:real/si:value")] == pytest.approx([0.5, 12e-6, 3e-9])
    assert found(tree, "//si:real/si:unit") == [r"\degree\hour\tothe{-1}", r"\one", r"\one"]
    (uncertainty,), (k,) = (
        found(tree, f"//si:expandedUnc/si:{name}") for name in ("uncertainty", "coverageFactor")
    )
    assert float(uncertainty) == pytest.approx(0.1) and float(k) == pytest.approx(2.0)
    ends = [found(tree, f"//si:coverageInterval/si:{name}")[0] for name in ("intervalMin", "intervalMax")]
    assert [float(text) for text in ends] == pytest.approx([11e-6, 14e-6])
    assert found(tree, "//dcc:conformity") == [
        "pass",
        "conditionalPass",
    ]  # guard band: the second is undecided
    assert found(tree, "//dcc:uniqueIdentifier") == ["2026-017"]
    assert found(tree, "//dcc:beginPerformanceDate") == ["2026-03-01"]
    assert found(tree, "//dcc:endPerformanceDate") == ["2026-03-02"]
    assert found(tree, "//dcc:calibrationLaboratory//dcc:name/dcc:content") == ["Gyro <lab> & sons"]
    assert found(tree, "//dcc:measuringEquipment//dcc:value") == ["K-7"]
    assert found(tree, "//dcc:mainSigner") == ["true", "false"]
    assert found(tree, "//dcc:item/dcc:model") == ["FOG 3"]


@pytest.mark.skipif("GYROBENCH_DCC_XSD" not in os.environ, reason="GYROBENCH_DCC_XSD names no dcc.xsd 3.1.2")
def test_it_is_valid_by_the_schema(tree: etree._ElementTree) -> None:
    etree.XMLSchema(etree.parse(os.environ["GYROBENCH_DCC_XSD"])).assertValid(tree)


def test_facts_that_lack_something_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text(FACTS.replace('country = "CH"', 'country = "Swiss"').replace("number", "nr"))
    with pytest.raises(ConfigurationError, match=r"number: .*customer\.country: .*nr: "):
        load_laboratory(path)
    path.write_text(FACTS)
    facts = load_laboratory(path)
    with pytest.raises(ConfigurationError, match="without any figure"):
        write_dcc(tmp_path / "none.xml", CertificateContent("t", "", []), facts)
    assert not (tmp_path / "none.xml").exists()
