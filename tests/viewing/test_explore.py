"""The page of `faultgen explore`: what it shows is what `faultgen generate` would write."""

import base64
import json
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
from functools import partial
from urllib.error import HTTPError
from urllib.parse import urlencode
from urllib.request import Request, urlopen

import numpy as np
import pytest
from conftest import HANG, SWING, TWO_AXES, faultgen_here

from faultgen.dataset.reader import open_dataset
from faultgen.effects import EFFECTS
from faultgen.errors import InputError
from faultgen.exploring.choice import Subject, read_choice
from faultgen.exploring.cycles import Cycles, place_of
from faultgen.exploring.offer import offer
from faultgen.exploring.server import ExploreServer

WORN = {"effect": "friction_wear", "axis": 2, "severity": 0.2}


@pytest.fixture(scope="module")
def server(tiny_robot_path, tiny_task_path):
    with ExploreServer(tiny_robot_path, tiny_task_path) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def ask(server, path, told=None, **headers):
    """What the server answers, as the page would ask."""
    address = f"{server.url}{path}?{urlencode(told or {})}"
    with urlopen(Request(address, headers=headers), timeout=HANG) as reply:
        return json.load(reply)


def refused(server, path, told=None, **headers):
    """Status and message of a request that is refused."""
    with pytest.raises(HTTPError) as caught:
        ask(server, path, told, **headers)
    with caught.value as reply:
        return reply.code, json.load(reply)["error"]


def numbers(told):
    return np.frombuffer(base64.b64decode(told["bdata"]), "<f4")


def test_the_page_needs_nothing_from_elsewhere(server):
    """All that it loads comes from the server, and the browser is told to load nothing else."""
    with urlopen(server.url, timeout=HANG) as reply:
        page = reply.read().decode()
        rules = reply.headers["Content-Security-Policy"]
    assert "default-src 'none'" in rules
    loaded = re.findall(r'(?:src|href)="([^"]+)"', page)
    assert len(loaded) == 5
    for name in loaded:
        with urlopen(server.url + name, timeout=HANG) as reply:
            script = reply.read().decode()
        assert len(script) > 1000
        if name != "plotly.js":
            assert "://" not in script
    ids = set(re.findall(r'\bid="([\w-]+)"', page))
    for name in set(re.findall(r'by\("([\w-]+)"\)', script)):
        assert name in ids, name


def test_what_cannot_be_chosen_has_a_reason(server):
    """Every effect is listed with every axis; where it cannot act, the page says why."""
    state = ask(server, "state")
    effects = {one["name"]: one["axes"] for one in state["effects"]}
    assert list(effects) == list(EFFECTS)
    assert [one["why_not"] for one in effects["loose_tool"]] == ["it acts on axis 2 only", ""]
    assert not any(one["why_not"] for one in effects["friction_wear"])
    assert effects["backlash"][0]["units"] == "rad"
    assert state["payload"]["usual"] == 0.5
    for name, axes in effects.items():
        for one in axes:
            if not one["why_not"]:
                assert 0 < one["usual"] <= one["top"] <= one["largest"], name
    message = refused(server, "signals", {**WORN, "effect": "loose_tool", "axis": 1})
    assert message == (422, "loose_tool cannot act on axis 1: it acts on axis 2 only")


def test_a_robot_without_payload_cannot_have_another_one(tmp_path):
    (tmp_path / "bare.xml").write_text(TWO_AXES.replace('mass="0.5"', 'mass="1e-6"'))
    (tmp_path / "swing.toml").write_text(SWING)
    with ExploreServer(str(tmp_path / "bare.xml"), str(tmp_path / "swing.toml")) as server:
        told = offer(server.subject)
    assert told["payload"]["why_not"] == "the robot's model has no payload with a mass"
    (loose,) = (one for one in told["effects"] if one["name"] == "loose_tool")
    assert {one["why_not"] for one in loose["axes"]} == {told["payload"]["why_not"]}
    assert loose["usual_axis"] == 0


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"sensors": "thesis"},
        {"speed": 0.5, "payload": 0.75, "temperature": 55, "schedule": "linear"},
        {"effect": "sensor_dropout", "severity": 0.3},
        {"effect": "temperature_friction", "severity": 1, "temperature": 60},
        {"effect": "temperature_friction", "severity": 0.2},
        {"effect": "delay", "severity": 0.004, "axis": 1},
    ],
    ids=lambda more: " ".join(map(str, more.values())),
)
def test_the_command_makes_what_is_shown(server, tmp_path, more):
    """With one cycle, `faultgen generate` writes the shown torque of both runs, bit for bit."""
    choice = WORN | more
    shown = ask(server, "signals", {**choice, "exact": 1})
    assert shown["exact"]
    program, *arguments = shlex.split(shown["command"])
    assert program == "faultgen"
    arguments[arguments.index("--cycles") + 1] = "1"
    arguments[arguments.index("-o") + 1] = str(tmp_path / "out")
    done = faultgen_here(*arguments, "--workers", "1")
    assert done.returncode == 0, done.stderr
    healthy, worn = open_dataset(tmp_path / "out").runs
    assert (worn["effect"], worn["axis"]) == (choice["effect"], choice["axis"])
    every, own = shown["step"], choice["axis"] - 1
    for run, one in ((healthy, shown["healthy"]), (worn, shown["now"])):
        torque = run.read("signals/motor_torque")[0]
        np.testing.assert_array_equal(numbers(one["torque"]), torque[::every, own])
        friction = run.read("truth/friction_torque")[0]
        np.testing.assert_array_equal(numbers(one["friction"]), friction[::every, own])
        rms = np.sqrt((torque.astype(float) ** 2).mean(axis=0))
        np.testing.assert_allclose(one["rms"], rms, rtol=1e-6)
        stored = run.read("monitoring/torque_histogram")[0, own]
        np.testing.assert_array_equal(one["histograms"]["torque_histogram"], stored)


