"""What of pip-audit's report fails CI: a known vulnerability that nobody has accepted with a reason."""

import json
import subprocess
from pathlib import Path

import pytest

from benchmarks import audit
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


def answered(monkeypatch, text):
    """Have pip-audit say `text`."""
    done = subprocess.CompletedProcess([], 1, text, "")
    monkeypatch.setattr(audit.subprocess, "run", lambda *_, **__: done)


def test_the_command_fails_for_a_known_vulnerability_and_names_it(monkeypatch, capsys):
    answered(monkeypatch, json.dumps(REPORT))
    assert audit.main() == 1
    assert "VULNERABLE: b 2 PYSEC-1" in capsys.readouterr().err
    monkeypatch.setattr(audit, "ACCEPTED", {"CVE-1": "b's parser is not used"})
    assert audit.main() == 0
    assert "accepted: b 2 PYSEC-1" in capsys.readouterr().out


SILENT = json.dumps({"dependencies": [REPORT["dependencies"][2]], "fixes": []})


@pytest.mark.parametrize("text", ["", "Traceback ...", "{}", "[]", SILENT])
def test_an_audit_in_which_nothing_was_audited_fails(monkeypatch, capsys, text):
    answered(monkeypatch, text)
    assert audit.main() == 2
    assert "AUDIT NOT MADE" in capsys.readouterr().err


def test_packages_that_the_index_does_not_know_are_counted_aloud(monkeypatch, capsys):
    answered(
        monkeypatch, json.dumps({"dependencies": [REPORT["dependencies"][0], REPORT["dependencies"][2]]})
    )
    assert audit.main() == 0
    assert "AUDIT INCOMPLETE: of 2 pinned packages" in capsys.readouterr().err


def test_ci_asks():
    assert "make audit" in (Path(__file__).parents[2] / ".ci" / "run").read_text()
