"""Results of the case on each of the six sides of the tumour."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.analysis.case_breaches import AnalysedBreach
from app.analysis.coverage import WITHIN_MM, Coverage
from app.geometry import ANATOMICAL_WORDS, FloatArray, SurfaceMesh

SIDES = "RLAPSI"


@dataclass(frozen=True, slots=True)
class SideResult:
    """One side, the faces whose direction from the centroid is nearest to one of six directions.

    ``area_mm2``: of the faces. ``nearest_mm``: least distance of the tool to those that `Coverage`
    uses, None if it is above the largest of `WITHIN_MM`. ``shares``: of their area that the tool
    came nearer to than each of `WITHIN_MM`, None without such a face. ``breaches``: how many.
    ``margin_mm``: closest margin of the specimen, None without one.
    """

    side: str
    area_mm2: float
    nearest_mm: float | None
    shares: Mapping[str, float | None]
    breaches: int
    margin_mm: float | None


def sides_of_surface(
    tumor: SurfaceMesh, ras_from_tumor: FloatArray | None = None
) -> NDArray[np.str_]:
    """The letter of the side of each face (m,) of ``tumor``, seen from its centroid."""
    centres = tumor.triangles_mm.mean(axis=1) - tumor.centroid_mm
    turned = centres if ras_from_tumor is None else centres @ ras_from_tumor.T
    axis = np.abs(turned).argmax(axis=1)
    positive = np.take_along_axis(turned, axis[:, None], axis=1)[:, 0] > 0.0
    return np.asarray(np.array(list(SIDES))[2 * axis + np.where(positive, 0, 1)])


def side_results(
    tumor: SurfaceMesh,
    coverage: Coverage,
    breaches: Sequence[AnalysedBreach],
    margins_mm: Mapping[str, float],
    ras_from_tumor: FloatArray | None = None,
) -> tuple[SideResult, ...]:
    """The results of the six sides; ``margins_mm`` are those of the specimen, empty without one."""
    letters = sides_of_surface(tumor, ras_from_tumor)
    corners = tumor.triangles_mm
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    return tuple(
        _side(
            letter,
            float(areas[letters == letter].sum()),
            coverage,
            letters[coverage.faces] == letter,
            breaches,
            margins_mm.get(letter),
        )
        for letter in SIDES
    )


def _side(
    letter: str,
    area_mm2: float,
    coverage: Coverage,
    chosen: NDArray[np.bool_],
    breaches: Sequence[AnalysedBreach],
    margin_mm: float | None,
) -> SideResult:
    areas, nearest = coverage.areas_mm2[chosen], coverage.nearest_mm[chosen]
    sampled = float(areas.sum())
    word = ANATOMICAL_WORDS[letter]
    least = float(nearest.min(initial=np.inf))
    return SideResult(
        word,
        area_mm2,
        least if np.isfinite(least) else None,
        {
            f"within_{within:g}_mm": float(areas[nearest <= within].sum()) / sampled
            if sampled > 0.0
            else None
            for within in WITHIN_MM
        },
        sum(breach.side == word for breach in breaches),
        margin_mm,
    )
