"""Sections of ``report.html`` that show an analysis, and a page of these sections alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from app.analysis.coverage import WITHIN_MM
from app.geometry import ANATOMICAL_WORDS
from app.report.case_plots import analysed_distance_plot, probability_plot
from app.report.coverage_svg import coverage_svg
from app.report.coverage_view import coverage_figure
from app.report.covered_surface import CoveredSurface, covered_surface
from app.report.distance_svg import distance_svg
from app.report.insertion_table import insertion_rows
from app.report.methods import methods_text
from app.report.page import document, length, part, time_text
from app.report.time_plot import TimePlot
from app.report.time_svg import time_svg

if TYPE_CHECKING:
    from app.analysis import CaseAnalysis
    from app.analysis.breach_probability import Outcome
    from app.analysis.depth import DepthEstimate
    from app.analysis.specimen import Resection
    from app.fixture import MarginParameters
    from app.geometry import FloatArray, SurfaceMesh

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
    if bias_sigma_mm:
        return (
            "The intervals contain the jitter of the tracker and an error with a standard "
            f"deviation of {bias_sigma_mm:g} mm that is constant over a breach."
        )
    return (
        "The intervals contain the jitter of the tracker alone. Errors that are constant over a "
        "breach (registration, calibrations, contour) move the estimate and its interval: "
        "'marginguard analyse --bias-mm S' adds their standard deviation S."
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
