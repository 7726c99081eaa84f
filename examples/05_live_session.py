"""A live session in a script: simulated trackers, a sink of our own, and the motion in a file.

python examples/05_live_session.py     # runs for three seconds, writes session.bvh here

With real trackers the source is "vmc://:39539", and `poseloom live` does the same from the command line.
"""

import poseloom
from poseloom.live.contract import Post, SessionFacts, Update
from poseloom.live.session import Session
from poseloom.live.setup import LiveSettings, plan_session
from poseloom.skeleton import forward_kinematics


class HandHeight:
    """A sink: prints the height of the right hand, and the state of the sensors when it changes.

    A sink is any object with these methods. They are called on a thread of its own, so a slow one stops nobody.
    """

    name = "hand height"
    capacity = 1  # updates that may wait: one that shows things needs the newest alone

    def open(self, facts: SessionFacts, post: Post) -> None:
        """Called once. `post` sends commands to the session: `post(Stop())` ends it."""
        print(f"{facts.method} on {', '.join(facts.layout.names)}")
        self.first = self.last = 0.0  # seconds on the session's clock
        self.state = ""

    def changed(self, facts: SessionFacts) -> None:
        """Called when the method or the wearer is another."""
        print(f"now {facts.method}")

    def show(self, update: Update) -> None:
        """Called for each sample, or for the newest of several."""
        frame = update.frame
        if frame is None:
            return
        self.first = self.first or frame.time
        health = f"{frame.health.state.value} {', '.join(frame.health.sensors)}"
        if health != self.state or frame.time - self.last >= 0.5:
            bones = forward_kinematics(frame.pose.skeleton, frame.pose.q)
            height = bones.positions[frame.pose.skeleton.index("rightHand"), 1]
            print(f"{frame.time - self.first:5.2f} s  right hand {height:.2f} m  {health}")
            self.state, self.last = health, frame.time

    def close(self) -> None:
        """Called once, at the end."""


def main() -> None:
    # The right hand's tracker drops out for half a second.
    source = "simulate://sample:walk?fault=silent:rightHand:1:1.5"
    settings = LiveSettings(source=(source,), seconds=3.0, export="session.bvh")
    summary = Session(plan_session(settings, sinks=[HandHeight()])).run()

    median, _, highest = summary.latency
    print(f"{summary.counters.frames} poses; from arrival to pose {median:.1f} ms, 99 of 100 within {highest:.1f} ms")
    for notice in summary.notices:  # a sink that fails ends alone, and the reason stands here
        print(f"notice: {notice.text}")
    motion = poseloom.read_motion("session.bvh")
    print(f"session.bvh holds {len(motion)} frames at {motion.rate:g} Hz")


if __name__ == "__main__":
    main()
