"""A whole body from one IMU on the right foot: simulate it, fit a small phase HMM, reconstruct.

python examples/06_one_imu.py     # writes one_imu.bvh here

Four seconds of one walk are fitted, and the rest of it is reconstructed. A model for real use is fitted to many people:
`poseloom fit phase-hmm --library DIR --layout right-foot-imu -o foot.npz`.
"""

import poseloom
from poseloom.methods.imus.pairs import WELL_MOUNTED, pair_of_recording
from poseloom.methods.imus.phase_hmm import fit_phase_hmm


def main() -> None:
    foot = poseloom.layout("right-foot-imu")
    walk = poseloom.sample_motions()["walk"]

    # Training: motion and signal, frame by frame. The sensor sits exactly as the layout states.
    training = poseloom.simulate_imus(walk, foot, WELL_MOUNTED).cut(0, round(4 * foot.rate))
    method = fit_phase_hmm([pair_of_recording(training)], foot)
    print(f"fitted to {len(training)} frames: {len(method.model)} hidden states")

    # The wearer's own sensor sits a little differently, and is noisy. The method aligns it while it runs.
    recording = poseloom.simulate_imus(walk, foot, poseloom.ImuNoise(), seed=1).cut(
        round(4 * foot.rate), round(6 * foot.rate)
    )
    result = poseloom.reconstruct(method, recording)
    poseloom.write_motion(result.motion, "one_imu.bvh")

    assert recording.truth is not None  # it was simulated
    error = poseloom.evaluate_motion(recording.truth, result.motion)
    print(f"{len(result.motion)} frames in one_imu.bvh, the legs and arms that no sensor measures included")
    print(
        f"mean joint position error {error['joint_position_cm']:.1f} cm, angle {error['joint_angle_deg']:.1f} degrees"
    )

    # Each frame has a standard deviation for each joint: small where the phase of the step determines the pose.
    names = result.motion.skeleton.names
    spread = result.spread[:, 3:].reshape(len(result.motion), len(names), 3).mean(axis=(0, 2))
    least, most = names[int(spread.argmin())], names[int(spread.argmax())]
    print(f"least uncertain: {least}; most uncertain: {most}")


if __name__ == "__main__":
    main()
