"""Makes src/poseloom/samples/motions.npz from the humanoid motions of the PyPI package pybullet.

    python scripts/encode_samples.py WHEEL_OR_SDIST

The package itself is not needed: get its archive with `pip download --no-deps pybullet`.
"""

import argparse
import tarfile
import tempfile
import zipfile
from pathlib import Path, PurePosixPath

from poseloom.formats.deepmimic import read_deepmimic
from poseloom.samples.encoding import encode_samples

_FOLDER = "pybullet_data/data/motions/humanoid3d_"


def extract(archive: Path, folder: Path) -> list[Path]:
    """Copies the humanoid motions out of a wheel or source archive, sorted by name."""
    if archive.suffix == ".whl":
        with zipfile.ZipFile(archive) as wheel:
            contents = {name: wheel.read(name) for name in wheel.namelist() if _FOLDER in name}
    else:
        with tarfile.open(archive) as source:
            members = [member for member in source.getmembers() if _FOLDER in member.name and member.isfile()]
            contents = {member.name: file.read() for member in members if (file := source.extractfile(member))}
    for name, content in contents.items():
        (folder / PurePosixPath(name).name).write_bytes(content)
    return sorted(folder.iterdir())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archive", type=Path, help="wheel or source archive of pybullet")
    archive = parser.parse_args().archive
    target = Path(__file__).parents[1] / "src" / "poseloom" / "samples" / "motions.npz"
    with tempfile.TemporaryDirectory() as folder:
        files = extract(archive, Path(folder))
        motions = {file.stem.removeprefix("humanoid3d_"): read_deepmimic(file) for file in files}
    encode_samples(motions, target, source=archive.name)
    print(f"{len(motions)} motions in {target} ({target.stat().st_size / 1000:.0f} kB)")


if __name__ == "__main__":
    main()
