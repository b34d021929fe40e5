# %% [markdown]
# # A pair of LeRobot's arms with force feedback
# Leader and follower are simulated servos with the methods of LeRobot's SO-101 classes: positions in degrees, set points as commands and as
# feedback. `loop` is LeRobot's. A hand moves the first joint of the leader until the follower presses on a stop, and back. Once the loop has
# the arms themselves, once twoport.lerobot's in their place.
#
#     PYTHONPATH=build/release/python /usr/bin/python3 python/examples/lerobot_pair.py

# %%
import math
import pathlib
import sys

import numpy as np

import twoport
import twoport.lerobot

SCENE = pathlib.Path(__file__).resolve().parents[2] / "docs/examples/lerobot/so101.textproto"
JOINTS = "shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"
# Of the servo STS3215 in the arms' own simulation: stiffness, largest torque, rotor's inertia, damping.
STIFFNESS_N_M_PER_RAD, LARGEST_N_M, INERTIA_KG_M2, DAMPING_N_M_S_PER_RAD = 17.8, 3.35, 0.028, 0.6


# %% [markdown]
# ## The arms

# %%
class Arm:
    """Six servos, which take set points in degrees."""

    def __init__(self):
        self.q, self.v, self.goal, self.is_connected = np.zeros(6), np.zeros(6), None, False

    def connect(self, calibrate=True):
        self.is_connected = True

    def disconnect(self):
        self.is_connected = False

    @property
    def action_features(self):
        return {f"{joint}.pos": float for joint in JOINTS}

    observation_features = feedback_features = action_features

    def positions(self):
        return {f"{joint}.pos": math.degrees(q) for joint, q in zip(JOINTS, self.q)}

    def take(self, goals):
        self.goal = np.radians([goals[f"{joint}.pos"] for joint in JOINTS])

    def servos(self):
        if self.goal is None:
            return np.zeros(6)
        return np.clip(STIFFNESS_N_M_PER_RAD * (self.goal - self.q), -LARGEST_N_M, LARGEST_N_M)

    def advance(self, torque, dt_s):
        self.v = self.v + (self.servos() + torque - DAMPING_N_M_S_PER_RAD * self.v) / INERTIA_KG_M2 * dt_s
        self.q = self.q + self.v * dt_s


class Leader(Arm):
    name = "so101_leader"
    get_action, send_feedback = Arm.positions, Arm.take


class Follower(Arm):
    name = "so101_follower"
    get_observation = Arm.positions

    def send_action(self, action):
        self.take(action)
        return action


class World:
    """A hand of 20 N m/rad at the leader's first joint, a stop of 100 N m/rad at 0.3 rad for the follower's joints."""

    def __init__(self, leader, follower):
        self.leader, self.follower, self.t_s = leader, follower, 0.0
        self.energy_j, self.least_j = 0.0, 0.0  # into the leader's servos

    def pressed_n_m(self):
        return 100.0 * np.maximum(0.0, self.follower.q - 0.3)

    def advance(self, seconds, step_s=5e-4):
        goal = np.zeros(6)
        goal[0] = 0.45 * (np.clip((self.t_s - 0.5) / 1.5, 0, 1) - np.clip((self.t_s - 5.0) / 1.5, 0, 1))
        for _ in range(round(seconds / step_s)):
            displayed = self.leader.servos()
            self.leader.advance(20.0 * (goal - self.leader.q) - 0.5 * self.leader.v, step_s)
            self.energy_j -= displayed @ self.leader.v * step_s
            self.least_j = min(self.least_j, self.energy_j)
            self.follower.advance(-self.pressed_n_m(), step_s)
        self.t_s += seconds


# %% [markdown]
# ## The loop, as LeRobot has it

# %%
def loop(teleop, robot, fps, world, seconds=7.5):
    teleop.connect()
    robot.connect()
    held = []
    for _ in range(round(seconds * fps)):
        observation = robot.get_observation()
        action = teleop.get_action()
        robot.send_action(action)
        world.advance(1.0 / fps)
        if 3.0 < world.t_s < 5.0:
            held.append((-world.leader.servos()[0], world.pressed_n_m()[0], observation.get("shoulder_pan.torque", math.nan)))
    teleop.disconnect()
    robot.disconnect()
    return np.mean(held, axis=0)


# %%
def main():
    for name in ("follower alone", "twoport"):
        teleop, robot = Leader(), Follower()
        world = World(teleop, robot)
        if name == "twoport":
            scene, clock = twoport.load_scene(SCENE), lambda: world.t_s
            teleop = twoport.lerobot.Teleoperator(scene, teleop, robot, servo_stiffness_n_m_per_rad=STIFFNESS_N_M_PER_RAD, clock=clock)
            robot = twoport.lerobot.Robot(teleop)
        felt, pressed, _ = loop(teleop, robot, 60, world)
        print(f"{name:15} felt {abs(felt):.2f} N m of {pressed:.2f} N m, least energy put in {1e3 * world.least_j:.1f} mJ")


if __name__ == "__main__":
    sys.exit(main())
