"""The tumour's mesh of a case, repaired where the case asks for that, and said."""

from app.case import Case, MeshEntry
from app.fixture import repaired


def with_repaired_tumor(case: Case) -> Case:
    """``case`` with a tumour's mesh that bounds a solid, where its manifest has it repaired.

    What was done is among the case's notes. Raises `MeshError` for a mesh without a safe repair.
    """
    shape = case.manifest.tumor.shape
    # Never without being asked: a surgeon's tumour is not altered in silence.
    if not (isinstance(shape, MeshEntry) and shape.repair):
        return case
    mesh, notes = repaired(case.faulty_tumor_mesh(), f"the tumour's mesh {shape.path}")
    return case.with_tumor_mesh(mesh, notes)
