"""The notebooks of examples/: no stored output, labelled figures, and numbers that hold.

The documentation build executes them with a kernel. Here their cells run in this process, so that
their values can be compared with an independent source.
"""

import json
import math
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import yaml

pytestmark = pytest.mark.long

NOTEBOOKS = ("margin_over_time", "registration_error")


def cells(root: Path, name: str, kind: str) -> list[dict[str, Any]]:
    notebook = json.loads((root / "examples" / f"{name}.ipynb").read_text("utf-8"))
    return [cell for cell in notebook["cells"] if cell["cell_type"] == kind]


@pytest.fixture(scope="module", params=NOTEBOOKS)
def executed(
    request: pytest.FixtureRequest, project_root: Path
) -> tuple[str, dict[str, Any], list[Any]]:
    """Name of the notebook, its variables and its figures."""
    mpl.use("agg")
    from matplotlib import pyplot as plt

    plt.close("all")
    variables: dict[str, Any] = {}
    for cell in cells(project_root, request.param, "code"):
        code = "".join(cell["source"]).replace("%matplotlib inline\n", "")
        exec(compile(code, request.param, "exec"), variables)
    figures = [plt.figure(number) for number in plt.get_fignums()]
    return request.param, variables, figures


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebook_has_no_stored_output(project_root, name):
    for cell in cells(project_root, name, "code"):
        assert cell["outputs"] == []
        assert cell["execution_count"] is None


def test_axes_are_labelled_with_units(executed):
    _, _, figures = executed
    assert len(figures) >= 2
    labels = [
        label
        for figure in figures
        for axes in figure.axes
        for label in (axes.get_xlabel(), axes.get_ylabel())
        if label
    ]
    assert len(labels) >= 2 * len(figures)
    assert [label for label in labels if not label.endswith(("[s]", "[mm]"))] == []


def test_numbers_agree_with_the_truth(executed, project_root):
    name, found, _ = executed
    if name == "margin_over_time":
        truth = yaml.safe_load((project_root / "data/recorded_case/expected.yaml").read_text())
        assert len(found["table"]) == truth["frames"]
        for breach, expected in zip(found["breaches"], truth["breaches"]["intervals"], strict=True):
            assert abs(breach.start_s - expected["start_s"]) < 0.05
            assert abs(breach.min_signed_distance_mm - expected["min_signed_distance_mm"]) < 1.25
        # The last breach is made by the shaft, as the text says.
        assert truth["breaches"]["intervals"][-1]["shaft_only"]
        assert found["tip"]["signed_distance_mm"].min() > 5.0
        assert (found["terms"]["as set"] == 1.0).all()
    else:
        trials = found["trials"]
        for layout, rows in trials.groupby("landmarks"):
            rms = math.sqrt(np.mean(rows["error"] ** 2))
            assert abs(rms / rows["predicted"].iloc[0] - 1.0) < 0.15, layout
            assert abs(np.corrcoef(rows["fre"], rows["error"])[0, 1]) < 0.2, layout
        medians = trials.groupby("landmarks")["fre"].median()
        assert abs(medians.iloc[0] / medians.iloc[1] - 1.0) < 0.1
        first, second = (result.fre_mm for result in found["results"].values())
        assert abs(first - second) < 0.05, "the residuals are alike"
