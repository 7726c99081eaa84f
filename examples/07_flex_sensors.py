"""Four flex sensors over knees and elbows: simulate them, reconstruct with the network that comes with poseloom.

python examples/07_flex_sensors.py     # writes flex.bvh here
"""

import numpy as np

import poseloom
from poseloom.methods import make_method
from poseloom.synthesis.flex import bend_angles, simulate_flex


def main() -> None:
    layout = poseloom.layout("flex-four")
    run = poseloom.sample_motions()["run"]

    # Counts of an analogue-to-digital converter, from sensors that creep, slip and differ from each other.
    recording = simulate_flex(run, layout, seed=3)
    assert recording.truth is not None
    bends = np.degrees(bend_angles(recording.truth, layout))
    for channel, name in enumerate(layout.names):
        counts = recording.counts[:, channel]
        print(
            f"{name:14} bends {np.nanmin(bends[:, channel]):3.0f} to {np.nanmax(bends[:, channel]):3.0f} degrees, "
            f"counts {np.nanmin(counts):4.0f} to {np.nanmax(counts):4.0f}"
        )

    # The model travels with the package (`poseloom fit flex-scales` fits another). It learns the range of each sensor
    # while the method runs, so nothing is calibrated beforehand.
    result = poseloom.reconstruct(make_method("flex-scales", layout), recording)
    poseloom.write_motion(result.motion, "flex.bvh")

    # The hips are not observed: the joint angles are compared, and the place on the floor means nothing.
    error = poseloom.evaluate_motion(recording.truth, result.motion)
    print(f"{len(result.motion)} frames in flex.bvh; mean joint angle error {error['joint_angle_deg']:.1f} degrees")


if __name__ == "__main__":
    main()
