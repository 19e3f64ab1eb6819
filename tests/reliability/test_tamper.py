"""The short form of tampering: four random changes of each kind to sealed runs, each found or proved harmless."""

from benchmarks.tamper import FOUND, KINDS, tamper


def test_random_changes_to_sealed_runs_are_found_or_change_nothing_that_is_read():
    tallies = tamper(4 * len(KINDS), 20261126)
    assert [text for tally in tallies.values() for text in tally.missed] == []
    assert all(tally.tried == 4 for tally in tallies.values())
    assert sum(tally.verdicts[FOUND] for tally in tallies.values()) > 3 * len(KINDS)
