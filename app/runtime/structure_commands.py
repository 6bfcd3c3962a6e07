"""The tumour and the structures beside it, changed in a running session by an operator."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from app.geometry import FrameError, InputError, SurfaceMesh, Transform
from app.runtime.content import SessionContent, StructureContent
from app.runtime.requests import RequestKind
from app.runtime.session_changes import (
    ContentChange,
    SessionChanges,
    check_structure,
    check_surface,
    checked_reason,
    model_of,
)
from app.session import ProximityModel, SessionSetup, Structure
from app.session.structure import with_named
from app.session.tumor_replacement import TUMOR


class StructureCommands(SessionChanges):
    """Replace the tumour; add, replace and switch the structures beside it.

    Slow work (distance field and surfaces of a new structure) is done before the session is locked.
    """

    _off: Mapping[str, tuple[Structure, StructureContent]] = MappingProxyType({})
    """Structures that are switched off, by name."""

    def set_tumor(
        self,
        frame_from_tumor: Transform,
        tumor: SurfaceMesh,
        *,
        sigma_mm: float = 0.0,
        origin: str,
    ) -> str:
        """Use this tumour surface instead; returns its ``model_id``. Latches a hold.

        ``sigma_mm``: standard deviation of the surface along its normal, 0 where it is not stated.
        Raises `MeshError` for a surface that is not closed, `InputError` for one of too many
        triangles, and `FrameError` for another frame than the one that the tumour moves with,
        since that is what the session tracks.
        """
        with self._listed(RequestKind.TUMOR, origin) as done, self._changing:
            setup, shown = self.setup, self._acknowledged
            known = setup.frame_from_tumor
            if (frame_from_tumor.target, frame_from_tumor.source) != (known.target, known.source):
                raise FrameError(
                    f"tumour: given in frame {frame_from_tumor.target!r}; expected "
                    f"{known.target!r}, the frame that the session tracks it by"
                )
            check_surface(tumor, sigma_mm, self._max_triangles)
            new: dict[str, Any] = {
                "tumor": tumor,
                "tumor_accepted": True,
                "tumor_sigma_mm": sigma_mm,
            }
            further = ""
            if sigma_mm != shown.tumor_sigma_mm:
                further = f", uncertainty from {shown.tumor_sigma_mm:.2f} to {sigma_mm:.2f} mm"
            change = self._use_surface(
                tumor,
                frame_from_tumor,
                shown.tumor.transformed(shown.frame_from_tumor),
                setup,
                shown,
                lambda content: content.with_edge(frame_from_tumor, **new),
                lambda setup, proximity, _: replace(setup, proximity=proximity),
                further=further,
            )
            done.append(f"{self._content.model_id}, {change}")
        return self._content.model_id

    def set_structure(
        self, structure: StructureContent, frame_from_structure: Transform, *, origin: str
    ) -> str:
        """Guard ``structure`` from the next step on; returns the new ``setup_id``.

        Latches a hold if it replaces one of its name, not if it is new or was switched off. A frame
        that the tracker does not measure makes the state UNKNOWN. Raises `MeshError` for a surface
        that is not closed, `InputError` for one of too many triangles, and as `check_structure`.
        """
        name = structure.name
        what = f"structure {name!r}"
        with self._listed(RequestKind.STRUCTURE, origin) as done, self._changing:
            with self._between_steps() as session:
                setup, known_frames = session.setup, session.known_frames
            check_structure(setup, known_frames, structure, frame_from_structure)
            check_surface(structure.surface, structure.sigma_mm, self._max_triangles, what)
            shown = self._acknowledged
            # One that was added since the last re-arm is compared with itself.
            seen = shown if shown.structure(name) is not None else self._content
            former = seen.structure(name)

            def used(setup: SessionSetup, proximity: ProximityModel, change: str) -> SessionSetup:
                values = structure.stop_mm, structure.warn_mm, structure.sigma_mm, structure.role
                new = Structure(frame_from_structure, proximity, *values, change)
                return _with_structure(setup, new)

            change = self._use_surface(
                structure.surface,
                frame_from_structure,
                None if former is None else former.surface.transformed(seen.static_edge(name)),
                setup,
                shown,
                lambda content: content.with_structure(structure, frame_from_structure),
                used,
                what=what,
            )
            self._forget_off(name)
            done.append(f"{self._content.setup_id}, {change or f'{what} added'}")
        return self._content.setup_id

    def switch_structure(self, name: str, *, on: bool, reason: str = "", origin: str) -> str:
        """Guard the structure ``name`` no more, or again; returns the new ``setup_id``.

        To switch it off needs a ``reason`` and latches a hold. It is then listed as off with the
        reason (`StepResult.off`) until it is guarded again, with the surface and the margins that
        it had. Raises `InputError` for the tumour, without a reason, and for a structure that is
        not known or is so already.
        """
        what = f"structure {name!r}"
        with self._listed(RequestKind.SWITCH, origin) as done, self._changing:
            with self._between_steps() as session:
                setup, known_frames = session.setup, session.known_frames
            guarded = {each.name: each for each in setup.structures}
            if name == setup.guarded[0].name:
                raise InputError(f"{what}: is the tumour; expected a structure beside it")
            if name not in (choices := setup.off if on else guarded):
                raise InputError(
                    f"{what}: is {'not off' if on else 'not guarded'}; expected one of "
                    f"{', '.join(choices) or 'the structures, of which there is none'}"
                )
            if on:
                structure, shown = self._off[name]
                edge = structure.frame_from_structure
                check_structure(setup, known_frames, shown, edge)
                self._change(
                    lambda content: content.with_structure(shown, edge),
                    lambda setup: _with_structure(setup, structure),
                )
                self._forget_off(name)
                done.append(f"{what} is guarded again{f': {reason}' if reason.strip() else ''}")
            else:
                reason = checked_reason(reason, name)
                shown = next(each for each in self._content.structures if each.name == name)
                self._change(
                    lambda content: content.without_structure(name),
                    lambda setup: _without_structure(setup, name, reason),
                )
                self._off = {**self._off, name: (guarded[name], shown)}
                done.append(f"{what} switched off: {reason}")
        return self._content.setup_id

    def _forget_off(self, name: str) -> None:
        self._off = {each: off for each, off in self._off.items() if each != name}

    def _use_surface(
        self,
        surface: SurfaceMesh,
        edge: Transform,
        before: SurfaceMesh | None,
        setup: SessionSetup,
        shown: SessionContent,
        change: ContentChange,
        used: Callable[[SessionSetup, ProximityModel, str], SessionSetup],
        *,
        what: str = TUMOR,
        further: str = "",
    ) -> str:
        """Prepare ``surface`` while the session continues, then use it as `_change` does.

        Returns how it differs from ``before``, in the frame that it moves with, which is that of
        ``shown``, the content that was acknowledged; ``further`` is added to that text.
        """
        content = change(self._content)
        # At once: the outputs are prepared in this process, the model usually in another one.
        with ThreadPoolExecutor(max_workers=1) as other_thread:
            preparing = other_thread.submit(self._prepare, content)
            proximity, text = model_of(
                surface, edge, before, setup, shown.tool, self._compute, what
            )
            switches = preparing.result()
        text += further
        _ = content.setup_id  # computed now, before the session waits for it
        with self._between_steps() as session:
            if shown is not self._acknowledged:
                raise InputError(
                    f"{what}: the session was re-armed while it was prepared; expected the "
                    "same request again"
                )
            content = change(self._content)
            setup = used(content.setup(session.requested), proximity, text)
            self._apply(session, setup, content, switches, text if what == TUMOR else "")
        return text


def _with_structure(setup: SessionSetup, structure: Structure) -> SessionSetup:
    off = {name: reason for name, reason in setup.off.items() if name != structure.name}
    return replace(setup, structures=with_named(setup.structures, structure), off=off)


def _without_structure(setup: SessionSetup, name: str, reason: str) -> SessionSetup:
    kept = tuple(each for each in setup.structures if each.name != name)
    return replace(setup, structures=kept, off={**setup.off, name: reason})
