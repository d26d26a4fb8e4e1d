"""The cells of a study of several records: each specimen's joint fit, and the population over specimens."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from bayesdamp.config import Study
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.many.joining import join
from bayesdamp.pipeline.many.populating import populate
from bayesdamp.pipeline.many.specimens import Specimen
from bayesdamp.store import Store


def _weighs(study: Study) -> bool:
    return bool(study.evidence.methods)


def repeated(study: Study) -> list[str]:
    """The specimens with several records, where the study weighs models."""
    several = [n for n, specs in study.specimens.items() if sum(s.repeats for s in specs) > 1]
    return several if _weighs(study) else []


def populated(study: Study) -> bool:
    """Whether the study has several specimens to summarise."""
    return _weighs(study) and len(study.specimens) > 1


def joint_cells(
    study: Study, store: Store, name: str | None
) -> dict[str, tuple[str, Callable[[str, str], None]]]:
    """The cell of a specimen, or, without a name, that of the population: its name to key and what computes it."""
    if name is None:
        keys = {n: _key(Specimen(study, n, specs, store)) for n, specs in study.specimens.items()}
        return {"population/specimens": (task_key("population", keys), partial(populate, study, store))}
    specimen = Specimen(study, name, study.specimens[name], store)
    return {f"joint/{name}": (_key(specimen), partial(join, specimen))}


def _key(specimen: Specimen) -> str:
    priors = {n: str(p) for n, p in specimen.priors.items()}
    return task_key("joint", specimen.name, specimen.candidates, priors, specimen.answer_keys)
