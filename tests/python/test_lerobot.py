"""twoport.lerobot beside a stand-in of LeRobot's interface, with the simulated arms of python/examples/lerobot_pair.py: test_lerobot.py [CLASS]

PYTHONPATH names the folder of the module, TWOPORT_LAB the program twoport-lab, TWOPORT_NPM a folder for a reader of Parquet.
"""

import abc
import inspect
import json
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import types
import unittest

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENES = ROOT / "scenes"
LAB = os.environ["TWOPORT_LAB"]
sys.path.insert(0, str(ROOT / "python/examples"))


def abstract_class(name, methods, properties):
    """As LeRobot 0.6.2 declares it: name and parameters of each method."""

    def method(parameters):
        scope = {}
        exec(f"def f({parameters}): pass", scope)
        return abc.abstractmethod(scope["f"])

    members = {each: method(parameters) for each, parameters in methods.items()}
    members |= {each: property(abc.abstractmethod(lambda self: None)) for each in properties}
    return abc.ABCMeta(name, (), members)


COMMON = {"connect": "self, calibrate=True", "calibrate": "self", "configure": "self", "disconnect": "self"}
THEIRS = {
    "robots": abstract_class(
        "Robot", {**COMMON, "get_observation": "self", "send_action": "self, action"},
        ["observation_features", "action_features", "is_connected", "is_calibrated"]),
    "teleoperators": abstract_class(
        "Teleoperator", {**COMMON, "get_action": "self", "send_feedback": "self, feedback"},
        ["action_features", "feedback_features", "is_connected", "is_calibrated"]),
}  # fmt: skip
sys.modules["lerobot"] = types.ModuleType("lerobot")
for folder, theirs in THEIRS.items():
    sys.modules[f"lerobot.{folder}"] = types.ModuleType(folder)
    setattr(sys.modules[f"lerobot.{folder}"], theirs.__name__, theirs)

import lerobot_pair as pair  # noqa: E402

import twoport  # noqa: E402
import twoport.lerobot  # noqa: E402

STIFFNESS = pair.STIFFNESS_N_M_PER_RAD


def scene(*overrides):
    return twoport.load_scene(pair.SCENE, *overrides)


class TorqueLeader(pair.Leader):
    """Light, with motors that take torques."""

    torque = np.zeros(6)

    @property
    def feedback_features(self):
        return {f"{joint}.torque": float for joint in pair.JOINTS}

    def send_feedback(self, feedback):
        self.torque = np.array([feedback[f"{joint}.torque"] for joint in pair.JOINTS])

    def servos(self):
        return self.torque


class TurnedLeader(pair.Leader):
    """Each joint reads 20 degrees more than the hand has moved it."""

    def get_action(self):
        return {name: position + 20.0 for name, position in self.positions().items()}

    def send_feedback(self, feedback):
        self.take({name: position - 20.0 for name, position in feedback.items()})


class SensingFollower(pair.Follower):
    world = None

    @property
    def observation_features(self):
        return {f"{joint}.{kind}": float for kind in ("pos", "torque") for joint in pair.JOINTS}

    def get_observation(self):
        return {**self.positions(), **{f"{joint}.torque": f for joint, f in zip(pair.JOINTS, self.world.pressed_n_m())}}


def run(leader, follower, *overrides, **options):
    world = follower.world = pair.World(leader, follower)
    teleop = twoport.lerobot.Teleoperator(scene(*overrides), leader, follower, clock=lambda: world.t_s, **options)
    return pair.loop(teleop, twoport.lerobot.Robot(teleop), 60, world), world, teleop


