"""Six trackers in, a full-body motion out: the shortest way through poseloom.

python examples/01_sensors_to_motion.py     # writes walk.bvh and walk.glb here
"""

import tempfile

import numpy as np

import poseloom


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        # A library of the built-in motions. Give folders of your own BVH, AMC or other files in place of "samples".
        poseloom.build_library(["samples"], f"{folder}/library", workers=1)
        library = poseloom.open_library(f"{folder}/library")

        # Somebody walks, and wears six trackers. With real ones, this is poseloom.read_recording("take.mcap").
        recording = poseloom.simulate_trackers(poseloom.sample_motions()["walk"], poseloom.layout("six-trackers"))

        # The library knows this very walk. To be fair, hide it.
        hidden = next(clip.take for clip in library.clips if clip.name == "samples/walk")
        allowed = np.ones(len(library.poses), dtype=bool)
        for clip in library.clips:
            if clip.take == hidden:
                allowed[clip.rows] = False

        method = poseloom.LocalRegression(library, recording.layout, allowed=allowed)
        result = poseloom.reconstruct(method, recording)

    poseloom.write_motion(result.motion, "walk.bvh")
    poseloom.write_motion(result.motion, "walk.glb")
    assert recording.truth is not None  # it was simulated
    error = poseloom.evaluate_motion(recording.truth, result.motion)
    print(f"{len(result.motion)} frames in walk.bvh and walk.glb")
    print(f"joints off by {error['joint_position_cm']:.1f} cm, {error['joint_angle_deg']:.1f} degrees a joint angle")
    print(f"{1e3 * np.median(result.step_seconds):.1f} ms a step")


if __name__ == "__main__":
    main()
