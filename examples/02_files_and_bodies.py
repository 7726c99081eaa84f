"""Motion files: any skeleton in, the 22-bone body out, and the same motion mirrored and at another rate.

python examples/02_files_and_bodies.py [FILE]
"""

import sys

import numpy as np

import poseloom
from poseloom.skeleton.mirror import mirror_motion
from poseloom.skeleton.resample import resample


def main() -> None:
    if len(sys.argv) > 1:
        motion = poseloom.read_motions(sys.argv[1])[0]
    else:
        poseloom.write_motion(poseloom.sample_motions()["dance_a"], "dance.bvh")
        motion = poseloom.read_motions("dance.bvh")[0]
    print(f"{motion.name}: {len(motion.skeleton)} joints, {len(motion)} frames at {motion.rate:g} Hz")

    # On the body, bones have the names of VRM 1.0 and every bone's frame is aligned with the world at rest.
    body = poseloom.retarget(motion, poseloom.average_body())
    head = body.skeleton.index("head")
    frames = poseloom.motion_frames(body)
    print(f"on the body: the head is {frames.positions[:, head, 1].mean():.2f} m above the floor")

    mirrored = resample(mirror_motion(body), 30.0)
    left, right = (mirrored.skeleton.index(f"{side}Hand") for side in ("left", "right"))
    reach = np.ptp(poseloom.motion_frames(mirrored).positions[:, [left, right], 1], axis=0)
    print(f"mirrored at 30 Hz: the left hand moves {reach[0]:.2f} m up and down, the right {reach[1]:.2f} m")
    poseloom.write_motion(mirrored, "mirrored.glb")


if __name__ == "__main__":
    main()
