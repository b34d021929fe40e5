# %% [markdown]
# # A small part of the map
# Where does a method stay stable, and how much of a held press does the hand feel? Round trip to the right, stiffness of the wall upwards; the whole
# map is that of `twoport-lab map` (docs/reference/methods.md).
#
#     PYTHONPATH=build/release/python /usr/bin/python3 python/examples/map.py [FOLDER]

# %%
import pathlib
import sys

import numpy as np

import twoport

try:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
except ImportError:
    plt = None

root = pathlib.Path(__file__).resolve().parents[2]
folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "out/python")
scene = twoport.load_scene(root / "scenes/map.textproto")

# %% [markdown]
# ## The sweep
# One cell is one run of 14.8 s. Ctrl-C ends it.

# %%
delays_ms = [1, 10, 50, 100]
stiffnesses = [500, 2000, 8000]
methods = ["FORCE_PROJECTED", "INTERNAL_MODEL"]
table = twoport.sweep(
    scene,
    [
        "control.passivity.method=" + ",".join(methods),
        "environment[0].wall.stiffness_n_per_m=" + ",".join(map(str, stiffnesses)),
        "to_slave.delay_ms,to_master.delay_ms=" + ",".join(map(str, delays_ms)),
    ],
)
shape = (len(methods), len(stiffnesses), len(delays_ms))
stable = table["stable"].reshape(shape)
held = table["held_force_ratio"].reshape(shape)

# %% [markdown]
# ## Held press: force felt over force at the wall

# %%
for method, is_stable, ratio in zip(methods, stable, held):
    print(method)
    print("  N/m \\ round trip" + "".join(f"{2 * d:8} ms" for d in delays_ms))
    for k, row, good in zip(stiffnesses, ratio, is_stable):
        print(f"  {k:16}" + "".join(f"{100 * r:9.0f} %" if s else "   unstable" for r, s in zip(row, good)))

# %%
if plt is None:
    print("no picture: matplotlib is not installed (apt-get install python3-matplotlib)")
else:
    figure, axes = plt.subplots(1, len(methods), figsize=(9, 3.4), sharey=True, constrained_layout=True)
    for ax, method, is_stable, ratio in zip(axes, methods, stable, held):
        shown = np.where(is_stable > 0, ratio, np.nan)
        image = ax.imshow(shown, origin="lower", vmin=0, vmax=1, aspect="auto", cmap="viridis")
        ax.set_xticks(range(len(delays_ms)), [2 * d for d in delays_ms])
        ax.set_yticks(range(len(stiffnesses)), stiffnesses)
        ax.set(title=method, xlabel="round trip [ms]")
    axes[0].set_ylabel("wall [N/m]")
    figure.colorbar(image, ax=axes, label="felt / pressed (white: unstable)")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "map.png", dpi=100)
    print(folder / "map.png")
