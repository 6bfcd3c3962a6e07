"""Sphinx extension: links to files that are no pages of the site lead to the repository.

A page links `../data/live_example/live.yaml` relative to itself, as the web view of a Git host
needs it. MyST makes a download of such a link; here it becomes a link into the repository.
"""

from pathlib import PurePosixPath
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform


class RepositoryLinks(SphinxTransform):
    """Replace downloads of files of the project by links to the repository."""

    default_priority = 5  # before Sphinx collects the files to be downloaded

    def apply(self, **kwargs: Any) -> None:
        """Replace the nodes of one page."""
        root = self.env.srcdir
        for node in list(self.document.findall(addnodes.download_reference)):
            _, absolute = self.env.relfn2path(node["reftarget"], self.env.docname)
            path = PurePosixPath(absolute).relative_to(PurePosixPath(root))
            self.env.note_dependency(absolute)
            url = f"{self.config.repository_url}/blob/main/{path}"
            node.replace_self(nodes.reference("", "", *node.children, refuri=url))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the transform and the setting ``repository_url``."""
    app.add_config_value("repository_url", "", "env")
    app.add_transform(RepositoryLinks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
