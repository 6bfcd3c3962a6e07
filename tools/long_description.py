"""Build step: absolute links in the description of the package.

README.md has relative links, which a Git host resolves. A package index shows the same text without
the repository, so the metadata of the wheel get absolute links.
"""

import re

from setuptools.command.egg_info import egg_info

LINK = re.compile(r"(?P<before>(?P<image>!?)\[[^]]*\]\()(?P<target>(?!\w+:|#|/)[^)\s]+)\)")


def absolute_links(text: str, repository: str) -> str:
    """``text`` with its relative links below ``repository``; pictures as raw files."""

    def absolute(found: re.Match[str]) -> str:
        kind = "raw" if found["image"] else "blob"
        return f"{found['before']}{repository}/{kind}/main/{found['target']})"

    return LINK.sub(absolute, text)


class MetadataWithAbsoluteLinks(egg_info):
    """``egg_info``, which all builds take the metadata from."""

    def finalize_options(self) -> None:
        """Replace the links of the description before the metadata are written."""
        super().finalize_options()
        metadata = self.distribution.metadata
        repository = metadata.project_urls["Repository"]
        metadata.long_description = absolute_links(metadata.long_description, repository)
