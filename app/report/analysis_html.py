"""The analysis of a replay: sections of ``report.html``, and a page of these sections alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from app.analysis.coverage import WITHIN_MM
from app.geometry import ANATOMICAL_WORDS
from app.report.coverage_figures import (
    CoveredSurface,
    coverage_figure,
    coverage_svg,
    covered_surface,
)
from app.report.methods import methods_of, methods_text
from app.report.page import document, length, part, time_text
from app.report.svg_plots import distance_svg, time_svg
from app.report.time_plot import TimePlot, analysed_distance_plot, probability_plot
from app.session import checked_axes

if TYPE_CHECKING:
    from app.analysis import CaseAnalysis, CaseSamples, Insertion
    from app.analysis.breach_probability import Outcome
    from app.analysis.case_breaches import DepthEstimate
    from app.analysis.specimen import Resection
    from app.fixture import MarginParameters
    from app.geometry import FloatArray, SurfaceMesh
    from app.report.record import ReplayLog
    from app.runtime import PreparedCase, ReplayRun

_NAMESPACE = ' xmlns="http://www.w3.org/2000/svg"'


@dataclass(frozen=True, eq=False)
class AnalysedCase:
    """An analysis with what its figures and its methods need.

    ``methods`` as `methods_of` returns them. ``tumor`` is the session's, ``ras_from_tumor`` (3, 3)
    the rotation that was given.
    """

    analysis: "CaseAnalysis"
    methods: Mapping[str, Any]
    margins: "MarginParameters"
    tumor: "SurfaceMesh"
    ras_from_tumor: "FloatArray | None" = None

    def figures(self) -> dict[str, str]:
        """The figures as SVG by their file names."""
        found = self.analysis
        return {
            "distances.svg": distance_svg(
                found.distances_mm, found.held_s, self.margins.stop_mm, self.margins.warn_mm
            ),
            "coverage.svg": coverage_svg(self.covered),
        }

    @cached_property
    def covered(self) -> CoveredSurface:
        """The tumour's surface with its coverage, as both figures of it draw it."""
        places = [breach.on_tumor_mm for breach in self.analysis.breaches]
        return covered_surface(self.tumor, self.analysis.coverage, places, self.ras_from_tumor)


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


def analysis_page(case: AnalysedCase, figures: Mapping[str, str]) -> str:
    """A page of the analysis alone: figures in it, no links."""
    plot = analysed_distance_plot(case.analysis, case.margins)
    return document(
        "analysis.html",
        f"{case.analysis.name}: analysis",
        figures=True,
        name=case.analysis.name,
        distance=_plot(plot, "Signed distance over time"),
        sections=analysis_sections(case, figures),
    )


def analysis_sections(case: AnalysedCase, figures: Mapping[str, str]) -> Markup:
    """The sections: breaches, distances, coverage, sides, volumes, what-if, methods."""
    found = case.analysis
    shares = (
        f"{100.0 * share:.0f} % within {within:g} mm"
        for within, share in found.coverage.shares().items()
    )
    moments = probability_plot(found)
    resection = found.resection
    return part(
        "sections.html",
        breaches=_breaches(found),
        interval=_in_the_interval(case.methods["bias_sigma_mm"]),
        distances_svg=_inline(figures["distances.svg"]),
        percentiles=_distances(found),
        coverage=coverage_figure(case.covered, _inline(figures["coverage.svg"])),
        shares=", ".join(shares),
        sides=_sides(found),
        side_header=(
            *("side", "area", "nearest"),
            *(f"within {within:g} mm" for within in WITHIN_MM),
            *("breaches", "margin of the specimen"),
        ),
        volumes=None if resection is None else _volumes(resection),
        no_specimen="" if resection is None else resection.why,
        insertion=insertion_rows(found.insertion),
        what_if=_what_if(found),
        moments=None if moments is None else _plot(moments, "Probability of a breach over time"),
        methods=methods_text(found, case.methods),
    )


def _inline(svg: str) -> Markup:
    return Markup(svg.replace(_NAMESPACE, "").strip())


def _distances(found: "CaseAnalysis") -> str:
    if not found.percentiles_mm:
        return "No distance is known."
    listed = ", ".join(f"{k} %: {v:.2f} mm" for k, v in found.percentiles_mm.items())
    return (
        f"Percentiles of the measured distance: {listed}. Bars are 1 mm wide; dashed: surface, "
        "stop margin, warning distance."
    )


