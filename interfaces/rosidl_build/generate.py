"""From interface files to C, C++ and Python source, by the official rosidl generators."""

import os
from dataclasses import dataclass
from pathlib import Path

import rosidl_generator_c
from rosidl_cli.command.hash.api import generate_type_hashes
from rosidl_cli.command.translate.api import translate
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

from rosidl_build.package import KINDS, InterfacePackage

TYPE_SUPPORTS = (
    "rosidl_typesupport_c",
    "rosidl_typesupport_introspection_c",
    "rosidl_typesupport_fastrtps_c",
)


def ros_root() -> Path:
    """The folder with the ``include``, ``lib`` and ``share`` of the ROS wheels that build us.

    In pip's build isolation this is not ``sys.prefix``, so it is found from a module's place.
    """
    module = Path(rosidl_generator_c.__file__)
    for folder in module.parents:
        if (folder / "share" / "ament_index").is_dir():
            return folder
    raise FileNotFoundError(f"no folder above {module} holds share/ament_index")


@dataclass(frozen=True, slots=True)
class GeneratedPackage:
    """The generators' output for ``package``: ``folder/<generator>/<package>/...``."""

    package: InterfacePackage
    folder: Path

    def of(self, generator: str) -> Path:
        """The folder that ``generator`` filled for this package."""
        return self.folder / generator / self.package.name

    def sources(self, generator: str, pattern: str) -> list[str]:
        """The files of ``generator`` that match ``pattern``, sorted; at least one."""
        files = sorted(str(path) for path in self.of(generator).rglob(pattern))
        if not files:
            raise FileNotFoundError(f"{generator} wrote no {pattern} for {self.package.name}")
        return files

    @property
    def include_dirs(self) -> list[str]:
        """Where the generated headers are, as ``<package>/msg/...`` below each."""
        return [str(path) for path in sorted(self.folder.iterdir()) if path.is_dir()]


def generate(package: InterfacePackage, folder: Path, root: Path) -> GeneratedPackage:
    """Run every generator on ``package``; output goes below ``folder``, which must be empty.

    ``root`` holds the interface packages that this one refers to (see `ros_root`).
    """
    os.environ["AMENT_PREFIX_PATH"] = str(
        root
    )  # the generators find templates and each other there
    include_paths = [str(root / "share" / name) for name in package.others_in(root)]
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

    # Each into a folder of its own: two of them write a file of the same name.
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
    """What a ROS installation keeps in ``share``: folder below the prefix -> files to put there.

    The definitions (as written, as IDL, and as JSON with their hashes), the manifest, and the
    marker files by which ament finds the package.
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
