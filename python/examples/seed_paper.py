# %% [markdown]
# # Two figures of the reference paper
# A hand slides along a stiff wall that is rendered at 2 kHz, its target 6 mm inside (the paper's Figures 8 and 9). Damping along the velocity turns the
# force against the sliding; damping along the force keeps its direction. Without control the sampled wall
# generates energy (Figure 7).
#
#     PYTHONPATH=build/release/python /usr/bin/python3 python/examples/seed_paper.py [FOLDER]

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
scene = twoport.load_scene(root / "scenes/paper/slide.textproto")

# %% [markdown]
# ## The three runs
# The paper's equations have neither prediction nor reference energy.

# %%
published = ["control.passivity.reference_energy=false", "control.passivity.predict=false"]
runs = {
    method: twoport.run(scene.override(published, f"control.passivity.method={method}"), verdict="plain")
    for method in ("NONE", "CLASSIC", "FORCE_PROJECTED")
}


# %% [markdown]
# ## Angle between wanted and felt force
# Wherever both exceed 0.1 N, from 0.3 s on.

# %%
def turned_deg(trace):
    felt, wanted = trace["master_f"], trace["master_f_wanted"]
    sizes = np.linalg.norm(felt, axis=1), np.linalg.norm(wanted, axis=1)
    seen = (trace["t_s"] > 0.3) & (sizes[0] > 0.1) & (sizes[1] > 0.1)
    along = np.einsum("ij,ij->i", felt[seen], wanted[seen]) / sizes[0][seen] / sizes[1][seen]
    return np.degrees(np.arccos(np.clip(along, -1.0, 1.0)))


for method, result in runs.items():
    turned = turned_deg(result.trace)
    print(
        f"{method:16} force turned {np.sqrt(np.mean(turned**2)):5.1f} deg rms, "
        f"least energy of the port {1e3 * result.summary['min_port_energy_j']:8.3f} mJ"
    )

# %% [markdown]
# ## Pictures
# Left and middle: the force on the hand, `-master_f`, where the hand is; red where it is more than 5 degrees off the wall's
# normal. Right: the energy that the hand has put in.

# %%
if plt is None:
    print("no picture: matplotlib is not installed (apt-get install python3-matplotlib)")
else:
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.4), constrained_layout=True)
    y = np.array([-60.0, 60.0])
    for ax, method in zip(axes, ("CLASSIC", "FORCE_PROJECTED")):
        trace = runs[method].trace
        rows = trace[(trace["t_s"] > 0.3) & (np.linalg.norm(trace["master_f_wanted"], axis=1) > 0)][::11]
        x_mm, f = 1e3 * rows["master_x"], -rows["master_f"]
        off_deg = np.abs((np.degrees(np.arctan2(f[:, 1], f[:, 0])) - 30.0 + 180.0) % 360.0 - 180.0)
        ax.fill_betweenx(y, -200, -y * np.tan(np.pi / 6), color="#e8dcc4")
        for part, colour in ((off_deg <= 5.0, "#2a788e"), (off_deg > 5.0, "#ca5a32")):
            ax.quiver(*x_mm[part, :2].T, *f[part, :2].T, angles="xy", scale_units="xy", scale=0.1, width=0.002, color=colour)
        ax.set(title=method, xlabel="x [mm]", ylabel="y [mm]", xlim=(-45, 75), ylim=(-60, 60), aspect="equal")
    for method, colour in (("NONE", "#808080"), ("CLASSIC", "#ca5a32"), ("FORCE_PROJECTED", "#2a788e")):
        trace = runs[method].trace
        axes[2].plot(trace["t_s"], 1e3 * trace["master_energy_j"], color=colour, lw=1, label=method)
    axes[2].set(title="energy that the hand has put in", xlabel="t [s]", ylabel="energy [mJ]")
    axes[2].legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "seed_paper.png", dpi=100)
    print(folder / "seed_paper.png")