def settled(cycles, choice):
    """Let the cycles around a choice be simulated, as while nobody moves a slider."""
    deadline = time.monotonic() + HANG
    cycles.near(choice)
    while not cycles.is_settled():
        assert time.monotonic() < deadline, "it hangs"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def cycles(tiny_robot_path, tiny_task_path):
    cycles = Cycles(Subject(tiny_robot_path, tiny_task_path))
    yield cycles
    cycles.close()


def torque_of(found):
    return found.arrays["motor_torque"]


def test_between_simulated_severities_the_error_is_stated(cycles):
    """The interpolated torque is as near to the simulated one as the page says."""
    choice = read_choice({"effect": "friction_wear", "axis": "2", "severity": "0.3"})
    assert cycles.near(choice) is None  # nothing has been simulated yet
    settled(cycles, choice)
    guess = cycles.near(choice)
    low, high = guess.between
    assert (low, high) == (0.25, 0.375)
    assert guess.error.shape == (2,)
    truth = cycles.exact(choice)
    assert truth.is_exact
    assert not guess.is_exact
    wrong = np.sqrt(np.mean((torque_of(guess) - torque_of(truth)) ** 2, axis=0))
    healthy = read_choice({"effect": "friction_wear", "axis": "2"})
    change = np.sqrt(np.mean((torque_of(truth) - torque_of(cycles.exact(healthy))) ** 2, axis=0))
    assert 0 < wrong[1] <= guess.error[1] < 0.05 * change[1]
    # what is simulated is not interpolated any more
    assert cycles.near(choice).is_exact


def test_temperature_and_payload_are_interpolated_as_those_of_a_healthy_robot(cycles):
    """Before anything is simulated there; the sum is near to the truth, and says what it is."""
    told = {"effect": "friction_wear", "axis": "2", "severity": "0.3"}
    settled(cycles, read_choice(told))
    moved = read_choice({**told, "temperature": "48", "payload": "0.6"})
    guess = cycles.near(moved)
    assert guess.moved
    still = torque_of(cycles.near(read_choice(told)))
    truth = torque_of(cycles.exact(moved))
    wrong, without = (np.sqrt(np.mean((one - truth) ** 2)) for one in (torque_of(guess), still))
    assert 0 < wrong < 0.25 * without


def test_faults_of_sensors_move_nothing():
    """So that they need no simulation of their own."""
    stuck = read_choice({"effect": "sensor_stuck", "axis": "1", "severity": "0.5"})
    healthy = read_choice({"effect": "friction_wear", "axis": "2"})
    assert place_of(stuck) == place_of(healthy)
    late = read_choice({"effect": "delay", "axis": "1", "severity": "0.001"})
    assert place_of(late) != place_of(healthy)


def test_a_fault_that_does_not_show_is_told(server):
    """A spring that is far too weak changes next to nothing; more friction shows."""
    told = {**WORN, "exact": 1}
    assert ask(server, "signals", told)["note"] == ""
    assert ask(server, "signals", {**told, "severity": 0})["note"] == ""
    weak = {**told, "effect": "gravity_spring", "severity": 1e-9}
    assert "hardly changes" in ask(server, "signals", weak)["note"]


def test_isolators_name_the_worn_axis(server):
    """The one that knows friction names it and its severity; without a fault, it names none."""
    for told, axis in ((WORN, 2), ({**WORN, "severity": 0}, 0)):
        found = ask(server, "verdict", {**told, "schedule": "constant", "cycles": 30})
        rows = {row["name"]: row for row in found["rows"]}
        row = rows["friction residual"]
        assert (row["axis"], row["right"]) == (axis, True)
    found = ask(server, "verdict", {**WORN, "schedule": "constant", "cycles": 30})
    (row,) = (row for row in found["rows"] if row["name"] == "friction residual")
    value, low, high = row["severity"]
    assert low <= 0.2 <= high
    assert value == pytest.approx(0.2, abs=0.02)


