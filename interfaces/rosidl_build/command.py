"""Setuptools command that builds the interface packages."""

import os
import shutil
from pathlib import Path

import numpy
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError

from rosidl_build.generate import GeneratedPackage, generate, ros_root, shared_files
from rosidl_build.link import Linker
from rosidl_build.package import InterfacePackage

HERE = Path(__file__).absolute().parent.parent  # of the project that links to this folder


class BuildInterfaces(build_ext):
    """Generate, compile and install every package that has an extension.

    An extension is named ``<package>.<package>_s__<type support>``; the package's interface files
    are in the folder of the same name beside ``pyproject.toml``. A package may refer to those whose
    extensions are listed before its own.
    """

    def build_extensions(self) -> None:
        """Build all packages; setuptools calls this after it has set up the compiler."""
        self._require_compilers()
        work = Path(self.build_temp).resolve()
        shutil.rmtree(work, ignore_errors=True)  # files of deleted messages must not be packed
        linker = Linker(
            self.compiler,
            ros_root(),
            work / "objects",
            (*self.include_dirs, numpy.get_include()),
            self.parallel or os.cpu_count() or 1,
        )
        # The files are known only now; setuptools configures the install command after this one.
        self.distribution.data_files = shared = []
        for name in dict.fromkeys(extension.name.split(".")[0] for extension in self.extensions):
            package = InterfacePackage.read(HERE / name)
            generated = generate(package, work / name / "generated", linker.root, linker.siblings)
            output = Path(self.build_lib).resolve() / name
            shutil.rmtree(output, ignore_errors=True)
            _copy_python(generated, output)
            linker.link_libraries(generated, output)
            for extension in self.extensions:
                if extension.name.startswith(f"{name}."):
                    self._build_module(linker, generated, extension.name)
            shared.extend(shared_files(generated).items())
            linker = linker.with_sibling(generated, output)

    def _build_module(self, linker: Linker, generated: GeneratedPackage, name: str) -> None:
        type_support = name.split("_s__")[1]
        linker.link_module(
            generated, type_support, Path(self.build_lib).resolve() / self.get_ext_filename(name)
        )

    def _require_compilers(self) -> None:
        for role in ("compiler_so", "compiler_cxx"):
            program = getattr(self.compiler, role)[0]
            if shutil.which(program) is None:
                raise CompileError(
                    f"{program} was not found: install a C and a C++ compiler "
                    "(on Debian and Ubuntu: apt install g++)"
                )


def _copy_python(generated: GeneratedPackage, output: Path) -> None:
    source = generated.of("rosidl_generator_py")
    for path in sorted(source.rglob("*.py")):
        target = output / path.relative_to(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
    (output / "__init__.py").touch()
