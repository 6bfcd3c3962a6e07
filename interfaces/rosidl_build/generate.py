"""Generate C, C++ and Python sources from interface files with the official rosidl generators."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import em
import rosidl_generator_c
from rosidl_cli.command.hash.api import generate_type_hashes
from rosidl_cli.command.translate.api import translate
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_parser import parser
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

from rosidl_build.package import KINDS, InterfacePackage

# Six generators parse each file: a third of the time of the build.
parser.get_ast_from_idl_string = cache(parser.get_ast_from_idl_string)


@cache
def _tokens(prefix: str, template: str) -> list[Any]:
    """Tokens of a template, which ends with a newline or a prefix and a newline, which is none."""
    ended = template if template.endswith("\n") else f"{template}{prefix}\n"
    return list(iter(em.Scanner(prefix, ended).one, None))


def _parse(interpreter: Any, scanner: Any, names: dict[str, Any] | None = None) -> None:
    for token in _tokens(scanner.prefix, scanner.buffer):
        token.run(interpreter, names)


# Each message goes through the same templates, whose scan takes half of the generators' time.
em.Interpreter.parse = _parse

TYPE_SUPPORTS = (
    "rosidl_typesupport_c",
    "rosidl_typesupport_introspection_c",
    "rosidl_typesupport_fastrtps_c",
)


def ros_root() -> Path:
    """Folder with the ``include``, ``lib`` and ``share`` of the installed ROS wheels.

    In pip's build isolation this is not ``sys.prefix``, so it is found from a module's path.
    Raises FileNotFoundError.
    """
    module = Path(rosidl_generator_c.__file__)
    for folder in module.parents:
        if (folder / "share" / "ament_index").is_dir():
            return folder
    raise FileNotFoundError(f"no folder above {module} holds share/ament_index")


@dataclass(frozen=True, slots=True)
class GeneratedPackage:
    """Output of the generators for ``package``, in ``folder/<generator>/<package>/...``."""

    package: InterfacePackage
    folder: Path

    def of(self, generator: str) -> Path:
        """Folder of the output of ``generator`` for this package."""
        return self.folder / generator / self.package.name

    def sources(self, generator: str, pattern: str) -> list[str]:
        """Sorted output files of ``generator`` that match ``pattern``.

        Raises FileNotFoundError if there is none.
        """
        files = sorted(str(path) for path in self.of(generator).rglob(pattern))
        if not files:
            raise FileNotFoundError(f"{generator} wrote no {pattern} for {self.package.name}")
        return files

    @property
    def include_dirs(self) -> list[str]:
        """Folders that contain the generated headers as ``<package>/msg/...``."""
        return [str(path) for path in sorted(self.folder.iterdir()) if path.is_dir()]


def generate(
    package: InterfacePackage,
    folder: Path,
    root: Path,
    siblings: Iterable[GeneratedPackage] = (),
) -> GeneratedPackage:
    """Run all generators on ``package``; they write below ``folder``, which must be empty.

    ``root`` contains the installed interface packages that this one may refer to (see `ros_root`);
    ``siblings`` are those of the same build, and have precedence.
    """
    # The generators find their templates and each other below this path.
    os.environ["AMENT_PREFIX_PATH"] = str(root)
    built = {each.package.name: str(each.of("rosidl_adapter")) for each in siblings}
    installed = {name: str(root / "share" / name) for name in package.others_in(root)}
    include_paths = list((installed | built).values())
    generated = GeneratedPackage(package, folder)

    definitions = generated.of("rosidl_adapter")
    idl_files = translate(
        package_name=package.name,
        interface_files=[f"{package.folder}:{path.as_posix()}" for path in package.interface_files],
        output_format="idl",
        output_path=definitions,
    )
    hashes = generate_type_hashes(
        package_name=package.name,
        interface_files=idl_files,
        include_paths=include_paths,
        output_path=definitions,
    )

    # One folder per generator, because two of them write a file of the same name.
    GenerateC("c").generate(
        package.name, idl_files, include_paths, generated.of("rosidl_generator_c"), hashes
    )
    for name, generator in (
        (
            "rosidl_typesupport_introspection_c",
            GenerateIntrospectionCTypesupport("introspection_c"),
        ),
        ("rosidl_typesupport_fastrtps_c", GenerateFastRTPSCTypesupport("fastrtps_c")),
        (
            "rosidl_typesupport_c",
            GenerateCTypesupport("c", typesupport_implementations=list(TYPE_SUPPORTS[1:])),
        ),
        (
            "rosidl_generator_py",
            GeneratePython("py", typesupport_implementations=list(TYPE_SUPPORTS)),
        ),
    ):
        generator.generate(package.name, idl_files, include_paths, generated.of(name))
    return generated


def shared_files(generated: GeneratedPackage) -> dict[str, list[str]]:
    """Files of the package in ``share``, by folder relative to the installation prefix.

    These are the definitions (as written, as IDL, and as JSON with their hashes), the manifest, and
    the marker files by which ament finds the package.
    """
    package = generated.package
    share = f"share/{package.name}"
    files: dict[str, list[str]] = {share: [str(package.folder / "package.xml")]}
    for kind in KINDS:
        found = [
            str(package.folder / path) for path in package.interface_files if path.parts[0] == kind
        ]
        found += [str(path) for path in sorted((generated.of("rosidl_adapter") / kind).glob("*.*"))]
        if found:
            files[f"{share}/{kind}"] = found
    for index, text in (
        ("packages", ""),
        ("rosidl_interfaces", "\n".join(path.as_posix() for path in package.interface_files)),
    ):
        marker = generated.folder.parent / f"{package.name}.{index}" / package.name
        marker.parent.mkdir(parents=True, exist_ok=True)
        marker.write_text(text)
        files[f"share/ament_index/resource_index/{index}"] = [str(marker)]
    return files
