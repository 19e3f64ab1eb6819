"""What of pip-audit's report fails CI: a known vulnerability that nobody has accepted with a reason."""

from benchmarks.audit import judge

REPORT = {
    "dependencies": [
        {"name": "a", "version": "1", "vulns": []},
        {
            "name": "b",
            "version": "2",
            "vulns": [{"id": "PYSEC-1", "aliases": ["CVE-1"], "fix_versions": ["3"]}],
        },
        {"name": "c", "skip_reason": "Dependency not found on PyPI and could not be audited: c (1)"},
    ],
    "fixes": [],
}


def test_a_known_vulnerability_counts_and_a_silent_index_does_not():
    verdict = judge(REPORT, {})
    assert (verdict.asked, verdict.unknown) == (2, 1)
    assert verdict.reachable == ("b 2 PYSEC-1",) and verdict.accepted == ()


def test_an_accepted_one_is_named_by_any_of_its_identifiers():
    for name in ("PYSEC-1", "CVE-1"):
        verdict = judge(REPORT, {name: "b's parser is not used"})
        assert verdict.reachable == () and verdict.accepted == ("b 2 PYSEC-1",)
    assert judge(REPORT, {"CVE-2": ""}).reachable
