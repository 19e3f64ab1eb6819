"""No bench computer needs anything under the GPL alone, and every pin says under which licence it is."""

import pytest

from benchmarks.licences import copyleft, pins


@pytest.mark.parametrize(
    ("licence", "is_copyleft"),
    [
        ("GPL-3.0-only", True),
        ("GNU General Public License v2 (GPLv2)", True),
        ("GNU AFFERO GENERAL PUBLIC LICENSE", True),
        ("LGPL-3.0-only", False),
        ("GNU Lesser General Public License v3 or later (LGPLv3+)", False),
        ("Public Domain; BSD License; GNU General Public License (GPL)", False),
        ("MIT OR GPL-2.0-only", False),
        ("Apache-2.0 AND MIT", False),
        ("", False),
    ],
)
def test_only_the_gpl_alone_is_copyleft(licence, is_copyleft):
    assert copyleft(licence) is is_copyleft


def test_what_a_bench_computer_needs_is_not_under_the_gpl_alone_and_says_its_licence():
    known = {pin.name.lower(): pin for pin in pins()}
    assert [pin.name for pin in known.values() if pin.forbidden] == []
    assert [pin.name for pin in known.values() if pin.licence == ""] == []
    assert known["numpy"].runs and known["cryptography"].runs and known["python-can"].runs
    assert not known["lewis"].runs and copyleft(known["lewis"].licence or "")
