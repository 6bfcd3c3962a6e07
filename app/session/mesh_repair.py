"""Repair of the meshes of a case, tumour and tool, where its manifest requests it."""

from app.case import Case, MeshEntry, MeshOwner


def with_repaired_meshes(case: Case) -> Case:
    """``case`` with sound meshes where its manifest requests a repair, else ``case`` itself.

    The case's notes list the changes. Raises `MeshError` for a mesh without a safe repair.
    """
    tumor, tool = case.manifest.tumor.shape, case.manifest.tool.mesh
    # A mesh is never altered without an explicit request.
    if isinstance(tumor, MeshEntry) and tumor.repair:
        case = _repaired(case, "tumor", f"the tumour's mesh {tumor.path}")
    if tool is not None and tool.repair:
        case = _repaired(case, "tool", f"the tool's mesh {tool.path}")
    return case


def _repaired(case: Case, of: MeshOwner, what: str) -> Case:
    from app.fixture import repair_mesh  # imports scipy's sparse matrices, which is slow

    mesh, notes = repair_mesh(case.faulty_mesh(of), what)
    return case.with_repaired_mesh(of, mesh, notes)
