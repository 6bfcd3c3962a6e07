"""Methods of an analysis: versions, hashes of the inputs, date of the recording, options."""

from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from app.files.bounded_io import is_file, is_folder
from app.files.paths import sha256_of
from app.geometry import NS_PER_S

if TYPE_CHECKING:
    from app.analysis import CaseAnalysis
    from app.case import Case
    from app.runtime import PreparedCase

LIBRARIES = ("numpy", "scipy", "manifold3d", "python-fcl")
_FIRST_YEAR, _LAST_YEAR = 2000, 2100


def methods_of(
    prepared: "PreparedCase",
    first_ns: int,
    program: str,
    *,
    bias_sigma_mm: float = 0.0,
    error_sigmas_mm: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The methods as JSON types; ``first_ns`` is the stamp of the first frame.

    ``recorded``: the date of the recording, None if its clock does not count from 1970. ``program``
    is the version of MarginGuard. Raises `InputError` for a file that cannot be read.
    """
    return {
        "version": program,
        "libraries": {name: version(name) for name in LIBRARIES},
        "inputs_sha256": input_digests(prepared.case),
        "tumor": prepared.content.model_id,
        "recorded": recorded_on(first_ns),
        "tip_only": prepared.tip_only,
        "bias_sigma_mm": bias_sigma_mm,
        "error_sigmas_mm": dict(error_sigmas_mm or {}),
        "depth": "Gaussian process regression with estimated jitter; docs/analysis.md",
    }


def input_digests(case: "Case") -> dict[str, str]:
    """The SHA-256 of ``case.yaml``, of each file of the recording, and of those of tumour and tool.

    By their names in ``case.yaml``; files of a recording that is a folder are named after it:
    ``tracking/0.mcap``. Raises `InputError` for a file that cannot be read.
    """
    files = {"case.yaml": case.folder / "case.yaml"}
    recording = case.recording_path
    if recording is not None and is_folder(recording):
        found = sorted(path for path in recording.rglob("*") if is_file(path))
        files |= {f"{recording.name}/{path.relative_to(recording)}": path for path in found}
    elif recording is not None:
        files[recording.name] = recording
    tumor, tool = case.manifest.tumor, case.manifest.tool
    files[tumor.shape.path] = case.file(tumor.shape.path, f"{tumor.shape_key}.path")
    if tool.mesh is not None:
        files[tool.mesh.path] = case.file(tool.mesh.path, "tool.mesh.path")
    return {name: sha256_of(path) for name, path in files.items()}


def recorded_on(first_ns: int) -> str | None:
    """The date and time in UTC of a stamp that counts from 1970; None for another clock."""
    try:
        found = datetime.fromtimestamp(first_ns / NS_PER_S, UTC)
    except (OverflowError, OSError, ValueError):
        return None
    if not _FIRST_YEAR <= found.year < _LAST_YEAR:
        return None
    return found.strftime("%Y-%m-%d %H:%M:%S UTC")


def methods_text(analysis: "CaseAnalysis", methods: Mapping[str, Any]) -> str:
    """One paragraph for a paper or a protocol."""
    hashes = ", ".join(f"{name} (SHA-256 {sha})" for name, sha in methods["inputs_sha256"].items())
    libraries = ", ".join(f"{name} {number}" for name, number in methods["libraries"].items())
    recorded = methods["recorded"] or "at a date that its clock does not state"
    tool = "the tip of the tool" if methods["tip_only"] else "the mesh of the tool"
    sentences = [
        f"The case was recorded {recorded} ({analysis.frames} frames in "
        f"{analysis.duration_s:.1f} s) and analysed with MarginGuard {methods['version']} "
        f"({libraries}).",
        f"Inputs: {hashes}; tumour {methods['tumor']}.",
        f"Distances are signed distances of {tool} to the tumour's surface, negative inside.",
        "A breach is a run of frames with a negative distance.",
        _depth(analysis, methods),
        "Sides are the nearest of six directions from the tumour's centroid, in "
        + (
            "the given axes of the patient."
            if analysis.anatomical
            else "the axes of the tumour's file, taken as right, anterior and superior."
        ),
        "Coverage is the least distance of the tool to each face of the tumour.",
    ]
    found = analysis.resection
    swept = None if found is None else found.swept
    if found is not None and swept is not None:
        sentences.append(
            f"The swept volume is the union of {swept.hulls} convex hulls of the last "
            f"{found.cutting_mm:g} mm of the tool, whose smoothed path they follow within "
            f"{swept.tolerance_mm:.2f} mm."
        )
    errors = methods["error_sigmas_mm"]
    if errors:
        listed = ", ".join(f"{name} {sigma:g} mm" for name, sigma in errors.items())
        sentences.append(
            f"Probabilities of a breach assume constant normal errors ({listed} along each axis), "
            "by Monte Carlo with common random numbers."
        )
    return " ".join(sentences)


def _depth(analysis: "CaseAnalysis", methods: Mapping[str, Any]) -> str:
    if analysis.jitter is None:
        return "The case is too short for an estimate of the jitter: depths have no interval."
    bias = methods["bias_sigma_mm"]
    constant = f" and of a constant error of {bias:g} mm" if bias else " alone"
    return (
        "The depth is estimated by Gaussian process regression with a jitter of "
        f"{analysis.jitter.sigma_mm:.3f} mm; its 95 % intervals are those of the jitter{constant}. "
        "Jitter slower than about 1 Hz is continued by a model from faster jitter."
    )
