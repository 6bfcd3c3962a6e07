"""Web page that shows a session: renders a scene on the server and streams it to a browser.

Most modules import slicer, vtk and trame, which takes some seconds. The package imports neither ROS
nor files: the caller passes the steps of a recorded or live session.
"""

import lazy_loader

# Import each name of `__init__.pyi` on first access: unused modules are not loaded.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
