"""python -m twoport: the version, and where the module, scenes, arms and programs are; --version: the version alone."""

import os
import pathlib
import shutil
import sys

import twoport

PROGRAMS = "twoport-master", "twoport-slave", "twoport-lab", "twoport-device", "twoport-keygen"


def program(name):
    """Beside the module, in the bin of an installation or a build, else on the PATH."""
    here = pathlib.Path(twoport.__file__).parent
    beside = os.pathsep.join(str(folder / "bin") for folder in list(here.parents)[:4])
    return shutil.which(name, path=beside) or shutil.which(name) or "not installed"


def main(arguments):
    if arguments == ["--version"]:
        print("twoport", twoport.__version__)
    elif arguments:
        print(f"python -m twoport: {' '.join(arguments)}: not known; it takes nothing, or --version", file=sys.stderr)
        return 2
    else:
        rows = [("version", twoport.__version__), ("module", os.path.dirname(twoport.__file__))]
        rows += [(name, os.path.abspath(twoport._twoport._project_folder(name))) for name in ("scenes", "arms")]
        for name, value in rows + [(name, program(name)) for name in PROGRAMS]:
            print(f"{name:15} {value}")
    return 0


sys.exit(main(sys.argv[1:]))
