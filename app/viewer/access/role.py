"""Roles of an open page."""

from enum import Enum


class Role(Enum):
    """Permissions of a page. The token with which it was opened decides."""

    VIEW = "view"
    """See everything, change nothing: neither the replay nor the picture that all pages share."""
    OPERATE = "operate"
    """Also use the controls."""

    def may(self, required: "Role") -> bool:
        """True if a page of this role may do what needs ``required``."""
        return self is required or self is Role.OPERATE
