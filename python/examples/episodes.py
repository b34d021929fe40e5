# %% [markdown]
# # Recordings as episodes for learning from demonstration
# Each recording becomes one episode: arrays at a fixed number of frames a second, named as LeRobot's datasets name theirs, forces included.
# NumPy writes them (`episode_000000.npz`, ...); `info.json` has sizes, units and the number of frames.
#
#     PYTHONPATH=build/release/python /usr/bin/python3 python/examples/episodes.py FOLDER RECORDING.mcap...

# %%
import json
import pathlib
import sys

import numpy as np

import twoport

FRAMES_PER_S = 50
# Feature, column of the trace: what the robot's side knew, and what the hand asked for.
FEATURES = {
    "observation.state": "slave_x",
    "observation.velocity": "slave_v",
    "observation.force": "env_f",
    "action": "master_x",
    "action.force": "master_f",
}


# %%
def episode_of(recording, index):
    """The rows of the trace that are newest at each frame's time."""
    trace = recording.trace
    time_s = np.arange(trace["t_s"][0], trace["t_s"][-1], 1.0 / FRAMES_PER_S)
    rows = np.searchsorted(trace["t_s"], time_s, side="right") - 1
    frames = {feature: trace[column][rows] for feature, column in FEATURES.items()}
    frames |= {"timestamp": time_s - time_s[0], "frame_index": np.arange(len(rows)), "episode_index": np.full(len(rows), index)}
    frames["next.done"] = frames["frame_index"] == len(rows) - 1
    return frames


# %%
if len(sys.argv) < 3:
    sys.exit("episodes.py FOLDER RECORDING.mcap...: a folder, and one recording or more")
folder = pathlib.Path(sys.argv[1])
folder.mkdir(parents=True, exist_ok=True)
features, frames_of_all = None, 0
for index, path in enumerate(sys.argv[2:]):
    recording = twoport.load_recording(path)
    if recording.torn:
        print(f"{path}: has no end; its program was killed")
    frames = episode_of(recording, index)
    found = {name: {"dtype": str(a.dtype), "shape": list(a.shape[1:]), "unit": recording.units.get(FEATURES.get(name, ""), "")} for name, a in frames.items()}
    if features not in (None, found):
        sys.exit(f"{path}: has other features than {sys.argv[2]}; episodes of one folder have the same degrees of freedom")
    features = found
    np.savez_compressed(folder / f"episode_{index:06}.npz", **frames)
    frames_of_all += len(frames["timestamp"])
    print(f"{folder}/episode_{index:06}.npz: {len(frames['timestamp'])} frames of {path}")
info = {"fps": FRAMES_PER_S, "total_episodes": len(sys.argv) - 2, "total_frames": frames_of_all, "features": features}
(folder / "info.json").write_text(json.dumps(info, indent=1) + "\n")
