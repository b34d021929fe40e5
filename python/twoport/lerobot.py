"""Arms of LeRobot with force feedback, and recordings as its datasets.

Teleoperator stands for the leader and Robot for the follower in a loop of LeRobot's, on one computer or at each of two. They have the methods
and properties that LeRobot 0.6 documents for its classes of these names, and need nothing of it but the arms that they are given:

    teleop = twoport.lerobot.Teleoperator(scene, leader, follower)       # the pair on one computer; the loop stays as it is
    robot = twoport.lerobot.Robot(teleop)

Units: joints are JOINT.pos and JOINT.vel in LeRobot's units, degrees for arms, and JOINT.torque [N m]. `joints` says what others there are.
"""

import json
import math
import pathlib
import sys
import time
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from . import LiveMaster, LiveSlave, MasterNode, Recording, Scene, SlaveNode, __version__, load_recording
from ._parquet import write

DEGREE = (math.radians(1.0), 0.0)
COUPLES_WITHIN_S = 30.0


class _Arm:
    """Joints of an arm of LeRobot: names, units, and velocities where the arm states none."""

    def __init__(self, what: str, arm: Any, scene: Scene, joints: Mapping[str, Tuple[float, float]]):
        self.what, self.arm = what, arm
        self.names = [key[: -len(".pos")] for key in arm.action_features if key.endswith(".pos")]
        if len(self.names) != scene.dof:
            raise ValueError(f"{what} has {len(self.names)} joints ({', '.join(self.names)}); the arms of {scene.source} have {scene.dof}")
        for name in joints:
            if name not in self.names:
                raise ValueError(f"joints: {name} is no joint of {what}; it must be one of {', '.join(self.names)}")
        self.scale, self.zero = np.array([joints.get(name, DEGREE) for name in self.names]).T
        self.before: Optional[Tuple[float, Any]] = None

    def features(self, *kinds: str) -> Dict[str, type]:
        return {f"{name}.{kind}": float for kind in kinds for name in self.names}

    def numbers(self, values: Mapping[str, Any], kind: str) -> Any:
        try:
            return np.array([float(values[f"{name}.{kind}"]) for name in self.names])
        except KeyError as missing:
            raise ValueError(f"{self.what} says nothing of {missing}; it must, as of each joint") from None

    def has(self, values: Mapping[str, Any], kind: str) -> bool:
        return f"{self.names[0]}.{kind}" in values

    def named(self, kind: str, numbers: Any) -> Dict[str, float]:
        return {f"{name}.{kind}": float(number) for name, number in zip(self.names, numbers)}

    def positions(self, q: Any) -> Dict[str, float]:
        return self.named("pos", (q - self.zero) / self.scale)

    def read(self, values: Mapping[str, Any], t_s: float) -> Tuple[Any, Any]:
        """Positions [rad] and velocities [rad/s]."""
        q = self.numbers(values, "pos") * self.scale + self.zero
        if self.has(values, "vel"):
            v = self.numbers(values, "vel") * self.scale
        elif self.before is None or t_s <= self.before[0]:
            v = np.zeros(len(q))
        else:
            v = (q - self.before[1]) / (t_s - self.before[0])
        self.before = t_s, q
        return q, v

    def connect(self, calibrate: bool) -> None:
        if not self.arm.is_connected:
            self.arm.connect(calibrate)

    def disconnect(self) -> None:
        if self.arm.is_connected:
            self.arm.disconnect()


class _Follower(_Arm):
    """One that takes set points."""

    def __init__(self, arm: Any, scene: Scene, joints: Mapping[str, Tuple[float, float]]):
        super().__init__("follower", arm, scene, joints)
        self.torque = np.zeros(scene.dof)  # of the coupling on it
        self.wanted: Any = None

    def touches(self, values: Mapping[str, Any]) -> Any:
        """Torques on what the arm touches: its own reading; without one the coupling's, which stands for the arm's servos."""
        return self.numbers(values, "torque") if self.has(values, "torque") else self.torque

    def follow(self, out: Any, set_point: Any, q: Any) -> Dict[str, float]:
        """Where the arm is wanted after a tick, at whose begin it was at q. While no leader holds it, it stays."""
        self.torque = out.force
        if out.mode in ("coupled", "holding"):
            self.wanted = set_point
        elif self.wanted is None:
            self.wanted = q
        return self.positions(self.wanted)


