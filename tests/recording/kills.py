"""Recordings of both programs that are killed (SIGKILL) at random moments: each must be read by ordinary indexed readers.

    kills.py KILLS LAB MASTER SLAVE [NODE_MODULES]

Master and slave record in turn; the recording one is killed 0.6 to 4.6 s after both have met. Each file is read through its index by
docs/examples/recordings/read_recording.py, by `twoport-lab export`, by `twoport-lab replay`, and by @mcap/core where NODE_MODULES holds it.
Prints what was lost: from the kill back to the newest message that is in the file. Exit status 77: skipped, with the reason.
"""

import pathlib
import random
import re
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SCENE = ROOT / "scenes/gripper_50ms.textproto"
try:
    sys.path.insert(0, str(ROOT / "docs/examples/recordings"))
    from read_recording import Recording
except ImportError as e:
    print(f"SKIPPED: {e}; install python3-protobuf")
    sys.exit(77)

kills, lab, programs = int(sys.argv[1]), sys.argv[2], {"master": sys.argv[3], "slave": sys.argv[4]}
modules = sys.argv[5] if len(sys.argv) > 5 and pathlib.Path(sys.argv[5], "@mcap/core").is_dir() else None
chance = random.Random(7)
lost_s = {"master": [], "slave": []}
unread = 0


def says(log, pattern):
    """The first match of the pattern in a program's log."""
    for _ in range(400):
        if found := re.search(pattern, log.read_text() if log.exists() else ""):
            return found
        time.sleep(0.05)
    raise SystemExit(f"{log}: no {pattern}")


for kill in range(kills):
    killed = "master" if kill % 2 == 0 else "slave"
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder, "killed.mcap")
        running = {}

        def start(side, *more):
            log = pathlib.Path(folder, side + ".log")
            options = ["--scene", SCENE, "--set", "duration_s=30", "--no-spin", *(["--record", file] if side == killed else [])]
            with open(log, "w") as out:
                running[side] = subprocess.Popen([programs[side], *options, *more], stdout=out, stderr=out)
            return log

        try:
            port = says(start("slave", "--listen", "127.0.0.1:0"), r"listening on 127\.0\.0\.1:(\d+)")[1]
            says(start("master", "--peer", "127.0.0.1:" + port), "paired")
            time.sleep(0.6 + 4.0 * chance.random())
            running[killed].kill()
            killed_at = time.time()
        finally:
            for each in running.values():
                each.kill()
                each.wait()
        try:
            recording = Recording(file)
            messages = sum(1 for _ in recording.read())
            assert messages == recording.messages > 0, "number of messages"
            lost_s[killed].append(killed_at - 1e-9 * recording.end)
            subprocess.run([lab, "export", file, "--csv", folder + "/trace.csv"], check=True, capture_output=True)
            assert pathlib.Path(folder, "trace-gripper.csv").stat().st_size > 0
            subprocess.run([lab, "replay", file], check=True, capture_output=True)
            if modules:
                subprocess.run(["node", HERE / "read_recording.mjs", modules, file], check=True, capture_output=True)
        except (AssertionError, OSError, subprocess.CalledProcessError) as e:
            unread += 1
            print(f"kill {kill} of the {killed}: {e} {getattr(e, 'stderr', '')}")

print(f"{kills - unread} of {kills} files are read{', by @mcap/core too' if modules else ''}")
for side, values in {**lost_s, "both": lost_s["master"] + lost_s["slave"]}.items():
    if values:
        print(f"{side:6} lost: least {min(values):.2f} s, median {statistics.median(values):.2f} s, most {max(values):.2f} s")
sys.exit(unread > 0)
