"""One case of a cohort: a recorded one, or the options from which a simulated one is made."""

from dataclasses import dataclass, replace

from app.synthetic import CaseOptions


@dataclass(frozen=True, slots=True)
class SyntheticCase:
    """Seed and options of a simulated case.

    ``values``: names and values for `CaseOptions.with_values`, in a fixed order.
    """

    seed: int
    tracker: str
    values: tuple[tuple[str, float], ...]
    fixture: bool

    def options(self) -> CaseOptions:
        """The options; raises `InputError` for a value out of range."""
        values = dict(self.values)
        chosen = CaseOptions.of_tracker(self.tracker, values.get("tumor_mm")).with_values(values)
        return replace(chosen, surgeon=replace(chosen.surgeon, fixture=self.fixture))


@dataclass(frozen=True, slots=True)
class CohortCase:
    """A case and what it is compared by.

    Exactly one of ``source`` (path or URL of a case folder) and ``synthetic`` is given. ``group``
    names one side of a comparison, ``pair`` joins a case of each side, ``surgeon`` names who
    operated; an empty text is an unknown one. ``tip_only``: the tool is measured by its tip alone.
    """

    name: str
    source: str = ""
    synthetic: SyntheticCase | None = None
    group: str = ""
    surgeon: str = ""
    pair: str = ""
    tip_only: bool = False
