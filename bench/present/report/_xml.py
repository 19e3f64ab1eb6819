"""What the XML forms of a certificate share: elements, the file, the device that a unit is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree as ET

from bench.present.report._certificate import CertificateContent
from bench.record.recording import DeviceEntry
from drivers.base.files import replace_file


def add(
    parent: ET.Element,
    space: str,
    name: str,
    text: str | None = None,
    attributes: Mapping[str, str] | None = None,
) -> ET.Element:
    """Append an element of a namespace to its parent and return it."""
    element = ET.SubElement(parent, f"{{{space}}}{name}", dict(attributes or {}))
    element.text = text
    return element


def write_xml(path: Path, root: ET.Element, prefixes: Mapping[str, str]) -> Path:
    """Write a tree as a file with a prefix for each namespace; return its path."""
    for prefix, uri in prefixes.items():
        ET.register_namespace(prefix, uri)
    ET.indent(root)
    replace_file(path, ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n")
    return path


def device_of(content: CertificateContent, unit_id: str) -> DeviceEntry | None:
    """Return how the unit's device identified itself in the first run that has it."""
    return next(
        (
            entry
            for run in content.runs
            for name, entry in run.manifest.devices.items()
            if run.manifest.units.get(name) == unit_id
        ),
        None,
    )
