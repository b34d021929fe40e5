"""A hand of your own: a master in Python calls a slave that runs anywhere, and presses its wall.

    twoport-slave --scene scenes/one_axis_wall.textproto --listen 127.0.0.1:45000 &
    python3 live_master.py scenes/one_axis_wall.textproto 127.0.0.1:45000
"""
import sys

import twoport

scene, peer = sys.argv[1:3]
master = twoport.LiveMaster(twoport.load_scene(scene), peer)
SPEED, FAR = 0.02, 0.03  # [m/s], [m]
x, coupled_s = 0.0, 0.0
while coupled_s < 2.5:
    moves = coupled_s > 0.0 and x < FAR
    out = master.step([x], [SPEED if moves else 0.0])  # waits for the next tick
    if out.mode == "coupled":
        coupled_s += 1.0 / master.rate_hz
        x = min(FAR, SPEED * coupled_s)
print(f"felt {abs(out.force[0]):.1f} N over {1e3 * master.round_trip_s:.0f} ms, {out.mode}")
