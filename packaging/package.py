# Spack package, not built by the project's checks. Copy it to packages/cd_toolchain/ of a Spack repository.
from spack_repo.builtin.build_systems.python import PythonPackage

from spack.package import *


class CdToolchain(PythonPackage):
    """Contact dynamics of rigid grains, with a Python module that reads and runs cases."""

    homepage = "https://github.com/cd-toolchain/cd-toolchain"
    git = "https://github.com/cd-toolchain/cd-toolchain.git"
    license("MIT OR Apache-2.0")

    version("main", branch="main")

    depends_on("c", type="build")
    depends_on("rust@1.89:", type="build")
    depends_on("py-hatchling@1.27:", type="build")
    depends_on("py-packaging", type="build")
    depends_on("python@3.10:", type=("build", "run"))
    depends_on("py-numpy@1.24:", type=("build", "run"))

    import_modules = ["cd_toolchain"]
