# %% [markdown]
# # Own plant, own network, tick by tick
# Master and slave of a scene, with a device, a robot, a wall and a network that are written here. The hand pushes the
# handle into a wall that is 50 ms away.
#
#     PYTHONPATH=build/release/python /usr/bin/python3 python/examples/own_plant.py [FOLDER]

# %%
import pathlib
import random
import sys

import numpy as np

import twoport

try:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
except ImportError:
    plt = None

folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "out/python")

# %% [markdown]
# ## Controllers
# Of the scene the nodes take rate, coupling and method. What it says of delays tells the method what to expect.

# %%
scene = twoport.parse_scene(
    """
    dof: 1 duration_s: 4 rate_hz: 1000
    operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 } }
    device { mass_kg: 0.075 damping_n_s_per_m: 0.05 max_force_n: 8.5 }
    control { architecture: POSITION_FORCE virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 } }
    to_slave { delay_ms: 50 } to_master { delay_ms: 50 }
    robot { mass_kg: 0.5 damping_n_s_per_m: 2 }
    """,
    name="own plant",
)


# %% [markdown]
# ## Plants and network
# A mass under held forces, stepped by the semi-implicit Euler rule ten times a tick; a line that delays messages and loses one in
# twenty.

# %%
class Mass:
    def __init__(self, mass_kg, damping_n_s_per_m):
        self.mass_kg, self.damping = mass_kg, damping_n_s_per_m
        self.x = self.v = 0.0

    def advance(self, dt_s, force):
        """force(x, v) [N] acts for dt_s."""
        for _ in range(10):
            self.v += dt_s / 10 * (force(self.x, self.v) - self.damping * self.v) / self.mass_kg
            self.x += dt_s / 10 * self.v


class Line:
    def __init__(self, delay_s, loss, seed):
        self.delay_s, self.loss, self.random = delay_s, loss, random.Random(seed)
        self.flying = []

    def send(self, message, now_s):
        if message is not None and self.random.random() >= self.loss:
            self.flying.append((now_s + self.delay_s, message))

    def arrived(self, now_s):
        due = [m for at, m in self.flying if at <= now_s]
        self.flying = [(at, m) for at, m in self.flying if at > now_s]
        return due


def intended_m(t_s):
    """Where the hand wants to be: 30 mm ahead, and back after 2.5 s."""
    return 0.03 * (np.clip(t_s, 0.0, 1.0) - np.clip(t_s - 2.5, 0.0, 1.0))


def wall_n(x_m):
    """Force of a wall at 20 mm, 5 kN/m, on the robot."""
    return -5000.0 * max(0.0, x_m - 0.02)


# %% [markdown]
# ## The loop
# One tick: what has arrived, the reading, the force, the message. The force at the master port is such that force times velocity is power into the
# network: the device pushes the hand with its negative.

# %%
def run(method):
    chosen = scene.override(f"control.passivity.method={method}")
    master, slave = twoport.MasterNode(chosen), twoport.SlaveNode(chosen)
    to_slave, to_master = Line(0.05, 0.05, seed=1), Line(0.05, 0.05, seed=2)
    handle, robot = Mass(0.175, 0.05), Mass(0.5, 2.0)  # the hand's mass moves with the handle
    dt_s = 1.0 / master.rate_hz
    rows = []
    for k in range(4000):
        t_s = k * dt_s
        for message in to_slave.arrived(t_s):
            slave.receive(message)
        at_robot = slave.step(t_s, robot.x, robot.v, f_environment=-wall_n(robot.x))
        to_master.send(at_robot.message, t_s)

        for message in to_master.arrived(t_s):
            master.receive(message)
        at_hand = master.step(t_s, handle.x, handle.v)
        to_slave.send(at_hand.message, t_s)

        rows.append((t_s, handle.x, robot.x, at_hand.force[0], -wall_n(robot.x), master.observed_j))
        goal, felt, pull = intended_m(t_s), at_hand.force[0], at_robot.force[0]
        handle.advance(dt_s, lambda x, v: 400.0 * (goal - x) - 8.0 * v - felt)
        robot.advance(dt_s, lambda x, v: pull + wall_n(x))
    return np.array(rows), master.packets


# %%
results = {method: run(method) for method in ("NONE", "FORCE_PROJECTED", "INTERNAL_MODEL")}
for method, (rows, packets) in results.items():
    t_s, hand, robot, felt, pressed, energy = rows.T
    held = (t_s > 2.2) & (t_s < 2.5)
    print(
        f"{method:16} felt {felt[held].mean():5.2f} N of {pressed[held].mean():5.2f} N, "
        f"least energy put in {1e3 * energy.min():9.3f} mJ, {packets['lost']} of {packets['lost'] + packets['received']} messages lost"
    )

# %%
if plt is None:
    print("no picture: matplotlib is not installed (apt-get install python3-matplotlib)")
else:
    figure, axes = plt.subplots(2, len(results), figsize=(11, 5), sharex=True, sharey="row", constrained_layout=True)
    for (top, bottom), (method, (rows, _)) in zip(axes.T, results.items()):
        top.plot(rows[:, 0], 1e3 * rows[:, 1], label="hand")
        top.plot(rows[:, 0], 1e3 * rows[:, 2], label="robot")
        top.set(title=method, ylim=(-15, 45))
        bottom.plot(rows[:, 0], rows[:, 3], label="felt")
        bottom.plot(rows[:, 0], rows[:, 4], label="on the wall")
        bottom.set(xlabel="t [s]", ylim=(-15, 30))
    axes[0, 0].set_ylabel("position [mm]")
    axes[1, 0].set_ylabel("force [N]")
    for ax in axes[:, 0]:
        ax.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "own_plant.png", dpi=100)
    print(folder / "own_plant.png")
