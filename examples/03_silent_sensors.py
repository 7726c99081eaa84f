"""Sensors fall silent, and the figure goes on: what a frame says about its own health.

python examples/03_silent_sensors.py
"""

import poseloom
from poseloom.synthesis import Fault, FaultKind, TrackerNoise


def main() -> None:
    layout = poseloom.layout("six-trackers")
    faults = [Fault(sensor, 2.0, 2.5, FaultKind.SILENT) for sensor in layout.names]
    faults.append(Fault("leftHand", 1.0, 4.0, FaultKind.SILENT))
    walk = poseloom.sample_motions()["walk"]
    recording = poseloom.simulate_trackers(walk, layout, TrackerNoise(), faults)

    # The loop that a live session runs: one sample in, one frame out, the state carried by the caller.
    method = poseloom.InverseKinematics(layout)
    state = method.start(recording.skeleton, recording.placements)
    said = ""
    for index in range(len(recording)):
        state, frame = method.step(state, recording.sample(index))
        if frame is None:
            continue
        health = f"{frame.health.state.value} {', '.join(frame.health.sensors)}"
        if health != said:
            print(f"{frame.time:5.2f} s  {health}")
            said = health


if __name__ == "__main__":
    main()
