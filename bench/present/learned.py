"""What was learned for a gap without a name, in words for terminal and report."""

from __future__ import annotations

from bench.analysis.gap import Learned


def learned_sentences(learned: Learned | None) -> list[str]:
    """Return what closes the gap without a name, how far on other profiles and where it may be used."""
    if learned is None:
        return []
    if not learned.terms:
        return [f"Nothing is offered to close it: {learned.reason}."]
    forms = " and ".join(term.name for term in learned.terms)
    shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in learned.by_profile.items())
    ranges = ", ".join(f"{name} {low:.4g} to {high:.4g}" for name, (low, high) in learned.valid.items())
    return [
        f"It can be closed without a name ({forms}): {100 * learned.share:.0f} % of it is gone in profiles that "
        f"were left out of the fit ({shares}). Use it only within {ranges}."
    ]