class Interface(unittest.TestCase):
    def test_the_classes_have_the_members_of_lerobots_and_count_as_these(self):
        for theirs in THEIRS.values():
            ours = getattr(twoport.lerobot, theirs.__name__)
            self.assertTrue(issubclass(ours, theirs))
            self.assertTrue(theirs.__abstractmethods__)
            for member in theirs.__abstractmethods__:
                asked, found = getattr(theirs, member), getattr(ours, member)
                self.assertEqual(isinstance(asked, property), isinstance(found, property), member)
                self.assertTrue(isinstance(found, property) or list(inspect.signature(asked).parameters) == list(inspect.signature(found).parameters), member)

    def test_without_lerobot_they_work_by_their_members(self):
        code = f"import sys; sys.modules['lerobot'] = None; sys.path.insert(0, {str(ROOT / 'python/examples')!r}); import lerobot_pair; lerobot_pair.main()"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(len(done.stdout.splitlines()), 2)

    def test_features_are_those_of_what_is_returned(self):
        leader, follower = pair.Leader(), pair.Follower()
        clock = iter(np.arange(100) / 60.0).__next__
        teleop = twoport.lerobot.Teleoperator(scene(), leader, follower, servo_stiffness_n_m_per_rad=STIFFNESS, clock=clock)
        robot = twoport.lerobot.Robot(teleop)
        for ours, arm in ((teleop, leader), (robot, follower)):
            self.assertFalse(ours.is_connected)
            self.assertTrue(ours.is_calibrated)
            ours.connect()
            self.assertTrue(ours.is_connected and arm.is_connected)
        self.assertEqual(set(robot.get_observation()), set(robot.observation_features))
        action = teleop.get_action()
        self.assertEqual(set(action), set(teleop.action_features))
        self.assertEqual(set(robot.send_action(action)), set(robot.action_features))
        self.assertEqual(set(robot.action_features), set(teleop.action_features))
        self.assertEqual((robot.robot_type, robot.id, robot.cameras), (robot.name, None, {}))
        for ours, arm in ((teleop, leader), (robot, follower)):
            ours.disconnect()
            self.assertFalse(ours.is_connected or arm.is_connected)

    def test_units_of_joints_are_what_is_stated(self):
        """A gripper of 0 to 100, 1.9 rad wide: the leader's is opened by 10 of 100, and the follower's set point moves by as much."""
        leader, follower, now = pair.Leader(), pair.Follower(), [0.0]
        arms = {joint: (0.019, 0.0) for joint in ("gripper",)}
        teleop = twoport.lerobot.Teleoperator(scene(), leader, follower, joints=arms, servo_stiffness_n_m_per_rad=STIFFNESS, clock=lambda: now[0])
        teleop.connect()
        for k in range(300):
            now[0] = (k + 1) / 60.0
            moved = min(1.0, max(0.0, k / 60.0 - 1.0))
            leader.get_action = lambda: {**leader.positions(), "gripper.pos": 10.0 * moved, "elbow_flex.pos": 5.0 * moved}
            sent = teleop.get_action()
            follower.q = np.radians([sent[f"{joint}.pos"] for joint in pair.JOINTS[:5]] + [0.0])
            follower.q[5] = np.radians(sent["gripper.pos"])
        self.assertAlmostEqual(sent["gripper.pos"], 10.0, delta=0.3)
        self.assertAlmostEqual(sent["elbow_flex.pos"], 5.0, delta=0.1)
        # What the set point of the leader's gripper says is in its unit too.
        teleop.leader.display(np.array([0, 0, 0, 0, 0, 0.38]), np.array([0, 0, 0, 0, 0, 0.019 * STIFFNESS]))
        self.assertAlmostEqual(np.degrees(leader.goal[5]), 21.0, delta=1e-9)

    def test_what_cannot_work_is_refused_in_one_sentence(self):
        leader, follower = pair.Leader(), pair.Follower()

        class Less(pair.Leader):
            action_features = feedback_features = {"shoulder_pan.pos": float}

        class Silent(pair.Leader):
            feedback_features = {}

        make, robot = twoport.lerobot.Teleoperator, twoport.lerobot.Robot
        for call, error, words in (
            (lambda: make(scene(), Less(), follower), ValueError, r"leader has 1 joints \(shoulder_pan\); the arms of .*so101.textproto have 6"),
            (lambda: make(scene(), Silent(), follower), ValueError, "leader displays nothing: its feedback_features have neither shoulder_pan.torque nor"),
            (lambda: make(scene(), leader, follower), ValueError, "servo_stiffness_n_m_per_rad is missing"),
            (lambda: make(scene(), leader, follower, servo_stiffness_n_m_per_rad=0), ValueError, "servo_stiffness_n_m_per_rad is 0; it must be above 0"),
            (lambda: make(scene(), leader, follower, joints={"jaw": (1, 0)}), ValueError, "joints: jaw is no joint of leader; it must be one of shoulder_pan"),
            (lambda: make(scene(), TorqueLeader(), follower).get_action(), ConnectionError, "get_action: None Teleoperator is not connected; call connect"),
            (lambda: robot(make(scene(), TorqueLeader(), follower)).get_observation(), ConnectionError, "None Robot is not connected; call connect"),
            (lambda: robot(make(scene(), TorqueLeader(), follower)).send_action({}), ConnectionError, "None Robot is not connected; call connect"),
            (lambda: robot(make(scene(), TorqueLeader(), "127.0.0.1:45000")).connect(), ConnectionError, "None Teleoperator is not connected"),
            (lambda: make(scene(), TorqueLeader(), "192.0.2.1:45000"), ValueError, "without a key only addresses of this machine"),
            (lambda: make(scene(), "here", "there"), ValueError, "leader and follower are here and there; one of them must be an arm of this computer"),
        ):
            with self.assertRaisesRegex(error, words):
                call()
        teleop = make(scene(), TorqueLeader(), follower)
        teleop.connect()
        teleop.leader.arm.get_action = dict
        with self.assertRaisesRegex(ValueError, "leader says nothing of 'shoulder_pan.pos'"):
            teleop.get_action()


