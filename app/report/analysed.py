"""The analysis of a replay for its report, and with the options of `marginguard analyse`."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from app.report.analysis_html import AnalysedCase
from app.report.methods import methods_of
from app.session import checked_axes

if TYPE_CHECKING:
    from app.analysis import CaseSamples, Insertion
    from app.report.record import ReplayLog
    from app.runtime import PreparedCase, ReplayRun


def analysed_replay(
    run: "ReplayRun", log: "ReplayLog", program: str, *, insertion: "Insertion | None" = None
) -> AnalysedCase | None:
    """Analyse the steps of ``run`` that ``log`` has received; None without a step.

    ``insertion``: its metrics, where they are known already. ``program`` is the version of
    MarginGuard. Constant errors are not known: there is no probability of a breach (`marginguard
    analyse --error`).
    """
    if not log.rows:
        return None
    return analysed_case(run.prepared, log.samples(), program, insertion=insertion)


def analysed_case(
    prepared: "PreparedCase",
    samples: "CaseSamples",
    program: str,
    *,
    cutting_mm: float | None = None,
    ras_from_tumor: ArrayLike | None = None,
    bias_sigma_mm: float = 0.0,
    error_sigmas_mm: Mapping[str, float] | None = None,
    stops_mm: tuple[float, ...] = (),
    insertion: "Insertion | None" = None,
) -> AnalysedCase:
    """Analyse ``samples`` of a replay of ``prepared``; ``program`` is the version of MarginGuard.

    ``cutting_mm`` is by default `CUTTING_MM`. ``error_sigmas_mm`` are standard deviations of
    constant errors along each axis, by name. The other options are those of `analyse_case`.
    """
    from app.analysis import analyse_case
    from app.analysis.swept_volume import CUTTING_MM

    content, sigmas = prepared.content, dict(error_sigmas_mm or {})
    analysis = analyse_case(
        samples,
        name=content.name,
        margins=content.margins,
        tumor=content.tumor,
        tool=content.tool,
        ras_from_tumor=ras_from_tumor,
        bias_sigma_mm=bias_sigma_mm,
        covariances_mm2={name: sigma**2 * np.eye(3) for name, sigma in sigmas.items()},
        stops_mm=stops_mm,
        cutting_mm=CUTTING_MM if cutting_mm is None else cutting_mm,
        insertion=insertion,
    )
    methods = methods_of(
        prepared,
        int(samples.stamps_ns[0]),
        program,
        bias_sigma_mm=bias_sigma_mm,
        error_sigmas_mm=sigmas,
    )
    axes = checked_axes(ras_from_tumor)
    return AnalysedCase(analysis, methods, content.margins, content.tumor, axes)
