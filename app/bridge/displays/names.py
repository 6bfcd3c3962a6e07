"""Names of the services for displays, and of the nodes of displays."""

GET_MESH = "~/get_mesh"
COMMAND = "~/command"

PAGE_NODE = "marginguard_page"
PANEL_NODE = "marginguard_panel"
API_NODE = "marginguard_api"

_DISPLAYS = {PAGE_NODE: "the page", PANEL_NODE: "the panel", API_NODE: "the Python API"}


def origin_text(node: str) -> str:
    """The origin under which requests of the node with this full name are listed.

    >>> origin_text("/marginguard_page_7")
    'the page (/marginguard_page_7)'
    """
    name = node.rpartition("/")[2]
    display = next((text for prefix, text in _DISPLAYS.items() if name.startswith(prefix)), "ROS")
    return f"{display} ({node[:80]})"
