"""Fitted files, recordings and libraries from strangers: each is read and runs, or ends in an error of ours."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from poseloom.calibration.calibration import Calibration, Level, Verdict, write_calibration
from poseloom.errors import FormatError, LibraryError
from poseloom.formats.artefact import read_artefact, write_artefact
from poseloom.formats.npz import write_npz
from poseloom.formats.recording import write_recording
from poseloom.library import add_to_library, build_library, open_library, store
from poseloom.library.build import six_trackers
from poseloom.methods.flex.network_method import SHIPPED_MODEL
from poseloom.methods.imus.baselines.driving import save_comparator
from poseloom.methods.imus.baselines.fitting import COMPARATORS, fit_comparator
from poseloom.methods.imus.model_file import read_phase_hmm, write_phase_hmm
from poseloom.methods.imus.pairs import WELL_MOUNTED, pair_of_recording
from poseloom.methods.imus.phase_hmm import fit_phase_hmm
from poseloom.samples import sample_motions
from poseloom.sensors import layout
from poseloom.sensors.placement import default_placements
from poseloom.skeleton.body import average_body
from poseloom.skeleton.resample import resample
from poseloom.synthesis import simulate_flex, simulate_imus

TRIALS = 200


def _calibration() -> Calibration:
    """A sound one, of a few holds."""
    worn, body = layout("six-trackers"), average_body()
    joints, sensors, holds = len(body), len(worn), 3
    return Calibration(
        skeleton=body,
        sensors=worn.names,
        placements=default_placements(worn, body),
        coefficients=np.zeros(4),
        lengths=np.full(joints, 0.3),
        length_sigmas=np.full(joints, 0.01),
        offset_sigmas=np.full((sensors, 3), 0.01),
        turn_sigmas=np.full((sensors, 3), 0.01),
        poses=("t", "n", "t"),
        residuals=np.zeros((holds, sensors, 2)),
        deviations=np.zeros(holds),
        verdicts=(Verdict(Level.GOOD, "all", "nothing to say", "", ""),),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Small files of all kinds, all sound."""
    out = tmp_path_factory.mktemp("models")
    foot = layout("right-foot-imu")
    walk = resample(sample_motions()["walk"].cut(0, 150), foot.rate)
    recording = simulate_imus(walk, foot, WELL_MOUNTED, seed=1)
    pairs = (pair_of_recording(recording),)
    write_recording(recording, out / "imu.mcap")
    write_recording(simulate_flex(walk, layout("flex-four"), seed=1), out / "flex.mcap")
    write_phase_hmm(fit_phase_hmm(pairs, foot), out / "phase-hmm.npz")
    for name in COMPARATORS:
        save_comparator(fit_comparator(name, pairs, foot), out / f"{name}.npz")
    (out / "flex-scales.npz").write_bytes(SHIPPED_MODEL.read_bytes())
    write_npz(walk, out / "motion.npz")
    build_library([out / "motion.npz"], out / "library")
    write_calibration(_calibration(), out / "calibration.npz")
    return out


def test_damaged_files_are_read_or_refused(folder: Path) -> None:
    script = Path(__file__).with_name("fuzz_models.py")
    done = subprocess.run(
        [sys.executable, str(script), str(folder), str(TRIALS)], capture_output=True, text=True, timeout=300,
        env=dict(os.environ),
    )  # fmt: skip
    lines = done.stdout.splitlines()
    assert done.returncode == 0, f"ended by {done.returncode} at {lines[-1:]}: {done.stderr[-2000:]}"
    assert lines[-1] == "escaped 0", [line for line in lines if line.startswith("ESCAPED")][:10]


@pytest.mark.parametrize("name", ["maps", "successor", "body_of_segment", "first", "stop", "phase_of_segment"])
@pytest.mark.parametrize("value", [-(2**40), -2, 2**40])
def test_no_index_of_a_model_points_outside(folder: Path, tmp_path: Path, name: str, value: int) -> None:
    sound = read_artefact(folder / "phase-hmm.npz", "phase-hmm")
    arrays = dict(sound.arrays)
    arrays[name] = arrays[name].copy()
    arrays[name][len(arrays[name]) // 2] = value
    write_artefact(tmp_path / "crafted.npz", "phase-hmm", sound.version, sound.header, arrays)
    with pytest.raises(FormatError, match=r"crafted\.npz"):
        read_phase_hmm(tmp_path / "crafted.npz")


def _rewritten(library: Path, **changes: object) -> None:
    import json

    fields = json.loads((library / store.HEADER_FILE).read_text())
    fields.pop("digest")
    fields |= changes
    (library / store.HEADER_FILE).write_text(json.dumps({**fields, "digest": store._digest(fields)}))


@pytest.mark.parametrize("name", ["../victim", "/victim", "C:victim", "..\\victim", ".", ""])
def test_no_name_leads_out_of_a_library(folder: Path, tmp_path: Path, name: str) -> None:
    import shutil

    shutil.copytree(folder / "library", tmp_path / "library")
    shutil.copytree(folder / "library" / "generation-1", tmp_path / "victim")
    before = sorted(path.name for path in (tmp_path / "victim").rglob("*"))
    _rewritten(tmp_path / "library", generation=name)
    with pytest.raises(LibraryError):
        open_library(tmp_path / "library").moments(six_trackers())
    with pytest.raises(LibraryError):
        add_to_library(tmp_path / "library", ["samples"])
    assert sorted(path.name for path in (tmp_path / "victim").rglob("*")) == before


def test_a_generation_that_is_a_link_is_refused(folder: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(folder / "library", tmp_path / "library")
    shutil.move(tmp_path / "library" / "generation-1", tmp_path / "victim")
    (tmp_path / "library" / "generation-1").symlink_to(tmp_path / "victim")
    with pytest.raises(LibraryError, match="a link"):
        open_library(tmp_path / "library")


def test_a_library_cut_off_while_open_ends_with_a_word(folder: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(folder / "library", tmp_path / "library")
    library = open_library(tmp_path / "library")
    index = library.moments(six_trackers())
    query = index.columns[0].astype(np.float64)
    assert len(index.search(query, 3)[0]) == 3
    with (tmp_path / "library" / "generation-1" / "poses.npy").open("r+b") as stream:
        stream.truncate(1000)
    with pytest.raises(LibraryError, match="cut off while it was open"):
        index.search(query, 3)
    assert np.isfinite(library.motion(library.clips[-1]).q).all()
