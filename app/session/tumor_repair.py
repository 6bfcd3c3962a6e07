"""Repair of a case's tumour mesh, if its manifest requests it."""

from app.case import Case, MeshEntry
from app.fixture import repair_mesh


def with_repaired_tumor(case: Case) -> Case:
    """``case`` with a closed tumour mesh if its manifest requests a repair, else ``case`` itself.

    The case's notes list the changes. Raises `MeshError` for a mesh without a safe repair.
    """
    shape = case.manifest.tumor.shape
    # A tumour is never altered without an explicit request.
    if not (isinstance(shape, MeshEntry) and shape.repair):
        return case
    mesh, notes = repair_mesh(case.faulty_tumor_mesh(), f"the tumour's mesh {shape.path}")
    return case.with_tumor_mesh(mesh, notes)
