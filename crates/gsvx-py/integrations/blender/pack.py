"""Packs the extension with wheels of gsvx: python pack.py WHEEL... [-o FOLDER]"""

import argparse
import re
import zipfile
from pathlib import Path

FOLDER = Path(__file__).parent
_SYSTEMS = {"linux": "linux", "macosx": "macos", "win": "windows"}
_PROCESSORS = {"x86_64": ["x64"], "amd64": ["x64"], "aarch64": ["arm64"], "arm64": ["arm64"]}
_PROCESSORS["universal2"] = ["arm64", "x64"]


def platforms(wheel):
    """Blender's names of the platforms of a wheel."""
    found = re.search(r"(linux|macosx|win)(?:_\d+)*_(x86_64|amd64|aarch64|arm64|universal2)$", wheel.stem)
    if found is None:
        raise SystemExit(f"error: {wheel.name}: no wheel of a platform of Blender")
    return [f"{_SYSTEMS[found[1]]}-{processor}" for processor in _PROCESSORS[found[2]]]


def manifest(wheels):
    """The manifest with the version, names and platforms of the wheels."""
    versions = {wheel.name.split("-")[1] for wheel in wheels}
    if len(versions) > 1:
        raise SystemExit(f"error: wheels of several versions: {', '.join(sorted(versions))}; pack one version")
    values = {
        "version": f'"{versions.pop()}"',
        "wheels": str([f"./wheels/{wheel.name}" for wheel in wheels]),
        "platforms": str(sorted({name for wheel in wheels for name in platforms(wheel)})),
    }
    text = (FOLDER / "blender_manifest.toml").read_text()
    for name, value in values.items():
        text = re.sub(rf"(?m)^{name} = .*$", f"{name} = {value}", text)
    return text


def pack(wheels, out):
    text = manifest(wheels)
    path = out / f"gsvx-blender-{wheels[0].name.split('-')[1]}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("blender_manifest.toml", text)
        for file in sorted([*FOLDER.glob("*.py"), FOLDER / "README.md"]):
            if file.name != "pack.py":
                archive.write(file, file.name)
        for wheel in wheels:
            archive.write(wheel, f"wheels/{wheel.name}")
    return path


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split(":")[0])
    parser.add_argument("wheels", nargs="+", type=Path, help="wheels of one version, one for each platform")
    parser.add_argument("-o", "--out", default=Path(), type=Path, help="folder of the zip file")
    given = parser.parse_args()
    print(pack(given.wheels, given.out))
