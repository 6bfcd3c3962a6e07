"""The surface of a contour that operators edit, and the tumour of the session that it becomes."""

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields

import numpy as np

from app.contour import Contour, ContourSurface, contour_sigma, contour_size, contour_surface
from app.geometry import InputError, MarginGuardError, Transform
from app.runtime.compute import Compute
from app.runtime.operator_command import SetTumor
from app.workflow.guided_recording import DisplayOperator


class ContourTumor:
    """One surface at a time. The thread that shows it owns it.

    ``compute`` is called in a thread of this object, ``changed()`` from it when a surface is done.
    """

    def __init__(self, compute: Compute, changed: Callable[[], None]) -> None:
        self.surface: ContourSurface | None = None
        """The newest one; None while it is not known."""
        self._problem = ""
        self._contour: Contour | None = None
        """Contour of the newest surface or problem."""
        self._compute = compute
        self._changed = changed
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="contour")
        self._computing: tuple[Contour, Future[ContourSurface]] | None = None

    @property
    def revision(self) -> object:
        """A value that changes when there is something to show."""
        return self._contour, self._is_done

    def follow(self, contour: Contour, pixel_sigma_mm: Callable[[Contour], float]) -> None:
        """Take a surface that is done, and begin to compute that of ``contour`` if it is newer.

        ``pixel_sigma_mm``: the largest standard deviation of a click in its images.
        """
        if self._computing is not None and self._is_done:
            (self._contour, done), self._computing = self._computing, None
            self._take(self._contour, done)
        if not contour.points:
            self.forget()
            self._contour = contour
        elif self._computing is None and not self.is_of(contour):
            sigma_mm = pixel_sigma_mm(contour)
            future = self._worker.submit(self._compute, contour_surface, contour, sigma_mm)
            self._computing = contour, future
            future.add_done_callback(lambda _: self._changed())

    def is_of(self, contour: Contour) -> bool:
        """True if surface and problem are those of ``contour``."""
        known = self._contour
        if known is None or known is contour:
            return known is contour
        return _settings(known) == _settings(contour) and np.array_equal(
            known.positions_mm, contour.positions_mm
        )

    def texts(self) -> tuple[str, str, str]:
        """Size, uncertainty and problem of the newest surface in words; empty where not known."""
        size = "" if self.surface is None else contour_size(self.surface)
        uncertainty = None if self.surface is None else self.surface.uncertainty
        sigma = "" if uncertainty is None else contour_sigma(uncertainty)
        return size, sigma, self._problem

    def can_use(self, contour: Contour) -> bool:
        """True if `command` makes a tumour of ``contour``."""
        surface = self.surface if self.is_of(contour) else None
        return surface is not None and surface.uncertainty is not None

    def command(self, contour: Contour, frame_from_tumor: Transform) -> SetTumor:
        """The command that makes ``contour`` the tumour at ``frame_from_tumor``.

        Raises `InputError` while its surface or the uncertainty of its points is not known.
        """
        if not contour.points:
            raise InputError("contour: no points; expected 4 or more")
        if not self.is_of(contour):
            raise InputError(
                "contour: its surface is being computed; expected the same request in a moment"
            )
        if self.surface is None:
            raise InputError(self._problem)
        if self.surface.uncertainty is None:
            raise InputError(
                "contour: the error of its points is not stated; expected that of the calibration "
                "of the probe, or of the tool's tip, in mm"
            )
        mesh = self.surface.mesh.transformed(frame_from_tumor.inverse())
        return SetTumor(frame_from_tumor, mesh, self.surface.uncertainty.sigma_mm)

    def use(self, contour: Contour, frame_from_tumor: Transform, operator: DisplayOperator) -> None:
        """Request `command`. Raises `InputError`, also where the session cannot take it now."""
        if not operator.request(self.command(contour, frame_from_tumor)):
            raise InputError(
                "contour: the session is not ready for another tumour; expected the same request "
                "later"
            )

    def forget(self) -> None:
        """Drop the surface, and the one that is being computed."""
        self.surface, self._problem = None, ""
        self._contour = self._computing = None

    def close(self) -> None:
        """End the thread."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    @property
    def _is_done(self) -> bool:
        return self._computing is not None and self._computing[1].done()

    def _take(self, contour: Contour, done: "Future[ContourSurface]") -> None:
        self.surface = None
        try:
            self.surface, self._problem = done.result(), ""
        except MarginGuardError as error:
            self._problem = str(error)
        except Exception:
            # Without a surface page and panel go on: they show the session.
            logging.getLogger(__name__).exception("contour of %d points", len(contour.points))
            self._problem = "contour: no surface was found; expected other points"


def _settings(contour: Contour) -> list[object]:
    """All of ``contour`` but the positions of its points."""
    settings = [getattr(contour, each.name) for each in fields(contour) if each.name != "points"]
    return [*settings, *((each.image, each.pixel) for each in contour.points)]