class _Leader(_Arm):
    """One that displays torques: by its motors, or by set points of its servos."""

    def __init__(self, arm: Any, scene: Scene, joints: Mapping[str, Tuple[float, float]], stiffness: Union[float, Sequence[float], None]):
        super().__init__("leader", arm, scene, joints)
        self.by_torque = self.has(arm.feedback_features, "torque")
        if not self.by_torque and not self.has(arm.feedback_features, "pos"):
            raise ValueError(f"leader displays nothing: its feedback_features have neither {self.names[0]}.torque nor {self.names[0]}.pos")
        if not self.by_torque and stiffness is None:
            raise ValueError("servo_stiffness_n_m_per_rad is missing; the leader displays positions only, so it must be that of its servos")
        self.stiffness = np.broadcast_to(np.asarray(1.0 if stiffness is None else stiffness, float), len(self.names))
        if not (self.stiffness > 0.0).all():
            raise ValueError(f"servo_stiffness_n_m_per_rad is {stiffness}; it must be above 0")

    def display(self, q: Any, torque: Any) -> None:
        """The torque of the motors on the arm [N m], which is at q."""
        if self.by_torque:
            self.arm.send_feedback(self.named("torque", torque))
        else:
            self.arm.send_feedback(self.positions(q + torque / self.stiffness))

    def connect(self, calibrate: bool) -> None:
        """Without a torque, then with its motors on."""
        super().connect(calibrate)
        q, _ = self.read(self.arm.get_action(), -1.0)
        self.display(q, np.zeros(len(q)))
        getattr(self.arm, "enable_torque", lambda: None)()

    def disconnect(self) -> None:
        if self.arm.is_connected:
            if self.by_torque:
                self.display(None, np.zeros(len(self.names)))
            getattr(self.arm, "disable_torque", lambda: None)()
        super().disconnect()


class _Shared:
    """What both classes have of LeRobot's interface. An arm of another computer is None."""

    name = "twoport"
    calibration: Dict[str, Any] = {}

    def __init__(self, arm: Any, id: Optional[str]):
        self._arm, self.id, self._connected = arm, id, False

    def __str__(self) -> str:
        return f"{self.id} {type(self).__name__}"

    def __enter__(self) -> Any:
        self.connect()
        return self

    def __exit__(self, *_: Any) -> None:
        self.disconnect()

    @property
    def is_connected(self) -> bool:
        return self._connected

    @property
    def is_calibrated(self) -> bool:
        """Always: the arms have their own calibration."""
        return True

    def calibrate(self) -> None:
        """Nothing to do."""

    def configure(self) -> None:
        """Nothing to do."""

    def connect(self, calibrate: bool = True) -> None:
        if self._arm:
            self._arm.connect(calibrate)
        self._connected = True

    def disconnect(self) -> None:
        if self._arm and self._connected:
            self._arm.disconnect()
        self._connected = False

    def _need_connection(self, what: str) -> None:
        if not self._connected:
            raise ConnectionError(f"{what}: {self} is not connected; call connect() first")


