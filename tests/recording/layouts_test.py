"""Every field that a layout of docs/examples/recordings names is in a recording and in a stream.

    layouts_test.py LAB MASTER SLAVE

Exit status 77: skipped, with the reason.
"""

import json
import pathlib
import re
import socket
import subprocess
import sys
import tempfile
import xml.etree.ElementTree

ROOT = pathlib.Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "docs/examples/recordings"
SCENE = ROOT / "scenes/gripper_50ms.textproto"
try:
    sys.path.insert(0, str(EXAMPLES))
    from read_recording import Recording
except ImportError as e:
    print(f"SKIPPED: {e}; install python3-protobuf")
    sys.exit(77)


def missing_in_recording(lab, folder):
    """Paths of the Foxglove layout, /TOPIC.FIELD or /TOPIC.FIELD[INDEX], without their field."""
    file = pathlib.Path(folder, "run.mcap")
    subprocess.run([lab, "run", SCENE, "--set", "duration_s=0.5", "--set", "expect={}", "--record", file, "--trace", "none"], check=True, stdout=subprocess.DEVNULL)
    recording = Recording(file)
    topics = {topic: recording.classes[number].DESCRIPTOR for number, (topic, _, _) in recording.channels.items()}
    layout = (EXAMPLES / "foxglove_layout.json").read_text()
    named = re.findall(r'"(?:value|topicPath)": "(/[^"]+)"', layout)
    json.loads(layout)
    missing = []
    for path in named:
        topic, _, field = path.partition(".")
        name, index = re.fullmatch(r"([a-z_0-9]*)(\[\d+\])?", field).groups()
        if topic not in topics or name and name not in topics[topic].fields_by_name:
            missing.append(path)
        elif name and (topics[topic].fields_by_name[name].label == 3) != (index is not None):
            missing.append(path)  # a number is no list, and a list no number
    return named, missing


def missing_in_stream(master, slave):
    """Curves of the PlotJuggler layout, /SIDE/COLUMN or /SIDE/COLUMN[INDEX], or /SIDE/gripper/..., that neither side streams."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        heard.bind(("127.0.0.1", 0))
        heard.settimeout(20)
        free.bind(("127.0.0.1", 0))
        address = "127.0.0.1:%d" % free.getsockname()[1]
        free.close()
        options = ["--scene", SCENE, "--set", "duration_s=2", "--duration", "10", "--no-realtime", "--stream", "127.0.0.1:%d" % heard.getsockname()[1]]
        programs = [
            subprocess.Popen([slave, *options, "--listen", address], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL),
            subprocess.Popen([master, *options, "--peer", address], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL),
        ]
        sides = {}
        try:
            while len(sides) < 4:
                for side, columns in json.loads(heard.recv(65536)).items():
                    if side != "timestamp":
                        sides.update({side + "/gripper": columns["gripper"]} if "gripper" in columns else {side: columns})
        finally:
            for each in programs:
                each.terminate()
                each.wait()
    layout = xml.etree.ElementTree.parse(EXAMPLES / "plotjuggler_layout.xml")
    named = [curve.get("name") for curve in layout.iter("curve")]
    missing = []
    for path in named:
        side, name, index = re.fullmatch(r"/([a-z]+(?:/gripper)?)/([a-z_0-9]+)(\[\d+\])?", path).groups()
        value = sides.get(side, {}).get(name, "absent")
        if value == "absent" or isinstance(value, list) != (index is not None):
            missing.append(path)
    return named, missing


with tempfile.TemporaryDirectory() as folder:
    found = {"foxglove_layout.json": missing_in_recording(sys.argv[1], folder), "plotjuggler_layout.xml": missing_in_stream(*sys.argv[2:])}
for layout, (named, missing) in found.items():
    print(f"{layout}: {len(named)} fields, missing: {', '.join(missing) or 'none'}")
sys.exit(any(missing or not named for named, missing in found.values()))