class Pair(unittest.TestCase):
    """The loop with its two objects replaced."""

    def test_servos_as_leader_display_what_the_follower_presses(self):
        (felt, pressed, said), world, teleop = run(pair.Leader(), pair.Follower(), servo_stiffness_n_m_per_rad=STIFFNESS)
        self.assertGreater(pressed, 1.0)
        self.assertAlmostEqual(abs(felt), pressed, delta=0.05 * pressed)
        self.assertAlmostEqual(said, pressed, delta=0.05 * pressed)
        # What the servos do within a tick is energy that the hand puts in, and is not in the account.
        self.assertGreater(world.energy_j, teleop.observed_j)
        self.assertGreater(world.least_j, -12.6e-3)

    def test_the_hand_gets_no_more_than_the_allowance(self):
        """A light leader of motors, a follower that senses: without a passivity layer the loop of 60 Hz feeds the hand."""
        least = {}
        for method in ("NONE", "INTERNAL_MODEL"):
            overrides = "control.architecture=POSITION_MEASURED_FORCE", f"control.passivity.method={method}"
            (felt, pressed, _), world, teleop = run(TorqueLeader(), SensingFollower(), *overrides)
            least[method] = world.least_j
            self.assertGreater(pressed, 0.4)
            self.assertAlmostEqual(abs(felt), pressed, delta=0.05 * pressed)
            self.assertAlmostEqual(teleop.observed_j, world.energy_j, delta=1e-3)
        self.assertLess(least["NONE"], -15e-3)
        self.assertGreater(least["INTERNAL_MODEL"], -12.6e-3)

    def test_the_action_is_what_the_follower_is_sent(self):
        """The leader begins 20 degrees ahead, and its motion counts half: LeRobot's recorder stores what get_action() returns."""
        leader, follower = TurnedLeader(), pair.Follower()
        world = pair.World(leader, follower)
        options = {"servo_stiffness_n_m_per_rad": STIFFNESS, "clock": lambda: world.t_s}
        teleop = twoport.lerobot.Teleoperator(scene("control.motion_scale=0.5"), leader, follower, **options)
        robot = twoport.lerobot.Robot(teleop)
        teleop.connect(), robot.connect()
        stored = []
        while world.t_s < 3.0:
            robot.get_observation()
            stored.append(teleop.get_action())
            self.assertEqual(robot.send_action(dict(stored[-1])), stored[-1])
            self.assertAlmostEqual(np.degrees(follower.goal[0]), stored[-1]["shoulder_pan.pos"], delta=1e-9)
            world.advance(1.0 / 60.0)
        self.assertGreater(np.degrees(leader.q[0]), 20.0)
        for joint, q in zip(pair.JOINTS, np.degrees(leader.q)):
            self.assertAlmostEqual(stored[0][f"{joint}.pos"], 0.0, delta=1e-9)
            self.assertAlmostEqual(stored[-1][f"{joint}.pos"], 0.5 * q, delta=0.1)

    def test_leader_and_follower_of_two_processes_meet_over_udp(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            address = "127.0.0.1:%d" % probe.getsockname()[1]
        here, seen, done = scene("control.hold_after_s=0.5"), {}, threading.Event()

        def at_the_follower():
            follower = pair.Follower()
            world = pair.World(pair.Leader(), follower)
            teleop = twoport.lerobot.Teleoperator(here, address, follower)
            robot = twoport.lerobot.Robot(teleop)
            teleop.connect(), robot.connect()
            while not done.is_set():
                observation = robot.get_observation()
                action = teleop.get_action()
                self.assertEqual(set(action), set(teleop.action_features))
                robot.send_action(action)
                world.advance(1.0 / 60.0)
                seen.update(pressed=world.pressed_n_m()[0], mode=teleop.mode, said=observation["shoulder_pan.torque"], **action)
            robot.disconnect(), teleop.disconnect()

        thread = threading.Thread(target=at_the_follower)
        thread.start()
        try:
            leader = TurnedLeader()
            world = pair.World(leader, pair.Follower())
            teleop = twoport.lerobot.Teleoperator(here, leader, address, servo_stiffness_n_m_per_rad=STIFFNESS)
            robot = twoport.lerobot.Robot(teleop)
            teleop.connect(), robot.connect()
            self.assertEqual(teleop.mode, "coupled")
            while world.t_s < 4.0:
                observation = robot.get_observation()
                self.assertEqual(set(observation), set(robot.observation_features))
                robot.send_action(teleop.get_action())
                world.advance(1.0 / 60.0)
            felt = -leader.servos()[0]
            self.assertEqual(seen["mode"], "coupled")
            self.assertGreater(seen["pressed"], 0.8)
            self.assertAlmostEqual(felt, seen["pressed"], delta=0.1 * seen["pressed"])
            self.assertAlmostEqual(seen["said"], seen["pressed"], delta=0.1 * seen["pressed"])
            self.assertAlmostEqual(seen["shoulder_pan.pos"], np.degrees(leader.q[0]), delta=8.0)
            self.assertAlmostEqual(observation["shoulder_pan.torque"], seen["pressed"], delta=0.1 * seen["pressed"])
            self.assertGreater(observation["shoulder_pan.pos"], np.degrees(0.3))
            self.assertGreater(world.least_j, -12.6e-3)
            teleop.disconnect(), robot.disconnect()
        finally:
            done.set()
            thread.join()


class Datasets(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.files = [pathlib.Path(folder.name, f"{i}.mcap") for i in range(2)]
        for i, file in enumerate(cls.files):
            cls.record(file, "leader_follower", f"seed={i + 1}", f"duration_s={3 + i}")
        cls.names = [f"panda_{i}" for i in range(7)]

    @staticmethod
    def record(file, name, *overrides):
        sets = [word for override in overrides for word in ("--set", override)]
        done = subprocess.run([LAB, "run", SCENES / f"{name}.textproto", *sets, "--trace", "none", "--record", file], capture_output=True, text=True)
        assert done.returncode in (0, 3), done.stderr

    def expected(self, file, index, first):
        rows = twoport.load_recording(file).trace[::20]
        columns = {"observation.state": rows["slave_x"], "observation.force": -rows["env_f"], "action.force": rows["master_f"]}
        columns["action"] = rows["slave_x"] - rows["position_error"]
        indices = {"frame_index": np.arange(len(rows)), "index": first + np.arange(len(rows)), "episode_index": np.full(len(rows), index)}
        return {name: values.astype(np.float32) for name, values in columns.items()} | indices

    def test_a_dataset_has_lerobots_layout(self):
        info = twoport.lerobot.write_dataset(self.folder / "set", self.files, names=self.names, task="press")
        self.assertEqual(info, json.loads((self.folder / "set/meta/info.json").read_text()))
        self.assertEqual((info["codebase_version"], info["total_episodes"], info["fps"], info["splits"]), ("v3.0", 2, 50, {"train": "0:2"}))
        self.assertEqual(info["features"]["action"], {"dtype": "float32", "shape": [7], "names": [f"panda_{i}.pos" for i in range(7)], "unit": "rad"})
        self.assertEqual(info["features"]["observation.force"]["unit"], "N m")
        self.assertEqual(info["features"]["timestamp"], {"dtype": "float32", "shape": [1], "names": None})
        stats = json.loads((self.folder / "set/meta/stats.json").read_text())
        self.assertEqual(set(stats), set(info["features"]))
        self.assertEqual((len(stats["action"]["q99"]), stats["action"]["count"]), (7, [info["total_frames"]]))
        data = (self.folder / "set" / info["data_path"].format(chunk_index=0, file_index=0)).read_bytes()
        self.assertEqual((data[:4], data[-4:]), (b"PAR1", b"PAR1"))
        first = 0
        for i, file in enumerate(self.files):
            expected = self.expected(file, i, first)
            self.assertGreater(np.abs(expected["observation.force"]).max(), 1.0)
            for name, values in expected.items():  # plain pages
                self.assertIn(values.tobytes(), data, name)
            first += len(expected["index"])
        self.assertEqual(info["total_frames"], first)

    def test_the_action_is_where_the_robot_is_wanted(self):
        """The hand's motion as it arrives 50 ms later, in the robot's place and scale."""
        file = self.folder / "run.mcap"
        for name, scale, overrides in (
            ("leader_follower", 0.5, ("control.motion_scale=0.5", "robot.arm.joint_position_rad[0]=0.3")),
            ("leader_follower", 2.0, ("control.motion_scale=2",)),
            ("six_dof_plate", 2.0, ("control.motion_scale=2", "operator.path[0].move_to.position_m=[0.03,0,0,0.9,0.3,-0.3,0.1]")),
        ):
            self.record(file, name, "duration_s=2", "rate_hz=1000", "to_slave.delay_ms=50", "to_slave.loss=0", *overrides)
            recording = twoport.load_recording(file)
            rows, frames = recording.trace, twoport.lerobot._frames(recording, 50, 0, 0)
            hand, action = rows["master_x"], frames["action"]
            wanted = rows["slave_x"][0] + scale * (hand - hand[0])
            if name == "six_dof_plate":
                wanted[:, 3:] = hand[:, 3:]  # both tools begin alike
                self.assertGreater(np.abs(action[:, 3:]).max(), 0.05)
            self.assertGreater(np.abs(wanted - hand).max(), 0.02)
            np.testing.assert_allclose(action[5:], wanted[20 * np.arange(5, len(action)) - 50], atol=1e-6)
            np.testing.assert_array_equal(action[:2], frames["observation.state"][:2])

    def test_another_reader_of_parquet_reads_it(self):
        """hyparquet, which npm fetches into the folder that TWOPORT_NPM names."""
        if not shutil.which("npm"):
            self.skipTest("npm is not installed")
        npm = pathlib.Path(os.environ["TWOPORT_NPM"])
        if not (npm / "node_modules/hyparquet").exists():
            npm.mkdir(parents=True, exist_ok=True)
            if subprocess.run(["npm", "install", "--prefix", npm, "--ignore-scripts", "--no-audit", "--no-fund", "--silent", "hyparquet@1.31.5"]).returncode:
                self.skipTest("npm could not fetch hyparquet")
        twoport.lerobot.write_dataset(self.folder / "set", self.files, names=self.names, task="press")
        script = f"""
            import {{ asyncBufferFromFile, parquetReadObjects, parquetMetadataAsync }} from "{npm}/node_modules/hyparquet/src/node.js";
            const file = await asyncBufferFromFile(process.argv[1]);
            const {{ row_groups, key_value_metadata }} = await parquetMetadataAsync(file);
            const plain = (_, v) => typeof v === "bigint" ? Number(v) : v;
            console.log(JSON.stringify({{ groups: row_groups.length, metadata: key_value_metadata, rows: await parquetReadObjects({{ file }}) }}, plain));
        """

        def read(path):
            done = subprocess.run(["node", "--input-type=module", "-e", script, self.folder / "set" / path], capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            return json.loads(done.stdout)

        data, episodes, tasks = read("data/chunk-000/file-000.parquet"), read("meta/episodes/chunk-000/file-000.parquet"), read("meta/tasks.parquet")
        self.assertEqual((data["groups"], tasks["rows"]), (2, [{"task_index": 0, "task": "press"}]))
        self.assertEqual(json.loads(tasks["metadata"][0]["value"])["index_columns"], ["task"])
        first = 0
        for i, file in enumerate(self.files):
            expected, about = self.expected(file, i, first), episodes["rows"][i]
            count = len(expected["index"])
            self.assertEqual((about["tasks"], about["length"], about["dataset_from_index"], about["dataset_to_index"]), (["press"], count, first, first + count))
            for name, values in expected.items():
                np.testing.assert_array_equal(np.array([row[name] for row in data["rows"][first : first + count]]).astype(values.dtype), values, name)
            first += count
        self.assertEqual(len(data["rows"]), first)
        self.assertEqual(about["stats/action/max"], np.max([row["action"] for row in data["rows"][first - count :]], axis=0).tolist())

    def test_from_the_command_line(self):
        def call(*arguments):
            return subprocess.run([sys.executable, "-m", "twoport.lerobot", *map(str, arguments)], capture_output=True, text=True)

        done = call(self.folder / "set", *self.files)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("2 episodes, 350 frames, 50 a second", done.stdout)
        again = call(self.folder / "set", *self.files)
        self.assertEqual((again.returncode, again.stderr), (2, f"python -m twoport.lerobot: {self.folder}/set is not empty; a dataset needs a folder of its own\n"))
        self.assertEqual(call().returncode, 2)
        one_axis = self.folder / "one.mcap"
        self.record(one_axis, "one_axis_wall", "duration_s=1")
        with self.assertRaisesRegex(ValueError, "one.mcap has other axes than .*0.mcap"):
            twoport.lerobot.write_dataset(self.folder / "other", [self.files[0], one_axis])
        with self.assertRaisesRegex(ValueError, "fps is 0; it must be 1 to 1000"):
            twoport.lerobot.write_dataset(self.folder / "other", self.files, fps=0)


if __name__ == "__main__":
    unittest.main()
