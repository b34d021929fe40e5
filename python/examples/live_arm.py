"""Two arms of your own, joint by joint: leader and follower in two processes, each a function that says where its joints are.

    python3 live_arm.py follower leader_follower_gripper 127.0.0.1:45000 &
    python3 live_arm.py leader leader_follower_gripper 127.0.0.1:45000
"""
import math
import sys
from typing import Union

import twoport

START = [0, -0.5, 0, -2.2, 0, 1.8, 0.785, 0.01]  # [rad], the fingers [m]


def leader(t_s, q, out):  # a hand that swings every joint by 0.02, whatever the arm displays: its motors push with -out.force
    return [start + 0.01 * (1.0 - math.cos(4.0 * t_s)) for start in START]


def follower(t_s, q, out):  # servos that lag by ten ticks
    return [a + 0.1 * (b - a) for a, b in zip(q, out.set_point)] if out and out.mode == "coupled" else q


role, file, address = sys.argv[1:4]
scene, arm = twoport.load_scene(file, "rate_hz=200"), {"leader": leader, "follower": follower}[role]
Side = Union[twoport.LiveMaster, twoport.LiveSlave]
side: Side = twoport.LiveMaster(scene, address) if role == "leader" else twoport.LiveSlave(scene, address)
q, out, moved = START, None, 0.0
while (t_s := side.wait()) < 4.0:
    before, q = q, arm(t_s, q, out)
    out = side.step(q, [(a - b) * side.rate_hz for a, b in zip(q, before)])
    moved = max(moved, min(a - start for a, start in zip(q, START)))
print(f"{role}: {side.dof} joints, each moved by {moved:.3f}")