def _breaches(found: "CaseAnalysis") -> Sequence[Sequence[str]]:
    return [
        (
            str(number),
            time_text(breach.start_s),
            time_text(breach.duration_s),
            breach.direction or "centre",
            breach.part or "-",
            "-" if breach.entry_speed_mm_s is None else f"{breach.entry_speed_mm_s:.0f} mm/s",
            length(breach.lowest_sample_mm),
            *_estimate(breach.estimate),
        )
        for number, breach in enumerate(found.breaches, start=1)
    ]


def _in_the_interval(bias_sigma_mm: float) -> str:
    """A sentence on the errors that the intervals of the depths contain."""
    slow = (
        " Jitter slower than about 1 Hz cannot be told from motion: it is continued by a model, "
        "as for trackers whose noise grows to low frequencies."
    )
    if bias_sigma_mm:
        return (
            "The intervals contain the jitter of the tracker and an error with a standard "
            f"deviation of {bias_sigma_mm:g} mm that is constant over a breach.{slow}"
        )
    return (
        "The intervals contain the jitter of the tracker alone. Errors that are constant over a "
        "breach (registration, calibrations, contour) move the estimate and its interval: "
        f"'marginguard analyse --bias-mm S' adds their standard deviation S.{slow}"
    )


def _estimate(found: "DepthEstimate | None") -> tuple[str, str, str]:
    if found is None:
        return "-", "-", "-"
    return (
        length(found.distance_mm),
        f"{found.low_mm:.2f} to {found.high_mm:.2f} mm",
        f"{found.inside_probability:.3f}",
    )


def _sides(found: "CaseAnalysis") -> Sequence[Sequence[str]]:
    return [
        (
            side.side,
            f"{side.area_mm2:.0f} mm²",
            length(side.nearest_mm),
            *("-" if v is None else f"{100.0 * v:.0f} %" for v in side.shares.values()),
            str(side.breaches),
            length(side.margin_mm),
        )
        for side in found.sides
    ]


def _volumes(resection: "Resection") -> Sequence[tuple[str, str]]:
    rows = []
    if resection.swept is not None:
        rows.append(("swept by the cutting part", _volume(resection.swept.volume_mm3)))
        rows.append(("of it tumour", _volume(resection.tumor_cut_mm3)))
    specimen = resection.specimen
    if specimen is not None:
        closest = specimen.closest
        margin = f"{length(specimen.margins_mm[closest])}, {ANATOMICAL_WORDS[closest]}"
        rows.append(("specimen", _volume(specimen.volume_mm3)))
        rows.append(("tumour outside of it", _volume(specimen.tumor_outside_mm3)))
        rows.append(("closest margin", margin))
    return rows


def insertion_rows(found: "Insertion") -> list[tuple[str, str]]:
    """Name and value with its unit of each metric."""
    rows = [
        ("from the first to the last known tip", f"{found.elapsed_s:.3f} s"),
        ("path of the tip", f"{found.path_mm:.1f} mm"),
        ("time with the tip in the tumour", f"{found.tissue_s:.3f} s"),
        ("path of the tip in the tumour", f"{found.tissue_path_mm:.1f} mm"),
    ]
    if found.tissue_damage_mm2 is not None:
        rows.append(
            ("tissue damage (swept by the tool's axis)", f"{found.tissue_damage_mm2:.1f} mm²")
        )
    return rows


def _volume(value_mm3: float) -> str:
    return f"{value_mm3:.1f} mm³"


def _what_if(found: "CaseAnalysis") -> Sequence[Sequence[str]]:
    risk = found.probability
    if risk is None:
        return ()
    rows = [("as recorded", *_outcome(risk.outcome), "", "")]
    for name, effect in risk.sources.items():
        share = f"{100.0 * effect.variance_share:.0f} %"
        rows.append((f"without the error of {name}", *_outcome(effect.without), share, ""))
        rows.append((f"twice the error of {name}", *_outcome(effect.doubled), share, ""))
    rows.extend(
        (
            f"stop margin of {stop.stop_mm:g} mm",
            *_outcome(stop.outcome),
            "",
            time_text(stop.held_s),
        )
        for stop in risk.stops
    )
    return rows


def _plot(plot: TimePlot, title: str) -> Markup:
    return plot.html(_inline(time_svg(plot, title)), title)


def _outcome(outcome: "Outcome") -> tuple[str, str, str]:
    low, middle, high = outcome.lowest_mm
    return (
        f"{outcome.probability:.3f}",
        time_text(outcome.inside_s),
        f"{middle:.2f} mm ({low:.2f} to {high:.2f})",
    )
