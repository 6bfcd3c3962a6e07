"""The twenty pairs of shapes: each tumour with each tool."""

from dataclasses import dataclass

from app.geometry import SurfaceMesh
from benchmarks.fixture_shapes import TOOLS, TUMORS, tool, tumor


@dataclass(frozen=True)
class Pair:
    """A tumour and a tool by name; ``number`` seeds its poses."""

    number: int
    tumor_kind: str
    tool_kind: str

    @property
    def name(self) -> str:
        """Both names."""
        return f"{self.tumor_kind} / {self.tool_kind}"

    def meshes(self, subdivisions: int) -> tuple[SurfaceMesh, SurfaceMesh]:
        """Tumour and tool; 20 * 4^subdivisions triangles a sphere of the tumour."""
        return tumor(self.tumor_kind, subdivisions), tool(self.tool_kind)


PAIRS = tuple(
    Pair(number, *kinds)
    for number, kinds in enumerate((tumor, tool) for tumor in TUMORS for tool in TOOLS)
)
