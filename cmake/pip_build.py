"""Builds the wheel of `pip install .`: a backend of PEP 517 that needs Python, CMake and a compiler, and downloads nothing.

The wheel holds the Python module, twoport-keygen, scenes and arms. What is compiled stays in build/wheel-*, so that a second build is short.

    --config-settings programs=twoport-master,twoport-slave    adds programs
    --config-settings build=build/release                      compiles what is missing in a folder that is configured
"""

import base64
import hashlib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import tomllib
import zipfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VERSION = re.search(r"^project\(twoport VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text(), re.M).group(1)
NAME = f"twoport-{VERSION}"
INTERPRETER = f"cp{sys.version_info.major}{sys.version_info.minor}"
TAG = f"{INTERPRETER}-{INTERPRETER}-{re.sub('[-.]', '_', sysconfig.get_platform())}"
PROGRAMS = ["twoport-keygen"]


def check_tools():
    """Ends with one sentence where something is missing that the build needs."""
    lacks = []
    if shutil.which("dpkg-query"):
        found = subprocess.run([ROOT / "scripts/install", "--programs", "--missing", "pybind11-dev"], capture_output=True, text=True)
        lacks = found.stdout.split()
    elif not shutil.which("cmake"):
        sys.exit("twoport is built by CMake, which is not installed")
    if not pathlib.Path(sysconfig.get_path("include"), "Python.h").exists():
        lacks.append("python3-dev" if sys.base_prefix == "/usr" else f"the headers of {sys.executable}")
    if lacks:
        sys.exit(f"twoport is built with what is missing here: {', '.join(lacks)}; install these Debian packages as root, by apt-get install")


def build(programs, configured):
    """Compiles, in a folder that it configures unless one is given; that folder."""
    folder = ROOT / (configured or f"build/wheel-{INTERPRETER}")
    options = {"CMAKE_BUILD_TYPE": "Release", "TWOPORT_TESTS": "OFF", "TWOPORT_BENCH": "OFF", "TWOPORT_UNITY": "ON", "TWOPORT_PYTHON": "ON",
               "Python3_EXECUTABLE": sys.executable}  # fmt: skip
    environment = dict(os.environ)
    if shutil.which("ccache"):
        options["CMAKE_CXX_COMPILER_LAUNCHER"] = "ccache"
        environment.setdefault("CCACHE_SLOPPINESS", "pch_defines,time_macros")
    generator = ["-G", "Ninja"] if shutil.which("ninja") else []
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_AVPHYS_PAGES")
    jobs = max(1, min(os.cpu_count() or 1, memory // 2_000_000_000))  # two gigabytes for each compiler at work
    commands = [["cmake", "--build", folder, "--parallel", str(jobs), "--target", "twoport_python", *programs]]
    if not configured:
        commands.insert(0, ["cmake", "-S", ROOT, "-B", folder, *generator, *(f"-D{name}={value}" for name, value in options.items())])
    for command in commands:
        if subprocess.run(command, env=environment).returncode != 0:
            sys.exit(f"twoport: {' '.join(map(str, command[:3]))} failed; the lines above say why")
    module = f"python/twoport/_twoport{sysconfig.get_config_var('EXT_SUFFIX')}"
    if not (folder / module).exists():
        sys.exit(f"twoport: {folder} has no {module}, the module for {sys.executable}")
    return folder


def metadata():
    lines = ["Metadata-Version: 2.1", f"Name: {PROJECT['name']}", f"Version: {VERSION}", f"Summary: {PROJECT['description']}", "License: BSD-3-Clause",
             f"Requires-Python: {PROJECT['requires-python']}"]  # fmt: skip
    for extra, names in PROJECT["optional-dependencies"].items():
        lines += [f"Provides-Extra: {extra}", *(f'Requires-Dist: {name}; extra == "{extra}"' for name in names)]
    wheel = ["Wheel-Version: 1.0", "Generator: cmake/pip_build.py", "Root-Is-Purelib: false", f"Tag: {TAG}"]
    return {"METADATA": "\n".join(lines) + "\n", "WHEEL": "\n".join(wheel) + "\n"}


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    check_tools()
    folder = pathlib.Path(metadata_directory, f"{NAME}.dist-info")
    folder.mkdir()
    for name, text in metadata().items():
        (folder / name).write_text(text)
    return folder.name


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    check_tools()
    settings = config_settings or {}
    more = re.split("[ ,]+", settings.get("programs", ""))
    programs = PROGRAMS + sorted({name for name in more if name} - set(PROGRAMS))
    folder = build(programs, settings.get("build"))
    name = f"{NAME}-{TAG}.whl"
    with tempfile.TemporaryDirectory() as staged, zipfile.ZipFile(pathlib.Path(wheel_directory, name), "w", zipfile.ZIP_DEFLATED) as wheel:
        staged, record = pathlib.Path(staged), []

        def add(at, content, mode=0o644):
            info = zipfile.ZipInfo(at)  # of 1980: the same bytes from the same files
            info.external_attr, info.compress_type = (0o100000 | mode) << 16, zipfile.ZIP_DEFLATED
            wheel.writestr(info, content)
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
            record.append(f"{at},sha256={digest},{len(content)}")

        def stripped(path):
            copy = staged / path.name
            shutil.copy(path, copy)
            if shutil.which("strip"):
                subprocess.run(["strip", "--strip-unneeded", copy], check=True)
            return copy.read_bytes()

        for path in sorted((folder / "python/twoport").iterdir()):
            if path.is_file():
                add(f"twoport/{path.name}", stripped(path) if path.suffix == ".so" else path.read_bytes())
        for program in programs:
            add(f"{NAME}.data/scripts/{program}", stripped(folder / "bin" / program), 0o755)
        subprocess.run(["cmake", "--install", folder, "--prefix", staged / "tree", "--component", "scenes"], check=True, stdout=subprocess.DEVNULL)
        for path in sorted((staged / "tree").rglob("*")):
            if path.is_file():
                add(f"{NAME}.data/data/{path.relative_to(staged / 'tree')}", path.read_bytes())
        for at, text in metadata().items():
            add(f"{NAME}.dist-info/{at}", text.encode())
        add(f"{NAME}.dist-info/LICENSE", (ROOT / "LICENSE").read_bytes())
        record.append(f"{NAME}.dist-info/RECORD,,")
        wheel.writestr(zipfile.ZipInfo(f"{NAME}.dist-info/RECORD"), "\n".join(record) + "\n")
    return name


def build_sdist(sdist_directory, config_settings=None):
    """Of the files that git knows."""
    name = f"{NAME}.tar.gz"
    files = subprocess.run(["git", "-C", ROOT, "ls-files", "-z"], capture_output=True, check=True).stdout.decode().split("\0")
    with tarfile.open(pathlib.Path(sdist_directory, name), "w:gz", format=tarfile.PAX_FORMAT) as archive:
        for file in filter(None, files):
            archive.add(ROOT / file, f"{NAME}/{file}")
        info = tarfile.TarInfo(f"{NAME}/PKG-INFO")
        text = metadata()["METADATA"].encode()
        info.size = len(text)
        with tempfile.TemporaryFile() as file:
            file.write(text)
            file.seek(0)
            archive.addfile(info, file)
    return name
