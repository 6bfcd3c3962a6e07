"""Compile and link the libraries and extension modules of one interface package."""

import fnmatch
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

from rosidl_build.generate import GeneratedPackage
from rosidl_build.package import InterfacePackage


@dataclass(frozen=True, slots=True)
class Library:
    """Shared library ``lib<package>__<generator>.so`` made from the sources that match ``pattern``.

    ``own`` names the libraries of the same package that it needs, ``runtime`` those of ROS. The
    sources are compiled as one unit, in a fifth of the time, but for those that match ``apart``,
    which define the same names.
    """

    generator: str
    pattern: str
    own: tuple[str, ...]
    runtime: tuple[str, ...]
    python: bool = False
    apart: str = ""


BASE = ("rosidl_runtime_c", "rcutils")

LIBRARIES = (
    Library("rosidl_generator_c", "*.c", (), BASE, apart="*__description.c"),
    Library(
        "rosidl_typesupport_introspection_c",
        "*.c",
        ("rosidl_generator_c",),
        ("rosidl_typesupport_introspection_c", *BASE),
    ),
    Library(
        "rosidl_typesupport_fastrtps_c",
        "*.cpp",
        ("rosidl_generator_c",),
        (
            "rosidl_typesupport_fastrtps_c",
            "rosidl_typesupport_fastrtps_cpp",
            "fastcdr",
            "rmw",
            *BASE,
        ),
    ),
    Library(
        "rosidl_typesupport_c",
        "*.cpp",
        ("rosidl_generator_c",),
        ("rosidl_typesupport_c", *BASE),
    ),
    Library(
        "rosidl_generator_py",
        "_*_s.c",
        ("rosidl_generator_c", "rosidl_typesupport_c"),
        BASE,
        python=True,
    ),
)


@dataclass(frozen=True, slots=True)
class Linker:
    """Compiles and links the output of the generators with a setuptools ``compiler``.

    ``root`` is the prefix of the ROS wheels; object files go below ``objects``. ``built`` has the
    folder of the libraries of each package of this build that later packages may refer to.
    """

    compiler: Any
    root: Path
    objects: Path
    include_dirs: tuple[str, ...]
    jobs: int
    built: tuple[tuple[GeneratedPackage, Path], ...] = ()

    @property
    def siblings(self) -> tuple[GeneratedPackage, ...]:
        """Packages of this build that later packages may refer to."""
        return tuple(generated for generated, _ in self.built)

    def with_sibling(self, generated: GeneratedPackage, output: Path) -> "Linker":
        """The same linker for packages that may refer to one whose libraries are in ``output``."""
        return replace(self, built=(*self.built, (generated, output)))

    def compile(self, sources: Iterable[str], generated: GeneratedPackage) -> list[str]:
        """Compile ``sources`` in parallel; return the object files in the same order."""
        headers = (
            self.root / "include"
        )  # most packages have their headers one level deeper, fastcdr has not
        includes = [
            *(path for each in (generated, *self.siblings) for path in each.include_dirs),
            str(headers),
            *(str(path) for path in sorted(headers.iterdir()) if path.is_dir()),
            *self.include_dirs,
        ]

        def compile_one(source: str) -> list[str]:
            return self.compiler.compile(
                [source],
                output_dir=str(self.objects),
                include_dirs=includes,
                extra_postargs=["-O2", "-g0"],
            )

        with ThreadPoolExecutor(self.jobs) as pool:
            return [path for paths in pool.map(compile_one, sources) for path in paths]

    def link_libraries(self, generated: GeneratedPackage, output: Path) -> None:
        """Build every library of `LIBRARIES` into ``output``."""
        package = generated.package
        units = [_units(library, generated) for library in LIBRARIES]
        compiled = iter(self.compile(chain.from_iterable(units), generated))
        for library, sources in zip(LIBRARIES, units, strict=True):
            objects = list(islice(compiled, len(sources)))
            name = f"{package.name}__{library.generator}"
            dependencies = [
                f"{other}__{generator}"
                for generator in dict.fromkeys((library.generator, "rosidl_generator_c"))
                for other in self._others(package)
            ]
            self._link(
                objects,
                output / f"lib{name}.so",
                own=[f"{package.name}__{generator}" for generator in library.own],
                others=[*dependencies, *library.runtime],
                # Python's own symbols come from the interpreter that loads the library.
                extra=[f"-Wl,-soname,lib{name}.so"]
                + ([] if library.python else ["-Wl,--no-undefined"]),
            )

    def _others(self, package: InterfacePackage) -> list[str]:
        """Names of the packages that ``package`` may refer to."""
        names = {*package.others_in(self.root), *(each.package.name for each in self.siblings)}
        return sorted(names - {package.name})

    def link_module(self, generated: GeneratedPackage, type_support: str, output: Path) -> None:
        """Build the extension module of one type support as the file ``output``.

        It is linked with all libraries of the package, because the dispatcher in
        ``rosidl_typesupport_c`` opens them by name and finds the ones that are already loaded.
        """
        name = generated.package.name
        source = generated.of("rosidl_generator_py") / f"_{name}_s.ep.{type_support}.c"
        self._link(
            self.compile([str(source)], generated),
            output,
            own=[f"{name}__{library.generator}" for library in LIBRARIES],
            others=["rosidl_typesupport_c", "rmw", *BASE],
            extra=[],
        )

    def _link(
        self,
        objects: list[str],
        output: Path,
        *,
        own: Iterable[str],
        others: Iterable[str],
        extra: list[str],
    ) -> None:
        output.parent.mkdir(parents=True, exist_ok=True)
        folders = [folder for _, folder in self.built]
        self.compiler.link_shared_object(
            objects,
            str(output),
            target_lang="c++",
            extra_postargs=[
                *extra,
                "-Wl,-rpath,$ORIGIN",
                *(f"-Wl,-rpath,$ORIGIN/../{folder.name}" for folder in folders),
                f"-Wl,-rpath-link,{self.root / 'lib'}",
                f"-L{output.parent}",
                *(f"-L{folder}" for folder in folders),
                f"-L{self.root / 'lib'}",
                "-Wl,--no-as-needed",
                *(f"-l{name}" for name in own),
                "-Wl,--as-needed",
                *(f"-l{name}" for name in others),
            ],
        )


def _units(library: Library, generated: GeneratedPackage) -> list[str]:
    """Paths of the files to compile: a new one that includes all that need not be apart."""
    sources = generated.sources(library.generator, library.pattern)
    apart = fnmatch.filter(sources, library.apart)
    unit = generated.of(library.generator) / f"one_unit{Path(sources[0]).suffix}"
    joined = [each for each in sources if each not in apart]
    unit.write_text("".join(f'#include "{source}"\n' for source in joined))
    return [str(unit), *apart]
