"""A scene as a file: MRML's own bundle (``.mrb``), which 3D Slicer opens by a double click."""

import struct
import tempfile
import zipfile
import zlib
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
from app.scene.errors import SceneError

SCENE_ENDING = ".mrb"

_MAX_FILES = 20_000
_MAX_BYTES = 4 * 1024**3
"""Of all files of a bundle, unpacked."""
_DAMAGE = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, ValueError, RuntimeError)
"""What `zipfile` raises for damaged bytes, for a password and for methods that it does not know."""


def save_scene(scene: vtkMRMLScene, path: Path) -> None:
    """Write ``scene`` with all its data to ``path`` (``.mrb``), whole or not at all.

    Transforms, points and colours are kept to the last digit, sequences of transforms to six
    digits. Raises `SceneError` for another ending, a place that cannot be written, and whatever
    MRML refuses to write.
    """
    _check_place(path)
    # MRML names the bundle's content after the file, and writes data at absolute paths only.
    with atomic_file(path, SceneError) as partial:
        messages = vtkMRMLMessageCollection()
        with _quiet():
            written = scene.WriteToMRB(str(partial), None, messages)
        if not (written and partial.is_file()):
            raise SceneError(f"{path} cannot be written: {_said(messages)}")


def load_scene(scene: vtkMRMLScene, path: Path) -> None:
    """Add all that the bundle ``path`` holds to ``scene``, which a `SceneApplication` has taken.

    By MRML's own reader, with nothing fetched from a network. Raises `SceneError`, in one line, for
    a file that is no bundle, one that is damaged, and one that grows too large; what MRML had read
    by then stays in the scene.
    """
    _check_bundle(path)
    messages = vtkMRMLMessageCollection()
    before = scene.GetNumberOfNodes()
    with tempfile.TemporaryDirectory() as folder, _unpacking_into(scene, folder), _quiet():
        read = scene.ReadFromMRB(str(path.absolute()), False, messages)
    if not read or messages.GetNumberOfMessagesOfType(vtkCommand.ErrorEvent):
        raise SceneError(f"{path} cannot be read as a scene: {_said(messages)}")
    if scene.GetNumberOfNodes() == before:
        raise SceneError(f"{path} cannot be read as a scene: it has no nodes")


def _check_bundle(path: Path) -> None:
    """What libarchive unpacks without a word: too much, elsewhere, and damaged bytes."""
    try:
        with zipfile.ZipFile(path) as bundle:
            files = bundle.infolist()
            size = sum(file.file_size for file in files)
            if len(files) > _MAX_FILES or size > _MAX_BYTES:
                raise SceneError(
                    f"{path} unpacks to {len(files)} files of {size} bytes: "
                    f"{_MAX_FILES} files of {_MAX_BYTES} bytes allowed"
                )
            if not any(file.filename.lower().endswith(".mrml") for file in files):
                raise SceneError(f"{path} is no scene bundle: no .mrml file is in it")
            astray = _astray([file.filename for file in files])
            if astray is not None:
                raise SceneError(f"{path} would be unpacked to {astray!r}: a file inside wanted")
            damaged = bundle.testzip()
    except OSError as error:
        raise SceneError(f"{path} cannot be read: {error.strerror or error}") from error
    except _DAMAGE as error:
        raise SceneError(f"{path} is no whole scene bundle: {error}") from error
    if damaged is not None:
        raise SceneError(f"{path} is damaged: {damaged} in it is not what was saved")


def _astray(names: list[str]) -> str | None:
    """The first name that leads out of the folder: by itself, or through a link among the files."""
    files = {name for name in names if not name.endswith("/")}
    for name in names:
        place = PurePosixPath(name)
        is_outside = place.is_absolute() or ".." in place.parts or "\\" in name or ":" in name
        if is_outside or any(str(folder) in files for folder in place.parents):
            return name
    return None


def _check_place(path: Path) -> None:
    if path.suffix.lower() != SCENE_ENDING:
        raise SceneError(f"{path} is no scene file: {SCENE_ENDING} wanted")
    check_output_path(path, SceneError)


@contextmanager
def _unpacking_into(scene: vtkMRMLScene, folder: str) -> Iterator[None]:
    """MRML unpacks bundles into the cache for remote files; without URI handlers none is fetched.

    Desktop Slicer's scene has one already, and gets it back.
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
    """MRML prints each file that it packs and each error: its collection of messages has those."""
    window, verbosity = vtkOutputWindow.GetInstance(), vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(vtkStringOutputWindow())
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
        vtkOutputWindow.SetInstance(window)


def _said(messages: vtkMRMLMessageCollection) -> str:
    """The last error, which is the nearest to what was asked, without the place in MRML's code."""
    errors = [
        messages.GetNthMessageText(number)
        for number in range(messages.GetNumberOfMessages())
        if messages.GetNthMessageType(number) == vtkCommand.ErrorEvent
    ]
    return " ".join(errors[-1].split("): ")[-1].split()) if errors else "MRML does not say why"