def test_isolators_that_cannot_be_asked_say_why(server):
    """One cycle is too short for those that learn from windows of twelve."""
    found = ask(server, "verdict", {**WORN, "cycles": 1})
    rows = {row["name"]: row for row in found["rows"]}
    assert "few" in rows["friction residual"]["why_not"]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"effect": "rust"}, "unknown effect 'rust'"),
        ({"axis": 3}, "robot tiny has axes 1 to 2"),
        ({"axis": "x"}, "no number"),
        ({"severity": 11}, "takes up to 10"),
        ({"severity": -0.1}, "at least 0"),
        ({"severity": "nan"}, "at least 0"),
        ({"speed": 3}, "speed"),
        ({"temperature": 900}, "temperature"),
        ({"sensors": "realistic"}, "choose none or thesis"),
        ({"schedule": "never"}, "unknown schedule"),
        ({"cycles": 0}, "from 1 to"),
        ({"axis": ""}, "missing"),
    ],
)
def test_wrong_requests_are_refused_in_one_line(server, more, message):
    for exact in (0, 1):
        status, said = refused(server, "signals", {**WORN, **more, "exact": exact})
        assert status == 422
        assert message in said
        assert "\n" not in said


def test_only_pages_of_this_machine_may_ask(server):
    """A foreign name that points here is refused, and so is a page of another address."""
    port = server.server_port
    assert ask(server, "state", Host=f"localhost:{port}")["robot"] == "tiny"
    assert ask(server, "state", Origin=f"http://127.0.0.1:{port}")["robot"] == "tiny"
    for headers in (
        {"Host": "evil.example"},
        {"Host": f"evil.example:{port}"},
        {"Host": "127.0.0.1"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
    ):
        assert refused(server, "state", **headers)[0] == 403, headers
    assert server.server_address[0] == "127.0.0.1"
    assert refused(server, "nothing")[0] == 404
    assert refused(server, "../choice.py")[0] == 404


def test_a_port_in_use_is_told(tiny_robot_path, tiny_task_path):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port}: another program uses it; give another"):
            ExploreServer(tiny_robot_path, tiny_task_path, port)


def test_a_robot_with_a_slide(tmp_path):
    """Severities, axes and poses of a robot whose first axis slides, in metres."""
    slide = 'name="joint1" type="slide" axis="1 0 0" range="-3 3"'
    text = TWO_AXES.replace('name="joint1" axis="0 0 1" range="-3 3"', slide)
    (tmp_path / "gantry.xml").write_text(text)
    (tmp_path / "swing.toml").write_text(SWING.replace("40,", "0.4,"))
    subject = Subject(str(tmp_path / "gantry.xml"), str(tmp_path / "swing.toml"))
    assert subject.robot.slides.tolist() == [True, False]
    (backlash,) = (one for one in offer(subject)["effects"] if one["name"] == "backlash")
    units = [(one["units"], one["unit"]) for one in backlash["axes"]]
    assert units == [("m", "m, joint side, whole play"), ("rad", "rad, joint side, whole play")]
    with ExploreServer(subject.name, subject.task) as server:
        scene, position = server.scene, server.planned.position
        poses = scene.poses(position)
        places = numbers(poses["bodies"]).reshape(poses["count"], -1, 12)
        link = scene.told()["axes"].index(2)
        spread = np.ptp(places[:, link, 0])  # the second link is carried along x
    assert spread == pytest.approx(np.ptp(position[:, 0]), abs=0.02)
    assert spread > 0.7


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nobody"], "unknown robot 'nobody'"),
        (["puma560", "--task", "nothing"], "nothing"),
        (["puma560", "--port", "70000"], "--port"),
        (["puma560", "--port", "x"], "must be a whole number"),
    ],
)
def test_the_command_refuses_in_one_line(arguments, message):
    done = faultgen_here("explore", *arguments, "--no-browser")
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX systems")
@pytest.mark.parametrize(
    ("how", "flags"), [(signal.SIGINT, ["--no-browser"]), (signal.SIGTERM, [])]
)
def test_it_says_when_it_is_ready_and_ends_when_told(
    tiny_robot_path, tiny_task_path, tmp_path, how, flags
):
    """It writes nothing, neither while it works nor when it ends; nor does it need a display."""
    if not flags and not sys.platform.startswith("linux"):
        pytest.skip("a browser would open")
    command = [sys.executable, "-m", "faultgen.cli", "explore", tiny_robot_path]
    process = subprocess.Popen(
        [*command, "--task", tiny_task_path, "--json", *flags],
        cwd=tmp_path,
        env={k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")},
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        url = json.loads(process.stdout.readline())["url"]
        with urlopen(f"{url}signals?{urlencode(WORN)}", timeout=HANG) as reply:
            assert json.load(reply)["ready"] in (True, False)
        process.send_signal(how)
        said, complained = process.communicate(timeout=HANG)
    finally:
        process.kill()
    assert process.returncode == {signal.SIGINT: 0, signal.SIGTERM: 143}[how]
    assert said == ""
    assert "Traceback" not in complained
    assert ("no browser can be opened here" in complained) == (not flags)
    assert not list(tmp_path.iterdir())
