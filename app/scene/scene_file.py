"""Save and load a scene as MRML's own bundle (``.mrb``), which 3D Slicer opens."""

import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from slicer import vtkCacheManager, vtkDataIOManager, vtkMRMLMessageCollection, vtkMRMLScene
from vtkmodules.vtkCommonCore import (
    vtkCommand,
    vtkLogger,
    vtkOutputWindow,
    vtkStringOutputWindow,
)

from app.files.atomic_io import atomic_file, check_output_path
from app.files.zip_folder import DAMAGE
from app.scene.offscreen import SceneError

SCENE_ENDING = ".mrb"

_MAX_FILES = 20_000
_MAX_BYTES = 4 * 1024**3
"""Limit of all files of a bundle together, unpacked."""


def save_scene(scene: vtkMRMLScene, path: Path) -> None:
    """Write ``scene`` with all its data to ``path`` (``.mrb``) atomically.

    Transforms, points and colours keep all digits, sequences of transforms six. Raises `SceneError`
    for another suffix, for a path that cannot be written, and for errors of MRML.
    """
    if path.suffix.lower() != SCENE_ENDING:
        raise SceneError(f"{path}: suffix is {path.suffix!r}; expected {SCENE_ENDING!r}")
    check_output_path(path, SceneError)
    # MRML names the bundle's content after the file, and writes data at absolute paths only.
    with atomic_file(path, SceneError) as partial:
        messages = vtkMRMLMessageCollection()
        with _quiet():
            written = scene.WriteToMRB(str(partial), None, messages)
        if not (written and partial.is_file()):
            raise SceneError(f"{path}: cannot be written: {_last_error(messages)}")


def load_scene(scene: vtkMRMLScene, path: Path) -> None:
    """Add all nodes of the bundle ``path`` to ``scene``, the scene of a `SceneApplication`.

    Uses MRML's own reader and fetches nothing from a network. Raises `SceneError` for a file that
    is no bundle, is damaged or unpacks too large; nodes that MRML had read by then stay in the
    scene.
    """
    _check_bundle(path)
    messages = vtkMRMLMessageCollection()
    before = scene.GetNumberOfNodes()
    with tempfile.TemporaryDirectory() as folder, _unpacking_into(scene, folder), _quiet():
        read = scene.ReadFromMRB(str(path.absolute()), False, messages)
    if not read or messages.GetNumberOfMessagesOfType(vtkCommand.ErrorEvent):
        raise SceneError(f"{path}: cannot be read as a scene: {_last_error(messages)}")
    if scene.GetNumberOfNodes() == before:
        raise SceneError(f"{path}: cannot be read as a scene: 0 nodes; expected 1 or more")


def _check_bundle(path: Path) -> None:
    """Reject what libarchive unpacks without an error: too much, outside the folder, damaged."""
    try:
        with zipfile.ZipFile(path) as bundle:
            files = bundle.infolist()
            size = sum(file.file_size for file in files)
            if len(files) > _MAX_FILES or size > _MAX_BYTES:
                raise SceneError(
                    f"{path}: unpacks to {len(files)} files of {size} bytes; expected at most "
                    f"{_MAX_FILES} files of {_MAX_BYTES} bytes"
                )
            if not any(file.filename.lower().endswith(".mrml") for file in files):
                raise SceneError(f"{path}: no .mrml file in it; expected a scene bundle")
            outside = _path_outside([file.filename for file in files])
            if outside is not None:
                raise SceneError(
                    f"{path}: unpacks to {outside!r}; expected files inside the folder"
                )
            damaged = bundle.testzip()
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}") from error
    except DAMAGE as error:
        raise SceneError(f"{path}: damaged: {error}; expected a scene bundle") from error
    if damaged is not None:
        raise SceneError(f"{path}: damaged: wrong checksum of {damaged}; expected a scene bundle")


def _path_outside(names: list[str]) -> str | None:
    """The first of ``names`` that leads out of the folder, by itself or through a link; or None."""
    files = {name for name in names if not name.endswith("/")}
    for name in names:
        place = PurePosixPath(name)
        is_outside = place.is_absolute() or ".." in place.parts or "\\" in name or ":" in name
        if is_outside or any(str(folder) in files for folder in place.parents):
            return name
    return None


@contextmanager
def _unpacking_into(scene: vtkMRMLScene, folder: str) -> Iterator[None]:
    """Let MRML unpack bundles into ``folder``, its cache for remote files.

    Without URI handlers nothing is fetched. The data manager of the scene is restored at the end.
    """
    cache, manager = vtkCacheManager(), vtkDataIOManager()
    cache.SetRemoteCacheDirectory(folder)
    manager.SetCacheManager(cache)
    before = scene.GetDataIOManager()
    scene.SetDataIOManager(manager)
    try:
        yield
    finally:
        scene.SetDataIOManager(before)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep MRML from printing each file that it packs and each error."""
    window, verbosity = vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(vtkStringOutputWindow())
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
        vtkOutputWindow.SetInstance(window)


def _last_error(messages: vtkMRMLMessageCollection) -> str:
    """The last error, which is the most general, without the place in MRML's code."""
    errors = [
        messages.GetNthMessageText(number)
        for number in range(messages.GetNumberOfMessages())
        if messages.GetNthMessageType(number) == vtkCommand.ErrorEvent
    ]
    return " ".join(errors[-1].split("): ")[-1].split()) if errors else "MRML gives no reason"