class Teleoperator(_Shared):
    """The leader. get_action() is one tick: it displays the follower's force at the leader and returns where the follower is wanted.

    scene: with space JOINTS and the number of joints of the arms; its rate is that of the loop
    leader: a teleoperator of LeRobot. Torques go to its send_feedback(), as JOINT.torque [N m] or, where its
        feedback_features have JOINT.pos only, as set points of servos of servo_stiffness_n_m_per_rad
    follower: a robot of LeRobot
    Where one of the two is at another computer, it is ADDRESS:PORT: as leader that to listen at, as follower that of who listens.
    joints: (radians in one unit, radians at zero) of joints that are not in degrees with the zero of the scene's arm
    key: file of twoport-keygen; without one only addresses of this machine
    Errors: ValueError; OSError where the two sides cannot work together.
    """

    def __init__(
        self,
        scene: Scene,
        leader: Any,
        follower: Any,
        *,
        joints: Mapping[str, Tuple[float, float]] = {},
        servo_stiffness_n_m_per_rad: Union[float, Sequence[float], None] = None,
        key: str = "",
        id: Optional[str] = None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.leader: Any = None if isinstance(leader, str) else _Leader(leader, scene, joints, servo_stiffness_n_m_per_rad)
        self.follower: Any = None if isinstance(follower, str) else _Follower(follower, scene, joints)
        super().__init__(self.leader, id)
        self._clock, self._start = clock, clock()
        self._side: Any
        if self.leader and self.follower:
            self._side, self._slave = MasterNode(scene), SlaveNode(scene)
        elif self.leader:
            self._side = LiveMaster(scene, follower, key=key)
        elif self.follower:
            self._side = LiveSlave(scene, leader, key=key)
        else:
            raise ValueError(f"leader and follower are {leader} and {follower}; one of them must be an arm of this computer")
        self._seen: Optional[Mapping[str, Any]] = None  # of the follower, since the last tick; over a link the newest

    @property
    def action_features(self) -> Dict[str, type]:
        return dict(self.leader.arm.action_features) if self.leader else self.follower.features("pos")

    @property
    def feedback_features(self) -> Dict[str, Any]:
        """None: the coupling gives the leader its force."""
        return {}

    def send_feedback(self, feedback: Mapping[str, Any]) -> None:
        """Nothing to do."""

    @property
    def observed_j(self) -> float:
        """Energy that the hand has put in, E(0) not included [J]; not at a follower whose leader is elsewhere."""
        return self._side.observed_j

    @property
    def round_trip_s(self) -> Optional[float]:
        return self._side.round_trip_s

    @property
    def mode(self) -> str:
        return self._side.mode

    def get_action(self) -> Dict[str, Any]:
        """The follower stays while no leader is coupled. Where the follower is elsewhere: the leader's own positions."""
        self._need_connection("get_action")
        t_s = self._clock() - self._start
        if self.follower:
            seen, self._seen = self._seen or self.follower.arm.get_observation(), None
            x, v_x = self.follower.read(seen, t_s)
            f = self.follower.touches(seen)
        if not self.leader:
            out = self._side.step(x, v_x, f)
            return self.follower.follow(out, out.set_point, x)
        action = self.leader.arm.get_action()
        q, v_q = self.leader.read(action, t_s)
        if not self.follower:
            self.leader.display(q, -self._side.step(q, v_q).force)
            if self._side.peer_x is not None:
                self._seen = {**self.leader.positions(self._side.peer_x), **self.leader.named("torque", self._side.peer_f)}
            return dict(action)
        at_hand = self._side.step(t_s, q, v_q)
        if at_hand.message is not None:
            self._slave.receive(at_hand.message)
        at_robot = self._slave.step(t_s, x, v_x, f_environment=f)
        if at_robot.message is not None:
            self._side.receive(at_robot.message)
        self.leader.display(q, -at_hand.force)
        return {**action, **self.follower.follow(at_robot, at_robot.x_d, x)}

    def _wait_for_follower(self) -> None:
        """Half a minute at most."""
        until_s = self._clock() + COUPLES_WITHIN_S
        while self.mode != "coupled":
            if self._clock() > until_s:
                self.disconnect()
                raise ConnectionError(f"no side has coupled within {COUPLES_WITHIN_S:g} s; start the loop at the follower")
            self.get_action()


class Robot(_Shared):
    """The follower of a Teleoperator. get_observation() has the force besides, and the Teleoperator's next tick takes it.

    Where the follower is elsewhere the link says where it is, connect() waits until the two are coupled, and send_action() does nothing.
    """

    robot_type = _Shared.name

    def __init__(self, teleop: Teleoperator):
        super().__init__(teleop.follower, teleop.id)
        self._teleop = teleop
        self.cameras: Mapping[str, Any] = getattr(self._arm.arm, "cameras", {}) if self._arm else {}

    @property
    def action_features(self) -> Dict[str, type]:
        return dict(self._arm.arm.action_features) if self._arm else self._teleop.action_features

    @property
    def observation_features(self) -> Dict[str, Any]:
        """Those of the follower, and JOINT.torque [N m] of each joint: the follower's own reading, else the coupling's on it."""
        arm = self._arm or self._teleop.leader
        return {**(self._arm.arm.observation_features if self._arm else arm.features("pos")), **arm.features("torque")}

    def connect(self, calibrate: bool = True) -> None:
        if not self._arm:
            self._teleop._wait_for_follower()
        super().connect(calibrate)

    def get_observation(self) -> Dict[str, Any]:
        self._need_connection("get_observation")
        if not self._arm:
            return dict(self._teleop._seen or {})
        self._teleop._seen = seen = self._arm.arm.get_observation()
        return {**self._arm.named("torque", self._arm.torque), **seen}

    def send_action(self, action: Mapping[str, Any]) -> Dict[str, Any]:
        """Returns what the follower was sent."""
        self._need_connection("send_action")
        return self._arm.arm.send_action(action) if self._arm else dict(action)


def _declare() -> None:
    """LeRobot asks for its classes in places: these two are of them, without being derived."""
    try:
        from lerobot.robots import Robot as TheirRobot
        from lerobot.teleoperators import Teleoperator as TheirTeleoperator
    except ImportError:
        return
    TheirRobot.register(Robot)
    TheirTeleoperator.register(Teleoperator)


_declare()

# ---- datasets

# Feature, column of the trace: what the robot's side knew, and what the hand asked for.
_FEATURES = {
    "observation.state": ("slave_x", "pos"),
    "observation.velocity": ("slave_v", "vel"),
    "observation.force": ("env_f", "force"),
    "action": ("slave_x", "pos"),  # less position_error
    "action.force": ("master_f", "force"),
}
_INDICES = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64", "task_index": "int64"}
_DATA, _EPISODES = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet", "meta/episodes/chunk-000/file-000.parquet"


def _turned(by: Any, r: Any) -> Any:
    """The rotation vector of a turn by r, then by `by`."""

    def quaternion(v: Any) -> Tuple[Any, Any]:
        half = np.linalg.norm(v, axis=1, keepdims=True) / 2
        return np.cos(half), np.sinc(half / np.pi) / 2 * v

    (a, b), (c, d) = quaternion(by), quaternion(r)
    w, u = a * c - (b * d).sum(axis=1, keepdims=True), a * d + c * b + np.cross(b, d)
    half = np.arctan2(np.linalg.norm(u, axis=1, keepdims=True), np.abs(w))
    return np.copysign(2.0, w) * u / np.sinc(half / np.pi)


def _wanted(trace: Any, poses: bool) -> Any:
    """Where the robot is wanted: the hand's position as it has arrived, in the robot's place and scale. Not coupled: where it is."""
    x, error = trace["slave_x"], trace["position_error"]
    if not poses:
        return x - error
    return np.hstack([x[:, :3] - error[:, :3], _turned(-error[:, 3:], x[:, 3:])])


def _frames(recording: Recording, fps: int, episode: int, first: int) -> Dict[str, Any]:
    """The rows of the trace that are newest at each frame's time."""
    trace = recording.trace
    count = 1 + int((trace["t_s"][-1] - trace["t_s"][0]) * fps)
    time_s = np.arange(count) / fps
    rows = np.searchsorted(trace["t_s"], trace["t_s"][0] + time_s + 1e-9, side="right") - 1
    frames = {feature: trace[column][rows].reshape(count, -1).astype(np.float32) for feature, (column, _) in _FEATURES.items()}
    frames["observation.force"] *= -1.0  # of the robot on the environment
    frames["action"] = _wanted(trace[rows], "," in recording.units["slave_x"]).reshape(count, -1).astype(np.float32)
    frames["timestamp"] = time_s.astype(np.float32)
    frames["frame_index"], frames["index"] = np.arange(count), first + np.arange(count)
    frames["episode_index"], frames["task_index"] = np.full(count, episode), np.zeros(count, int)
    return frames


def _stats(frames: Mapping[str, Any]) -> Dict[str, Dict[str, Any]]:
    quantiles = (0.01, 0.10, 0.50, 0.90, 0.99)
    stats = {}
    for feature, values in frames.items():
        values = values.reshape(len(values), -1).astype(float)
        stats[feature] = {key: getattr(np, key)(values, axis=0).tolist() for key in ("min", "max", "mean", "std")}
        stats[feature]["count"] = [len(values)]
        stats[feature].update({f"q{round(100 * q):02}": row.tolist() for q, row in zip(quantiles, np.quantile(values, quantiles, axis=0))})
    return stats


def write_dataset(
    folder: Union[str, pathlib.Path],
    recordings: Sequence[Union[str, pathlib.Path]],
    *,
    fps: int = 50,
    task: str = "teleoperate",
    names: Optional[Sequence[str]] = None,
) -> Dict[str, Any]:
    """Writes recordings (.mcap) as episodes with forces: a dataset of LeRobot's layout v3.0, without videos; returns its info.json.

    names: of the axes or joints; absent: joint_1, ... Units are SI, named in info.json; observation.force is that of the robot on what it
    touches, action where the robot is wanted. Errors: ValueError.
    """
    if not recordings:
        raise ValueError("recordings are none; at least one must be given")
    if not 1 <= fps <= 1000:
        raise ValueError(f"fps is {fps}; it must be 1 to 1000")
    folder = pathlib.Path(folder)
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"{folder} is not empty; a dataset needs a folder of its own")
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    episodes: List[Dict[str, Any]] = []
    units: Dict[str, str] = {}
    first = 0
    for path in recordings:
        recording = load_recording(path)
        if len(recording.trace) == 0:
            raise ValueError(f"{path} has no rows")
        if units not in ({}, recording.units):
            raise ValueError(f"{path} has other axes than {recordings[0]}; episodes of one dataset have the same")
        units = recording.units
        episodes.append(_frames(recording, fps, len(episodes), first))
        first += len(episodes[-1]["timestamp"])
        if episodes[-1]["action"].shape[1] != episodes[0]["action"].shape[1]:
            raise ValueError(f"{path} has other axes than {recordings[0]}; episodes of one dataset have the same")

    def feature(name: str) -> Dict[str, Any]:
        if name in _INDICES:
            return {"dtype": _INDICES[name], "shape": [1], "names": None}
        column, kind = _FEATURES[name]
        size = episodes[0][name].shape[1]
        own = list(names) if names is not None else [f"joint_{i + 1}" for i in range(size)]
        if len(own) != size:
            raise ValueError(f"names are {len(own)}; they must be {size}, one for each number of {name}")
        return {"dtype": "float32", "shape": [size], "names": [f"{each}.{kind}" for each in own], "unit": units[column]}

    info = {
        "codebase_version": "v3.0", "fps": fps, "features": {name: feature(name) for name in episodes[0]},
        "total_episodes": len(episodes), "total_frames": first, "total_tasks": 1,
        "chunks_size": 1000, "data_files_size_in_mb": 100, "video_files_size_in_mb": 200,
        "data_path": _DATA, "video_path": None,
        "robot_type": f"twoport {__version__}", "splits": {"train": f"0:{len(episodes)}"},
    }  # fmt: skip
    _write_parquet(folder, episodes, task)
    everything = {name: np.concatenate([frames[name] for frames in episodes]) for name in episodes[0]}
    (folder / "meta/stats.json").write_text(json.dumps(_stats(everything), indent=1) + "\n")
    (folder / "meta/info.json").write_text(json.dumps(info, indent=1) + "\n")
    return info


