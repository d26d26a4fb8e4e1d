"""Whether sampling confirms what was said at once."""

from __future__ import annotations

from bayesdamp.report import words
from bayesdamp.report.results.answers import answer_of
from bayesdamp.report.results.reading import damping_of, ranking
from bayesdamp.report.results.run import Run


def confirmation(run: Run, signal: str) -> str:
    """A sentence on what the evidence under exact laws, by sampling, says of a record; empty where none was sampled."""
    repeat = run.repeats(signal)[0]
    answer, found = answer_of(run, signal, repeat), ranking(run, signal, repeat)
    if answer is None or found is None or found.method == "laplace":
        return ""
    own = set(answer.verdict.damping.split("+"))
    lost = next((row for row in found.lost if set(damping_of(row).split("+")) == own), None)
    if lost is not None:
        why = lost["outcome"].rpartition(": ")[2] or lost["outcome"]
        return f"{words.model(answer.verdict.damping)}: sampling has nothing to say of it ({why})."
    first = damping_of(found.best)
    share = words.probability(found.dampings[first])
    if set(first.split("+")) == own:
        return f"Sampling confirms it: under exact laws {words.model(first)} has probability {share}."
    return (
        f"Sampling under exact laws puts {words.model(first)} first, with probability {share}: the choice hangs on how "
        "well the laws hold."
    )
