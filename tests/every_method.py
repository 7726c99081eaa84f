"""Every method of the registry with layouts that it runs on, and small models for those that are fitted."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from poseloom.methods import METHODS, needs_model
from poseloom.methods.flex.model_file import read_flex_model, write_flex_model
from poseloom.methods.flex.network_method import SHIPPED_MODEL
from poseloom.methods.imus.baselines.driving import save_comparator
from poseloom.methods.imus.baselines.fitting import COMPARATORS, fit_comparator
from poseloom.methods.imus.behaviours import Behaviour
from poseloom.methods.imus.model_file import write_phase_hmm
from poseloom.methods.imus.pairs import WELL_MOUNTED, SignalPair, pair_of_recording
from poseloom.methods.imus.phase_hmm import fit_phase_hmm
from poseloom.methods.imus.settings import PAPER_SETTINGS
from poseloom.samples import sample_motions
from poseloom.sensors import SensorKind, layout
from poseloom.skeleton import average_body, retarget
from poseloom.synthesis import simulate_imus

LAYOUTS = {
    SensorKind.TRACKER: ("six-trackers", "three-trackers"),
    SensorKind.IMU: ("right-foot-imu", "right-foot+right-hand-imu"),
    SensorKind.FLEX: ("flex-four", "flex-four+hips-imu"),
}
EVERY = [(name, worn) for name in METHODS.own for worn in LAYOUTS[METHODS[name].sensors]]
SMALL = {"phase-regression": {"phases": 3}, "motion-primitives": {"coefficients": 4, "beam": 16}}


@cache
def pairs(worn: str) -> tuple[SignalPair, ...]:
    kinds = (("walk", Behaviour.WALKING), ("run", Behaviour.RUNNING))
    return tuple(
        pair_of_recording(
            simulate_imus(retarget(sample_motions()[name], average_body()), layout(worn), WELL_MOUNTED, seed=1),
            kind,
            take=name,
        )
        for name, kind in kinds
    )


def model_of(name: str, worn: str, folder: Path) -> Path | None:
    if not needs_model(name) or METHODS[name].shipped is not None:
        return None
    file = folder / f"{name} {worn}.npz"
    if file.exists():
        return file
    if name.startswith("phase-hmm"):
        write_phase_hmm(fit_phase_hmm(pairs(worn), layout(worn), PAPER_SETTINGS if "paper" in name else None), file)
    elif name in COMPARATORS:
        save_comparator(fit_comparator(name, pairs(worn), layout(worn), SMALL.get(name)), file)
    else:  # a network of the other name's form: what runs it is the same
        write_flex_model(replace(read_flex_model(SHIPPED_MODEL), method=name), file)
    return file