def _scalar(values: Any) -> Any:
    """LeRobot has a feature of one number as a column of numbers."""
    return values.ravel() if values.ndim == 2 and values.shape[1] == 1 else values


def _write_parquet(folder: pathlib.Path, episodes: Sequence[Mapping[str, Any]], task: str) -> None:
    write(folder / _DATA.format(chunk_index=0, file_index=0), [{name: _scalar(v) for name, v in frames.items()} for frames in episodes])
    rows: Dict[str, Any] = {"episode_index": np.arange(len(episodes)), "tasks": [[task]] * len(episodes)}
    rows["length"] = np.array([len(frames["index"]) for frames in episodes])
    for where in ("data/chunk_index", "data/file_index", "meta/episodes/chunk_index", "meta/episodes/file_index"):
        rows[where] = np.zeros(len(episodes), int)
    rows["dataset_from_index"] = np.array([frames["index"][0] for frames in episodes])
    rows["dataset_to_index"] = np.array([frames["index"][-1] + 1 for frames in episodes])
    of_each = [_stats(frames) for frames in episodes]
    for name, of in of_each[0].items():
        rows |= {f"stats/{name}/{key}": np.array([stats[name][key] for stats in of_each]) for key in of}
    write(folder / _EPISODES, [rows])
    # The task is the index of the frame that pandas makes of this table.
    index = {"index_columns": ["task"], "column_indexes": [], "pandas_version": "1.5.3", "columns": [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64", "metadata": None},
        {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", "metadata": None}]}  # fmt: skip
    write(folder / "meta/tasks.parquet", [{"task_index": np.zeros(1, int), "task": [task]}], {"pandas": json.dumps(index)})


def main(arguments: Sequence[str]) -> int:
    if len(arguments) < 2:
        print("python -m twoport.lerobot FOLDER RECORDING.mcap...: a new folder, and one recording or more", file=sys.stderr)
        return 2
    try:
        info = write_dataset(arguments[0], arguments[1:])
    except (ValueError, OSError) as wrong:
        print(f"python -m twoport.lerobot: {wrong}", file=sys.stderr)
        return 2
    print(f"{arguments[0]}: {info['total_episodes']} episodes, {info['total_frames']} frames, {info['fps']} a second")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
